"""The files of a certificate's finished drives, so that an interrupted certificate can be continued.

Each finished drive has a file of its own beside its record, written last. This module must not know how a drive is run.
"""

from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.certify.link import Answer, Window
from vve_sumo.certify.results import CaseDrive
from vve_sumo.errors import ConfigError

#: folder for the drives of the cases
CASES: Final = "cases"
#: beside a case's record: every setpoint on the wire, and the file that marks the drive as finished
ANSWERS, DRIVE = "setpoints.csv", "drive.json"
#: the query of the certificate
QUERY: Final = "query.json"


@dataclass(frozen=True, slots=True)
class WireSummary:
    """What the record of a finished drive does not hold: the fault's begin and the setpoints' reception."""

    begins: float | None  #: begin of the fault [s]; None where nothing was injected
    refused: Mapping[str, int]  #: rejected setpoints, by reason code
    taken: int  #: accepted setpoints
    unheard: tuple[str, ...]  #: kinds of wires on whose port the brain did not listen


def folder_of(out: Path, case: str, seed: int) -> Path:
    """Return the folder of a drive."""
    return out / CASES / case / f"seed_{seed}"


def keep(folder: Path, answers: Sequence[Answer], wire_summary: WireSummary) -> None:
    """Write a drive's setpoints and summary; the drive counts as finished from then on."""
    with (folder / ANSWERS).open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(("time_s", "answers", "newest", "steering_rad", "acceleration_mps2"))
        writer.writerows((f"{a.time:.3f}", a.answers, a.newest, a.steering, a.acceleration) for a in answers)
    content = {
        "begins": wire_summary.begins,
        "refused": dict(wire_summary.refused),
        "taken": wire_summary.taken,
        "deaf": wire_summary.unheard,
    }
    (folder / DRIVE).write_text(json.dumps(content) + "\n", encoding="utf-8")


def wire_summary_of(folder: Path, window: Window | None) -> WireSummary | None:
    """Return the summary of a finished drive; None where there is none, or its fault was not in `window`."""
    try:
        table = json.loads((folder / DRIVE).read_text(encoding="utf-8"))
        wire_summary = WireSummary(table["begins"], table["refused"], table["taken"], tuple(table["deaf"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    same = (wire_summary.begins is None) == (window is None)
    if same and window is not None and wire_summary.begins is not None:
        same = math.isclose(wire_summary.begins, window.begins, abs_tol=1e-9)
    return wire_summary if same else None


def clear(folder: Path) -> None:
    """Remove the files of an interrupted drive."""
    shutil.rmtree(folder, ignore_errors=True)


def drive_of(folder: Path, wire_summary: WireSummary) -> CaseDrive:
    """Return a finished drive, read from its folder."""
    run = Run(folder / "record")
    summary = run.summary or {}
    number = partial(_number, summary)
    ticks = run.arrow("ticks")
    contacts = [time for time, names in zip(run.time.tolist(), ticks["contacts"].to_pylist(), strict=True) if names]
    return CaseDrive(
        time=np.asarray(run.time, np.float64),
        speed=ticks["true_speed_mps"].to_numpy(),
        gap=np.asarray(run.lead.gap, np.float64),
        answers=tuple(_answers(folder / ANSWERS)),
        outcome=str(summary["outcome"]),
        reasons=tuple(summary["reasons"]),
        collision=bool(summary["collision"]),
        impact_speed=number("impact_speed_mps") if summary["collision"] else math.nan,
        stop_gap=number("stop_gap_m"),
        x=ticks["true_x_m"].to_numpy(),
        y=ticks["true_y_m"].to_numpy(),
        heading=ticks["true_heading_rad"].to_numpy(),
        deviation=ticks["lateral_deviation_m"].to_numpy(),
        contact=contacts[0] if contacts else math.nan,
        refused=wire_summary.refused,
        taken=wire_summary.taken,
        record_sha256=str(summary["record_sha256"]),
    )


def _number(summary: Mapping[str, Any], name: str) -> float:
    value = summary.get(name)
    return math.nan if value is None else float(value)


def _answers(file: Path) -> list[Answer]:
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.reader(lines))[1:]
    return [Answer(float(row[0]), int(row[1]), int(row[2]), float(row[3]), float(row[4])) for row in rows]


def begin(out: Path, query: Mapping[str, Any], *, resume: bool) -> None:
    """Create the folder of a certificate, or check that the existing one was begun with the same query.

    Raises ConfigError for a folder that is not empty, or of another query; nothing is written then.
    """
    if not resume:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise ConfigError(f"--out: {out} is not empty, expected a folder that is absent or empty, or --resume")
        out.mkdir(parents=True, exist_ok=True)
        (out / QUERY).write_text(json.dumps(query, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return
    try:
        before = json.loads((out / QUERY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise ConfigError(f"--resume: {out}: expected a folder with the {QUERY} of a certificate") from None
    for key, value in json.loads(json.dumps(query)).items():
        if before.get(key) != value:
            raise ConfigError(f"--resume: {out / QUERY}: {key}: was begun with {before.get(key)!r}, got {value!r}")
