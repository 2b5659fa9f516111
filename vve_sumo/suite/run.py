"""Drives a suite's rows, each with several seeds, on an engine of many processes, and judges each drive.

Knows rows, records and verdicts; neither how an engine works nor how a table is printed.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from vve_sumo.suite.measured import measure
from vve_sumo.suite.row import JudgedRow, RowOutcome, RowVerdict, SuiteRow
from vve_sumo.sweep.engine import Engine
from vve_sumo.sweep.job import Job, RunResult

#: wall time after which a row's drive is ended [s]
TIME_LIMIT = 300.0
#: outcomes that can pass; a car that a fault stopped does not pass
ENDINGS = ("stopped", "contact", "completed", "timeout")

Done = Callable[[RowOutcome], None]


def run(
    name: str,
    rows: Sequence[SuiteRow],
    engine: Engine,
    working: Path,
    records: Path | None = None,
    done: Done | None = None,
    *,
    seeds: int = 1,
    known: Iterable[RowOutcome] = (),
    rig: Path | None = None,
) -> list[JudgedRow]:
    """Drive the rows of suite `name` with the seeds 1 to `seeds` and return the judged rows, in their order.

    Drives that are `known` are not driven again. Records stay in `records`, a folder for each row and in it one for
    each seed, where it is given. With a `rig`, a file, the rig's car is simulated. `done` is called as drives finish.
    """
    outcomes = {(outcome.row.id, outcome.seed): outcome for outcome in known}
    planned = {key(row, seed): (row, seed) for row, seed in drives(rows, seeds) if (row.id, seed) not in outcomes}
    with tempfile.TemporaryDirectory(prefix="vve_suite_") as scratch:
        folder = Path(scratch) if records is None else records

        def finished(job: Job, result: RunResult) -> None:
            row, seed = planned[job.key]
            record = record_of(folder, row, seed)
            outcome = judge(row, seed, result, record)
            if records is None:
                shutil.rmtree(record, ignore_errors=True)
                outcome = replace(outcome, record=None)
            outcomes[row.id, seed] = outcome
            if done is not None:
                done(outcome)

        for row, seed in planned.values():
            shutil.rmtree(record_of(folder, row, seed), ignore_errors=True)  # of a drive that was killed
            (folder / row.id).mkdir(parents=True, exist_ok=True)
        engine.run([job_of(name, row, seed, working, folder, rig) for row, seed in planned.values()], finished)
    return [
        JudgedRow(
            row, tuple(outcomes[row.id, seed] for seed in range(1, seeds + 1)) if row.scenario is not None else ()
        )
        for row in rows
    ]


def drives(rows: Iterable[SuiteRow], seeds: int) -> Iterator[tuple[SuiteRow, int]]:
    """Return every drive of the rows: a row and a seed, 1 and up."""
    return ((row, seed) for row in rows if row.scenario is not None for seed in range(1, seeds + 1))


def key(row: SuiteRow, seed: int) -> str:
    """Return the key of a drive within its suite."""
    return f"{row.id}_seed_{seed}"


def record_of(folder: Path, row: SuiteRow, seed: int) -> Path:
    """Return the folder of a drive's record."""
    return folder / row.id / f"seed_{seed}"


def job_of(name: str, row: SuiteRow, seed: int, working: Path, folder: Path, rig: Path | None = None) -> Job:
    """Return the job of a row's drive, its record in `folder`; raises ValueError for a row without a scenario."""
    if row.scenario is None:
        raise ValueError(f"{row.id}: expected a scenario, the row is not applicable")
    return Job(
        key=key(row, seed),
        name=f"{name}_{row.id}",
        table=row.scenario.model_copy(update={"seed": seed}).model_dump(mode="json", exclude_unset=True),
        file=Path(f"suite {name}, row {row.id}"),
        working=working,
        keep=record_of(folder, row, seed),
        rig=rig,
        time_limit_s=TIME_LIMIT,
    )


def judge(row: SuiteRow, seed: int, result: RunResult, record: Path) -> RowOutcome:
    """Return the outcome of a row's drive."""
    if result.error:
        return RowOutcome(row, seed, RowVerdict.FAILED, result.error, cpu_s=result.cpu_s)
    measured = measure(row, record)
    outcome = RowOutcome(
        row=row,
        seed=seed,
        verdict=RowVerdict.PASSED,
        approach_mps=measured.approach,
        cut_in_ttc_s=measured.ttc,
        impact_mps=_number(result, "impact_speed_mps"),
        least_gap_m=_number(result, "min_gap_m"),
        deceleration_mps2=_number(result, "max_deceleration_mps2"),
        demand_mps2=measured.demand,
        record=record,
        cpu_s=result.cpu_s,
    )
    invalid = invalidity(row, measured.approach, measured.ttc)
    if invalid:
        return replace(outcome, verdict=RowVerdict.INVALID, why=invalid)
    ending = result.figures.get("outcome")
    if ending not in ENDINGS:
        return replace(outcome, verdict=RowVerdict.FAILED, why=f"the drive ended by {ending}")
    unmet = "" if result.figures.get("passed") is True else str(result.figures.get("failed", ""))
    short = shortfall(row, measured.demand)
    if result.figures.get("passed") is True and not short:
        return outcome
    # A larger gap would not have raised the demand: the closed form excuses an impact alone.
    excused = not short and row.need is not None and not row.need.avoidable
    why = "; ".join(filter(None, (unmet, short)))
    return replace(outcome, verdict=RowVerdict.UNAVOIDABLE if excused else RowVerdict.FAILED, why=why)


def shortfall(row: SuiteRow, demand: float | None) -> str:
    """Return by how much the braking demand is below the required one; empty where it is not."""
    if row.demand <= 0.0 or (demand is not None and demand >= row.demand):
        return ""
    return f"braking demand {demand or 0.0:.2f} m/s2, expected {row.demand:g} or more"


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
