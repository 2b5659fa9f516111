"""`vve-sumo sweep` from a file's name to a dataset and a table, and one of its runs again.

The only module of the room that prints; everything it prints of runs stands in the dataset.
"""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.drive.resolved_scenario import changed_code, versions
from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.record.record import claim
from vve_sumo.record.sweep_folder import FIGURES, Plan, Row, read_tables
from vve_sumo.scenario.load import parse
from vve_sumo.sweep.dataset import Dataset, refuse_mixed
from vve_sumo.sweep.engine import Engine, Local
from vve_sumo.sweep.job import Job, Result
from vve_sumo.sweep.plan import MANY, SweepQuery, job_of, query_of
from vve_sumo.sweep.preflight import look
from vve_sumo.sweep.progress import Tally, telling
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.search import AdaptiveSearch
from vve_sumo.sweep.spec import Keep, kept, parse_spec
from vve_sumo.sweep.statistics import Group, Outcome, outcome

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

#: rows of the table that are shown, and lines of faults; all of them stand in files
SHOWN, FAULTS_SHOWN = 30, 10
#: figures that are shown where no criterion asks for others, and how many at most
MAIN, MOST = ("min_ttc_s", "stop_gap_m"), 4
#: characters of a line where there is no terminal to say
WIDE = 160


def sweep(
    name: str,
    *,
    out: Path,
    workers: int | None,
    resume: bool,
    yes: bool,
    keep: str | None,
    cluster: str | None,
    quiet: bool,
    search: bool,
    vehicle: str | None = None,
) -> int:
    """Run the command: drive what is not finished, show what came of it; return the exit code."""
    wanted = query_of(name, Path.cwd(), yes=yes, search=search, vehicle=vehicle)
    keeping = wanted.spec.keep if keep is None else _keeping(keep)
    engine = engine_of(workers, cluster)
    again = f"vve-sumo sweep {name} --out {out} --resume" + (f" --cluster {cluster}" if cluster else "")
    again += f" --vehicle {vehicle}" if vehicle else ""
    try:
        hunt = fill(out, wanted, engine, keeping, resume=resume, quiet=quiet, again=again)
    except KeyboardInterrupt as interrupt:
        print(f"vve-sumo: {interrupt}", file=sys.stderr)
        return 130
    return _conclude(out, wanted) if hunt is None else _conclude_search(out, wanted, hunt)


def fill(
    out: Path, wanted: SweepQuery, engine: Engine, keep: Keep, *, resume: bool, quiet: bool, again: str
) -> AdaptiveSearch | None:
    """Drive into a folder whatever of a sweep is not finished there; return the search, where it was one.

    Raises KeyboardInterrupt and SimulationError with a line that says what is safe, and that `again` goes on with it.
    """
    begun = (out / "sweep.json").exists()
    dataset = Dataset(out, wanted.plan, resume=resume)
    if resume and not begun:
        print(f"vve-sumo: {out}: no sweep has begun there; this one does", file=sys.stderr)
    try:
        hunt = _hunt(wanted, dataset)
        _drive(engine, wanted, dataset, hunt, keep, quiet=quiet)
        if hunt is not None and hunt.found is not None:
            dataset.settle(hunt.runs)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {_so_far(dataset)}; to go on: {again}") from None
    except VveError as error:
        raise SimulationError(f"{error}; {_so_far(dataset)}; to go on: {again}") from error
    finally:
        dataset.close()
    if not dataset.whole:
        raise SimulationError(f"some runs were interrupted; {_so_far(dataset)}; to go on: {again}")
    return hunt


def _hunt(wanted: SweepQuery, dataset: Dataset) -> AdaptiveSearch | None:
    """Return the search that was asked for, given what is finished of it; None where every cell is to be driven."""
    if wanted.spec.search is None:
        return None
    held = {row["number"]: row for table in read_tables(dataset.folder) for row in table.to_pylist()}
    return AdaptiveSearch(wanted.cells, held, dataset.folder)


def _so_far(dataset: Dataset) -> str:
    of = "" if "search" in dataset.plan.spec else f" of {dataset.plan.cells}"
    return f"{dataset.finished}{of} runs are finished and safe in {dataset.folder}"


def _keeping(said: str) -> Keep:
    try:
        return kept(said if said in ("none", "failed", "all") else said.split(","))
    except ValueError as error:
        raise ConfigError(f"--keep: {error}, got {said!r}") from None


def engine_of(workers: int | None, cluster: str | None) -> Engine:
    """Return what drives the runs: so many processes here, or a cluster; raises ConfigError for both."""
    if cluster is None:
        return Local(len(os.sched_getaffinity(0)) if workers is None else workers)
    if workers is not None:
        raise ConfigError("--workers: a cluster brings its own; leave out one of --workers and --cluster")
    from vve_sumo.sweep.cluster import Cluster

    return Cluster(cluster)


