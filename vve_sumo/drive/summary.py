"""What `summary.json` says of a drive: its figures, and whether they meet the scenario's criteria.

Knows tables and figures; neither how a drive is run nor how a summary is shown.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path as FilePath
from typing import Any, Protocol

import pyarrow as pa

from vve_sumo.drive.lockstep import DriveEnd
from vve_sumo.drive.resolved_scenario import versions
from vve_sumo.drive.termination import Outcome
from vve_sumo.metrics import drive_metrics
from vve_sumo.path import Path
from vve_sumo.record.record import hash_files, read_table, whole
from vve_sumo.scenario.schema import Band, Criteria, Scenario
from vve_sumo.values import ArmingState, Vehicle

#: what a figure that is missing because nothing was ever ahead is as good as; every other one that is missing fails
NOTHING_AHEAD = {"min_ttc_s": math.inf, "min_gap_m": math.inf, "max_drac_mps2": 0.0}


class DrivenScenario(Protocol):
    """What a drive's figures are judged by: a resolved scenario, or what a record says of one."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        ...

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        ...

    @property
    def path(self) -> Path:
        """Where the rear axle was to go, in the virtual road's map."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The car as declared."""
        ...


def summarise(driven: DrivenScenario, done: DriveEnd, folder: FilePath, parts: dict[str, str]) -> dict[str, Any]:
    """Return what `summary.json` says of the drive whose record lies in `folder`; `parts` are its hashes."""
    summary = summary_of(driven, done, read_table(folder, "ticks"), read_table(folder, "actors"), parts)
    return summary | {"record_files_sha256": hash_files(folder)}


def summary_of(
    driven: DrivenScenario, done: DriveEnd, ticks: pa.Table, actors: pa.Table, parts: dict[str, str]
) -> dict[str, Any]:
    """Return what a summary says of a drive, but for the hashes of files; `parts` are those of its record."""
    measured = drive_metrics.measure(ticks, actors, driven.path, driven.vehicle)
    summary: dict[str, Any] = {
        "scenario": driven.name,
        "title": driven.scenario.title,
        "seed": driven.scenario.seed,
        "controller": driven.scenario.controller.name,
        "outcome": done.outcome.value,
        "reasons": list(done.reasons),
        "collision": any(ticks["contacts"].to_pylist()),
        **asdict(measured),
        "emergency_used": emergency_used(ticks),
        "duration_s": float(ticks["time_s"][-1].as_py() - ticks["time_s"][0].as_py()) if ticks.num_rows else 0.0,
        "ticks": ticks.num_rows,
        "anchor_position_error_m": greatest(ticks["anchor_position_error_m"]),
        "anchor_speed_error_mps": greatest(ticks["anchor_speed_error_mps"]),
        **done.extra,
        "removed_at_entry": list(done.cleared),
        "removed_after_standoff": list(done.standoffs),
        "sumo_warnings": list(done.warnings),
        "text": done.text,
        "versions": versions(),
    }
    failed = judge(driven.scenario.criteria, summary)
    passed = None if done.outcome is Outcome.PLAYED else not failed
    hashes = {"record_sha256": whole(parts), "record_parts_sha256": parts}
    return summary | {"passed": passed, "failed": failed} | hashes


def greatest(column: pa.ChunkedArray) -> float:
    """Return the greatest number of a column; NaN where it holds none."""
    values = [value for value in column.to_pylist() if value == value]
    return max(values, default=math.nan)


def emergency_used(ticks: pa.Table) -> bool:
    """Whether the car was braked by the emergency layer, not merely asked to be while nobody obeyed."""
    engaged = ArmingState.ENGAGED.value
    return any(
        asked and state == engaged
        for asked, state in zip(ticks["emergency"].to_pylist(), ticks["state"].to_pylist(), strict=True)
    )


def judge(criteria: Criteria, summary: dict[str, Any]) -> list[str]:
    """Return a line for every criterion that a drive's summary does not meet."""
    if summary["outcome"] == Outcome.PLAYED:
        return []
    failed = []
    for name, wanted in criteria:
        if wanted is None:
            continue
        got = summary[name]
        if isinstance(wanted, Band):
            got = NOTHING_AHEAD.get(name, got) if math.isnan(got) else got
            good = (wanted.min is None or got >= wanted.min) and (wanted.max is None or got <= wanted.max)
            if not good:
                failed.append(f"{name} is {got:.3f}, expected {_band(wanted)}")
        elif got != wanted:
            failed.append(f"{name} is {got}, expected {wanted}")
    if summary["outcome"] in (Outcome.BROKEN, Outcome.INTERRUPTED):
        failed.append(f"the drive was {summary['outcome']}")
    if summary["outcome"] == Outcome.FAULT and criteria.outcome is None:
        failed.append("a fault ended the drive")
    return failed


def _band(band: Band) -> str:
    if band.min is None:
        return f"at most {band.max:g}"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"
