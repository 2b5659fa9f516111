"""Makes the content of a live drive's `summary.json` from its record alone, however incomplete that is.

Knows tables; no process, no clock. A drive that was killed sent no reasons for that; the gateway's last ones stand in.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pyarrow as pa

from vve_sumo.drive.termination import Outcome
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_files, hash_parts, whole
from vve_sumo.record.latencies import latency_summary
from vve_sumo.record.reader import read_table
from vve_sumo.vehicle.arming import ENDING


def summarise(folder: Path, ended: dict[str, Any] | None) -> dict[str, Any]:
    """Return the summary of the record in `folder`; `ended` is the drive's message of how it ended, if any."""
    ticks, gateway, latency = (_table(folder, name) for name in ("ticks", "gateway", "latency"))
    summary: dict[str, Any] = {"outcome": Outcome.BROKEN.value, "reasons": ["drive_lost"]}
    if ended is None:
        summary["reasons"] += [code for code in _last_reasons(gateway) if code not in summary["reasons"]]
    summary |= ended or {}
    summary |= {"ticks": _rows(ticks), "gateway_steps": _rows(gateway), "latency": _latency(latency)}
    with contextlib.suppress(ConfigError):
        parts = hash_parts(folder)
        summary |= {"record_sha256": whole(parts), "record_parts_sha256": parts}
        summary |= {"record_files_sha256": hash_files(folder)}
    return summary


def summarise_simulated(folder: Path, ended: dict[str, Any] | None) -> dict[str, Any]:
    """Return the same of a simulated ego, whose gateway steps with the ticks and whose latency is nobody's."""
    return {key: value for key, value in summarise(folder, ended).items() if key not in ("gateway_steps", "latency")}


def _table(folder: Path, name: str) -> pa.Table | None:
    try:
        return read_table(folder, name)
    except (ConfigError, pa.ArrowException, OSError):
        return None


def _rows(table: pa.Table | None) -> int:
    return 0 if table is None else int(table.num_rows)


def _last_reasons(gateway: pa.Table | None) -> list[str]:
    """Return why the gateway stopped the car; its rows after it has let go no longer hold that."""
    if gateway is None:
        return []
    rows = zip(gateway["state"].to_pylist(), gateway["reasons"].to_pylist(), strict=True)
    ending_reasons = [reasons for state, reasons in rows if state in ENDING]
    return ending_reasons[-1].split("+") if ending_reasons and ending_reasons[-1] else []


def _latency(table: pa.Table | None) -> dict[str, Any]:
    return {} if table is None or table.num_rows == 0 else latency_summary(table)
