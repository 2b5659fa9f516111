"""Drives a suite's rows on an engine of many processes and says what came of each.

Knows rows, records and verdicts; neither how an engine works nor how a table is printed.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from vve_sumo.suite.measured import measure
from vve_sumo.suite.row import Outcome, Row, Verdict
from vve_sumo.sweep.engine import Engine
from vve_sumo.sweep.job import Job, Result

#: a row that takes longer has got stuck [s]
TIME_LIMIT = 300.0
#: how a row's drive may end; a car that is stopped by a fault has passed nothing
ENDINGS = ("stopped", "contact", "aborted", "timeout")

Done = Callable[[Outcome], None]


def run(
    name: str, rows: Sequence[Row], engine: Engine, working: Path, records: Path | None = None, done: Done | None = None
) -> list[Outcome]:
    """Drive the rows of suite `name` and return an outcome for each, in their order.

    Records stay in `records`, a folder for each row, where it is given. `done` is called as rows finish.
    """
    outcomes = {row.id: Outcome(row, Verdict.NOT_APPLICABLE, row.not_applicable) for row in rows}
    by_id = {row.id: row for row in rows}
    with tempfile.TemporaryDirectory(prefix="vve_suite_") as scratch:
        folder = Path(scratch) if records is None else records
        folder.mkdir(parents=True, exist_ok=True)

        def finished(job: Job, result: Result) -> None:
            outcome = judge(by_id[job.key], result, folder / job.key)
            if records is None:
                shutil.rmtree(folder / job.key, ignore_errors=True)
                outcome = replace(outcome, record=None)
            outcomes[job.key] = outcome
            if done is not None:
                done(outcome)

        engine.run([job_of(name, row, working, folder) for row in rows if row.scenario is not None], finished)
    return [outcomes[row.id] for row in rows]


def job_of(name: str, row: Row, working: Path, folder: Path) -> Job:
    """Return the job that drives a row, its record in `folder`; raises ValueError where there is nothing to drive."""
    if row.scenario is None:
        raise ValueError(f"{row.id}: expected a scenario, the row is not applicable")
    return Job(
        key=row.id,
        name=f"{name}_{row.id}",
        table=row.scenario.model_dump(mode="json", exclude_unset=True),
        file=Path(f"suite {name}, row {row.id}"),
        working=working,
        keep=folder / row.id,
        time_limit_s=TIME_LIMIT,
    )


def judge(row: Row, result: Result, record: Path) -> Outcome:
    """Return what came of a row that was driven."""
    if result.fault:
        return Outcome(row, Verdict.FAILED, result.fault, cpu_s=result.cpu_s)
    approach, ttc = measure(row, record)
    outcome = Outcome(
        row=row,
        verdict=Verdict.PASSED,
        approach_mps=approach,
        cut_in_ttc_s=ttc,
        impact_mps=_number(result, "impact_speed_mps"),
        least_gap_m=_number(result, "min_gap_m"),
        deceleration_mps2=_number(result, "max_deceleration_mps2"),
        record=record,
        cpu_s=result.cpu_s,
    )
    invalid = invalidity(row, approach, ttc)
    if invalid:
        return replace(outcome, verdict=Verdict.INVALID, why=invalid)
    ending = result.figures.get("outcome")
    if ending not in ENDINGS:
        return replace(outcome, verdict=Verdict.FAILED, why=f"the drive ended by {ending}")
    if result.figures.get("passed") is True:
        return outcome
    allowed = row.need is None or row.need.avoidable
    return replace(
        outcome,
        verdict=Verdict.FAILED if allowed else Verdict.UNAVOIDABLE,
        why=str(result.figures.get("failed", "")),
    )


def invalidity(row: Row, approach: tuple[float, float] | None, ttc: float | None) -> str:
    """Return why the test was not driven as it must be; empty where it was."""
    wanted, cut_in = row.approach, row.cut_in
    if wanted is not None:
        if approach is None:
            return f"actor {wanted.target} never entered"
        low, high = wanted.speed - wanted.below, wanted.speed + wanted.above
        if not (low <= approach[0] and approach[1] <= high):
            said = " to ".join(f"{3.6 * speed:.2f}" for speed in approach)
            return f"approached at {said} km/h, expected {3.6 * low:.2f} to {3.6 * high:.2f}"
    if cut_in is not None and not (ttc is not None and abs(ttc - cut_in.ttc) <= cut_in.tolerance):
        came = "never" if ttc is None else f"{ttc:.2f} s"
        return f"time to collision at lane intrusion: {came}, expected {cut_in.ttc:.2f} +- {cut_in.tolerance:.2f} s"
    return ""


def _number(result: Result, name: str) -> float | None:
    value = result.figures.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