def _drive(
    engine: Engine, wanted: SweepQuery, dataset: Dataset, hunt: AdaptiveSearch | None, keep: Keep, *, quiet: bool
) -> None:
    """Drive every cell that the dataset does not hold, or every one that a search asks for."""
    under_way: dict[str, RunSpec] = {}
    tally = _tally(dataset)
    cells = wanted.cells.unless(dataset.holds) if hunt is None else hunt.cells()

    def jobs() -> Iterator[Job | None]:
        for cell in cells:
            if cell is None:
                yield None
                continue
            under_way[cell.key] = cell
            yield job_of(wanted.plan, wanted.spec, cell, _record(dataset.folder, cell.key, keep))

    with telling(tally, quiet=quiet) as told:

        def done(job: Job, result: Result) -> None:
            cell = under_way.pop(job.key)
            if result.fault == "interrupted":
                return  # not finished: it is driven when the sweep goes on
            if keep == "failed" and job.keep is not None and result.figures.get("passed"):
                shutil.rmtree(job.keep, ignore_errors=True)
            row = dataset.add(cell, result)
            if hunt is not None:
                hunt.take(row)
                tally.search = hunt.said
            tally.count(result.figures.get("passed") if not result.fault else None, result.fault)  # type: ignore[arg-type]
            told()

        engine.run(jobs(), done)


def _record(folder: Path, key: str, keep: Keep) -> Path | None:
    wanted = keep in ("failed", "all") or key in keep
    return (folder / "records" / key).absolute() if keep != "none" and wanted else None


def _tally(dataset: Dataset) -> Tally:
    failed = faults = 0
    for table in read_tables(dataset.folder):
        failed += table["passed"].to_pylist().count(False)
        faults += sum(map(bool, table["fault"].to_pylist()))
    total = None if "search" in dataset.plan.spec else dataset.plan.cells
    return Tally(total, dataset.finished, failed, faults)


def _conclude(out: Path, wanted: SweepQuery) -> int:
    """Show what a finished sweep came to; return the exit code."""
    plan = wanted.plan
    apart = list(plan.parameters) if wanted.cells.points < MANY else []
    columns = [*apart, "passed", "fault", *_numbers()]
    rows = (row for table in read_tables(out) for row in table.select(columns).to_pylist())
    came = outcome(rows, apart, _numbers())
    if apart:
        _write_combinations(out / "combinations.csv", apart, came)
    _show(out, wanted, came)
    return SimulationError.exit_code if came.all.judged == 0 else 0


def _conclude_search(out: Path, wanted: SweepQuery, hunt: AdaptiveSearch) -> int:
    """Show what a search found; return the exit code."""
    from vve_sumo.sweep.search_results import lines, table_of

    assert hunt.found is not None
    (out / "search.json").write_text(json.dumps(hunt.found, indent=1) + "\n", encoding="utf-8")
    console = _console()
    table = table_of(hunt.found, wanted.spec.title or wanted.plan.scenario)
    if table is not None:
        console.print(table)
    for line in lines(hunt.found, out):
        console.print(line)
    return SimulationError.exit_code if hunt.found["faults"] == hunt.found["runs"] else 0


def _numbers() -> list[str]:
    return [name for name, kind in FIGURES.items() if kind == "float"]


def _write_combinations(file: Path, parameters: Sequence[str], came: Outcome) -> None:
    numbers = _numbers()
    with file.open("w", encoding="utf-8", newline="") as out:
        lines = csv.writer(out, lineterminator="\n")
        means = [f"{name}{which}" for name in numbers for which in ("", "_half_width")]
        lines.writerow([*parameters, "runs", "judged", "passed", "share_low", "share_high", *means])
        for values, group in came.groups.items():
            said = [each for name in numbers for each in (group.means[name].mean, group.means[name].half)]
            counts = (group.runs, group.judged, group.passed, *group.interval)
            lines.writerow([*values, *counts, *("" if one != one else one for one in said)])


def _console() -> Console:
    from rich.console import Console

    return Console(soft_wrap=True, highlight=False, markup=False, width=None if sys.stdout.isatty() else WIDE)


def _show(out: Path, wanted: SweepQuery, came: Outcome) -> None:
    console = _console()
    if came.groups and wanted.plan.parameters:
        console.print(_table(wanted, came))
        if len(came.groups) > SHOWN:
            console.print(f"… and {len(came.groups) - SHOWN} more in {out / 'combinations.csv'}")
    every, faults = came.all, came.all.runs - came.all.judged
    share = ""
    if wanted.spec.design == "random" and wanted.cells.count == wanted.cells.points:
        share = f" ({_percent(every)} of those drawn)"
    failed = every.judged - every.passed
    console.print(f"{every.runs} runs: {every.passed} passed{share}, {failed} failed, {faults} with a fault")
    for number, line in enumerate(came.told()):
        if number == FAULTS_SHOWN:
            console.print(f"  … and {len(came.faults) - FAULTS_SHOWN} other faults")
            break
        console.print(f"  {line}")
    key = _one_that_failed(out)
    if key is not None:
        console.print(f"one that failed, again: vve-sumo sweep --rerun {out} {key}")
    console.print(f"rows: {out / 'rows'}")


