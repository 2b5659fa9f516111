"""A suite as a design of many drives: a run for every row and seed, judged by the standard's requirements.

Knows rows and the dataset; neither how an engine works nor how a table is printed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError
from vve_sumo.record.sweep_folder import SweepPlan, SweepSnapshot
from vve_sumo.scenario.load import parse
from vve_sumo.suite.judge import COLUMNS, columns_of, judge, outcome_of
from vve_sumo.suite.row import JudgedRow, SuiteRow
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.fill import Design, Settled
from vve_sumo.sweep.job import Job, RunResult
from vve_sumo.sweep.plan import ReadFiles, job_of
from vve_sumo.sweep.preflight import preview
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.schedule import in_order

#: the one parameter of a suite
ROW = "row"


class SuiteDesign(Design):
    """The rows of a suite, each driven with the seeds 1 and up; rows that are not applicable have no drives."""

    judges_records = True

    def __init__(self, plan: SweepPlan, rows: Sequence[SuiteRow]) -> None:
        super().__init__(plan)
        self._rows = {row.id: row for row in rows}

    def runs(self, dataset: Dataset) -> Iterator[RunSpec | Settled | None]:
        left = (run for run in self._every() if not dataset.holds(run.number))
        return in_order(left, lambda run: self.job(run, None))

    def _every(self) -> Iterator[RunSpec]:
        # Numbered seed by seed, so that a suite that is continued with more seeds keeps its numbers.
        places = ((row, seed) for seed in range(1, self.plan.spec["seeds"] + 1) for row in self.plan.tests)
        return (RunSpec(number, key(row, seed), {ROW: row}, seed) for number, (row, seed) in enumerate(places))

    def job(self, run: RunSpec, record: Path | None) -> Job:
        return job_of(self.plan, None, run, record)

    def judged(self, run: RunSpec, job: Job, result: RunResult) -> RunResult:
        assert job.keep is not None
        outcome = judge(self._rows[str(run.values[ROW])], run.seed, result, job.keep)
        columns = columns_of(outcome) | ({"passed": None} if result.error else {})
        return replace(result, figures=result.figures | columns)

    def outcomes(self, folder: Path) -> list[JudgedRow]:
        """Return the judged rows of the suite in a folder, in the suite's order."""
        stored = {row["key"]: row for table in SweepSnapshot.of(folder).tables() for row in table.to_pylist()}
        seeds = range(1, self.plan.spec["seeds"] + 1)
        return [
            JudgedRow(
                row,
                tuple(
                    outcome_of(row, stored[one], folder / "records" / one)
                    for one in (key(row.id, seed) for seed in seeds if row.scenario is not None)
                ),
            )
            for row in self._rows.values()
        ]


def key(row: str, seed: int) -> str:
    """Return the key of a drive within its suite."""
    return f"{row}_seed_{seed}"


def design_of(
    name: str, title: str, rows: Sequence[SuiteRow], seeds: int, working: Path, rig: Path | None = None
) -> SuiteDesign:
    """Return the design of a suite's rows; with a `rig`, a file, the rig's car is simulated.

    Raises ConfigError for a row that cannot be driven.
    """
    tests = {row.id: _test(row) for row in rows if row.scenario is not None}
    first = next(iter(tests.values()))["scenario"]
    plan = SweepPlan(
        spec={"title": title, "suite": name, "seeds": seeds},
        scenario=name,
        table=first | {"parameters": {ROW: {"sets": _differing(tests), "meaning": f"test of the suite {name}"}}},
        file=str(working.absolute() / f"suite {name}"),
        working=str(working.absolute()),
        cells=len(tests) * seeds,
        parameters={ROW: "str"},
        criteria=_criteria(rows),
        files_sha256={},
        versions=decisive_versions(),
        rig="" if rig is None else str(rig),
        metrics=[column.to_dict() for column in COLUMNS.values()],
        design="suite",
        tests=tests,
    )
    return SuiteDesign(_with_hashes(plan), rows)


def _test(row: SuiteRow) -> dict[str, Any]:
    assert row.scenario is not None
    return {
        "what": row.description,
        "required": row.required,
        "scenario": row.scenario.model_dump(mode="json", exclude_unset=True, exclude={"seed"}),
        "requirements": repr((row.approach, row.cut_in, row.need, row.demand, row.evasion, row.string)),
    }


def _differing(tests: dict[str, Any]) -> list[str]:
    """Return the keys of a scenario's tables in which the rows differ; the title first, which has no unit."""
    scenarios = [test["scenario"] for test in tests.values()]
    keys = sorted({key for one in scenarios for key in one})
    return [
        "title",
        *(key for key in keys if key != "title" and any(one.get(key) != scenarios[0].get(key) for one in scenarios)),
    ]


def _criteria(rows: Sequence[SuiteRow]) -> list[str]:
    """Return the criteria that a row states."""
    scenarios = [row.scenario for row in rows if row.scenario is not None]
    return list(dict.fromkeys(name for one in scenarios for name, wanted in one.criteria if wanted is not None))


def _with_hashes(plan: SweepPlan) -> SweepPlan:
    """Return a plan with the hashes of the files that its tests' drives read, by role, and of controllers by name."""
    hashes = ReadFiles()
    runs = [RunSpec(number, row, {ROW: row}, 1) for number, row in enumerate(plan.tests)]
    jobs = [job_of(plan, None, run, None) for run in runs]
    previews = preview(jobs)
    if len(previews) < len(jobs):
        tried = parse(jobs[len(previews)].table, jobs[len(previews)].file).controller.name
        raise ConfigError(f"controller {tried!r}: it ended the process in which it was made")
    for job, one in zip(jobs, previews, strict=True):
        if one.complaint:
            raise ConfigError(one.complaint)
        hashes.add(parse(job.table, job.file).controller.name, one.files_sha256)
    return hashes.noted_in(plan)
