"""A certificate's drive as its record holds it, and beside the tables every setpoint that came over the wire."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.certify.link import Answer
from vve_sumo.certify.results import CaseDrive
from vve_sumo.errors import ConfigError
from vve_sumo.record.alterations import parts_altered_by_hash
from vve_sumo.record.hashes import hash_file

#: in a drive's record: every setpoint on the wire
ANSWERS: Final = "setpoints.csv"


def write(folder: Path, answers: Sequence[Answer]) -> None:
    """Write a drive's setpoints into its record."""
    with (folder / ANSWERS).open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(("time_s", "answers", "newest", "steering_rad", "acceleration_mps2"))
        writer.writerows((f"{a.time:.3f}", a.answers, a.newest, a.steering, a.acceleration) for a in answers)


def require_unaltered(folder: Path, row: Mapping[str, Any]) -> None:
    """Raise ConfigError unless a folder holds the record and the setpoints of the drive that a row is of."""
    altered = parts_altered_by_hash(folder)
    if altered is None:
        altered = ["its record is gone or was cut off"]
    elif not altered and (Run(folder).summary or {}).get("record_sha256") != row["record_sha256"]:
        altered = ["it is the record of another drive"]
    answers = folder / ANSWERS
    if not altered and (not answers.is_file() or hash_file(answers) != row["setpoints_sha256"]):
        altered = [ANSWERS]
    if altered:
        raise ConfigError(f"{folder}: not as the certificate's drive left it: {altered[0]}; choose another --out")


def drive_of(folder: Path, refused: str = "", taken: int = 1) -> CaseDrive:
    """Return a finished drive, read from its record; how setpoints were received is what its row says."""
    run = Run(folder)
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
        refused={code: int(times) for code, _, times in (one.partition(": ") for one in refused.split("; ") if one)},
        taken=taken,
        record_sha256=str(summary["record_sha256"]),
    )


def _number(summary: Mapping[str, Any], name: str) -> float:
    value = summary.get(name)
    return math.nan if value is None else float(value)


def _answers(file: Path) -> list[Answer]:
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.reader(lines))[1:]
    return [Answer(float(row[0]), int(row[1]), int(row[2]), float(row[3]), float(row[4])) for row in rows]