def _one_that_failed(out: Path) -> str | None:
    """Return the key of the first run that did not pass; None where all did."""
    for table in read_tables(out):
        passed = table["passed"].to_pylist()
        if False in passed:
            return str(table["key"][passed.index(False)].as_py())
    return None


def _table(wanted: SweepQuery, came: Outcome) -> Table:
    from rich import box
    from rich.table import Table

    said = [name for name in wanted.plan.criteria if FIGURES.get(name) == "float"]
    figures = (said or list(MAIN))[:MOST]
    title = wanted.spec.title or wanted.plan.scenario
    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for name in (*_tails(list(wanted.plan.parameters)), "passed", "share, 95 %", *figures):
        table.add_column(name, justify="right", overflow="fold")
    for values, group in list(came.groups.items())[:SHOWN]:
        means = (group.means[name] for name in figures)
        said_means = (_spread(mean.mean, mean.half) for mean in means)
        table.add_row(*map(_short, values), f"{group.passed} of {group.judged}", _percent(group), *said_means)
    return table


def _tails(names: list[str]) -> list[str]:
    """Return the last parts of dotted keys, or all of them where two end alike."""
    tails = [name.rpartition(".")[2] for name in names]
    return tails if len(set(tails)) == len(tails) else names


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _percent(group: Group) -> str:
    low, high = group.interval
    return f"{100.0 * low:.0f} to {100.0 * high:.0f} %" if group.judged else "none"


def _spread(mean: float, half: float) -> str:
    if math.isnan(mean):
        return "none"
    return f"{mean:.3g}" if math.isnan(half) else f"{mean:.3f} ± {half:.3f}"


def rerun(folder: Path, key: str, out: Path | None) -> int:
    """Drive one run of a dataset again, keep its record and compare; return 0 if it is the same, else 1.

    Raises ConfigError where there is no such run, for other versions, for a controller whose code is not the sweep's,
    and for a record that is there already.
    """
    plan = Plan.of(folder)
    refuse_mixed(folder, plan, versions())
    row = _row(folder, key)
    if not Path(plan.working).is_dir():
        plan = replace(plan, working=str(Path.cwd()))
    keep = (out or folder / "records" / key).absolute()
    try:
        claim(keep)
    except ConfigError as error:
        raise ConfigError(f"{error}; name another with --out DIR") from None
    cell = RunSpec(row["number"], key, {name: row[name] for name in plan.parameters}, row["seed"])
    job = job_of(plan, parse_spec(plan.spec, folder / "sweep.json"), cell, keep)
    name = parse(job.table, job.file).controller.name
    if changed := changed_code(name, plan.files_sha256, job.working):
        again = "a sweep into another folder drives the controller as it is now"
        raise ConfigError(f"{folder}: {changed[0]}: not run; {again}")
    _warn_of_changes(plan, job)
    results: list[Result] = []
    Local(1).run([job], lambda _job, result: results.append(result))
    code = _compare(row, results[0], keep)
    if results[0].figures:
        print(f"picture: {_picture(job, keep)}")
    return code


def _picture(job: Job, keep: Path) -> Path:
    """Draw `drive.png` into a kept record, as `vve-sumo drive` does, and return its place."""
    from vve_sumo.drive.command import Drive, draw
    from vve_sumo.sweep.input_cache import InputCache, setting_of

    summary = json.loads((keep / "summary.json").read_text(encoding="utf-8"))
    # JSON has no word for a figure that is not there.
    summary |= {name: math.nan for name in _numbers() if summary[name] is None}
    return draw(setting_of(job, InputCache()), Drive(keep, summary))


def _row(folder: Path, key: str) -> Row:
    for table in read_tables(folder):
        keys = table["key"].to_pylist()
        if key in keys:
            row: Row = table.slice(keys.index(key), 1).to_pylist()[0]
            return row
    raise ConfigError(f"{folder}: no finished run has the key {key!r}; the column key of its rows lists them")


def _warn_of_changes(plan: Plan, job: Job) -> None:
    seen = look([job])
    files: Mapping[str, str] = seen[0].files_sha256 if seen else {}
    for role, digest in files.items():
        if role in plan.files_sha256 and digest not in plan.files_sha256[role]:
            print(f"warning: the file of {role} has changed since the sweep began", file=sys.stderr)


def _compare(row: Mapping[str, Any], result: Result, keep: Path) -> int:
    """Say whether a run came to the same again."""
    now = result.figures.get("record_sha256")
    same = result.fault == row["fault"] and now == row["record_sha256"]
    before, after = (row["fault"] or f"record {row['record_sha256']}", result.fault or f"record {now}")
    print(f"the same as in the sweep: {after}" if same else f"DIFFERS: the sweep had {before}, now {after}")
    if keep.is_dir():
        print(f"record: {keep}")
    return 0 if same else 1
