"""Judges a drive of a suite from its record, and keeps the verdict in columns of the dataset's rows.

Knows rows, records and verdicts; neither how a drive is run nor how a table is printed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.table import rows
from vve_sumo.suite.measured import RowMeasurement, measure
from vve_sumo.suite.row import RowOutcome, RowVerdict, SuiteRow
from vve_sumo.sweep.job import MetricValue, RunResult, finite

#: outcomes that can pass; a car that a fault stopped does not pass
ENDINGS = ("stopped", "contact", "completed", "timeout")

_column = partial(Metric, criterion=False)
#: columns of a suite's rows beside those of every sweep
COLUMNS: Final = rows(
    _column("verdict", "verdict", "of the drive, by the standard's requirements", kind="str"),
    _column("why", "why", "reason of a verdict other than passed", kind="str"),
    _column("approach_least_mps", "least approach speed", "least speed from the target's entry to the braking"),
    _column("approach_greatest_mps", "greatest approach speed", "greatest speed in that time"),
    _column("cut_in_ttc_s", "TTC at the cut-in", "time to collision at which the target enters the lane"),
    _column(
        "demand_mps2", "braking demand",
        "largest demand on the service brakes, as a deceleration of the declared car", worse="lower",
    ),
    _column("clearance_m", "least clearance", "least distance between the car's body and any other's", worse="lower"),
    _column(
        "head_to_tail_l2", "head to tail, L2",
        "the last ego's disturbance of speed over that of the platoon's leader: root of the sum of squares",
        worse="higher",
    ),
    _column("off_path_m", "distance from the path at the end", "of the true rear axle", worse="higher"),
)  # fmt: skip
#: figures of every sweep that an outcome holds
FIGURES: Final = ("impact_speed_mps", "min_gap_m", "max_deceleration_mps2")
#: fields of an outcome that are columns of the dataset
STORED: Final = tuple(field.name for field in fields(RowOutcome))[4:]


def columns_of(outcome: RowOutcome) -> dict[str, MetricValue]:
    """Return what a drive's row of the dataset holds of its outcome; a suite's row passes by its verdict.

    A drive that no brakes could pass counts neither as passed nor as failed.
    """
    stored = {name: finite(getattr(outcome, name)) for name in STORED}
    passed = None if outcome.verdict is RowVerdict.UNAVOIDABLE else outcome.verdict is RowVerdict.PASSED
    return {"passed": passed, "failed": outcome.why, "verdict": outcome.verdict.value, **stored}


def outcome_of(row: SuiteRow, stored: Mapping[str, Any], record: Path) -> RowOutcome:
    """Return the outcome of a row's drive that the dataset holds; `record` is the folder of its record, if kept."""
    values = {name: stored[name] for name in STORED}
    verdict = RowVerdict(stored["verdict"])
    return RowOutcome(row, stored["seed"], verdict, record=record if record.is_dir() else None, **values)


def judge(row: SuiteRow, seed: int, result: RunResult, record: Path) -> RowOutcome:
    """Return the outcome of a row's drive."""
    if result.error:
        return RowOutcome(row, seed, RowVerdict.FAILED, why=result.error)
    measured = measure(row, record)
    figures: dict[str, Any] = {name: _number(result, name) for name in FIGURES}
    outcome = RowOutcome(
        row=row,
        seed=seed,
        verdict=RowVerdict.PASSED,
        approach_least_mps=None if measured.approach is None else measured.approach[0],
        approach_greatest_mps=None if measured.approach is None else measured.approach[1],
        cut_in_ttc_s=measured.ttc,
        **figures,
        demand_mps2=measured.demand,
        clearance_m=measured.clearance,
        off_path_m=measured.off_path,
        head_to_tail_l2=measured.head_to_tail,
        record=record,
    )
    invalid = invalidity(row, measured.approach, measured.ttc)
    if invalid:
        return replace(outcome, verdict=RowVerdict.INVALID, why=invalid)
    ending = result.figures.get("outcome")
    if ending not in ENDINGS:
        return replace(outcome, verdict=RowVerdict.FAILED, why=f"the drive ended by {ending}")
    unmet = "" if result.figures.get("passed") is True else str(result.figures.get("failed", ""))
    undemanding = shortfall(row, measured.demand)
    short = "; ".join(filter(None, (undemanding, *unevaded(row, measured), amplified(row, measured))))
    if result.figures.get("passed") is True and not short:
        return outcome
    # A larger gap would not have raised the demand: the closed form excuses an impact, which ends the drive, and what
    # a platoon passes on.
    physical = not undemanding and (not short or ending == "contact" or row.string is not None)
    excused = physical and row.need is not None and not row.need.avoidable
    why = "; ".join(filter(None, (unmet, short)))
    return replace(outcome, verdict=RowVerdict.UNAVOIDABLE if excused else RowVerdict.FAILED, why=why)


def shortfall(row: SuiteRow, demand: float | None) -> str:
    """Return by how much the braking demand is below the required one; empty where it is not."""
    if row.demand <= 0.0 or (demand is not None and demand >= row.demand):
        return ""
    return f"braking demand {demand or 0.0:.2f} m/s2, expected {row.demand:g} or more"


def unevaded(row: SuiteRow, measured: RowMeasurement) -> list[str]:
    """Return a line for each distance that a car that may leave its path did not keep to."""
    if row.evasion is None or measured.clearance is None or measured.off_path is None:
        return []
    lines = []
    if measured.clearance < row.evasion.clearance:
        lines.append(f"clearance {measured.clearance:.2f} m, expected {row.evasion.clearance:g} or more")
    if measured.off_path > row.evasion.back_within:
        lines.append(f"{measured.off_path:.2f} m off its path at the end, expected {row.evasion.back_within:g} or less")
    return lines


def amplified(row: SuiteRow, measured: RowMeasurement) -> str:
    """Return by how much a platoon amplifies more than it may; empty where it does not."""
    if row.string is None or (
        measured.head_to_tail is not None and measured.head_to_tail <= row.string.max_amplification
    ):
        return ""
    got = "never settled" if measured.head_to_tail is None else f"{measured.head_to_tail:.3f}"
    return f"head to tail: {got}, expected {row.string.max_amplification:g} or less"


def invalidity(row: SuiteRow, approach: tuple[float, float] | None, ttc: float | None) -> str:
    """Return why the test was not driven as required; empty where it was."""
    required, cut_in = row.approach, row.cut_in
    if required is not None:
        if approach is None:
            return f"actor {required.target} never entered"
        low, high = required.speed - required.below, required.speed + required.above
        if not (low <= approach[0] and approach[1] <= high):
            speeds = " to ".join(f"{3.6 * speed:.2f}" for speed in approach)
            return f"approached at {speeds} km/h, expected {3.6 * low:.2f} to {3.6 * high:.2f}"
    if cut_in is not None and not (ttc is not None and abs(ttc - cut_in.ttc) <= cut_in.tolerance):
        got = "never" if ttc is None else f"{ttc:.2f} s"
        return f"time to collision at lane intrusion: {got}, expected {cut_in.ttc:.2f} +- {cut_in.tolerance:.2f} s"
    return ""


def _number(result: RunResult, name: str) -> float | None:
    value = result.figures.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
