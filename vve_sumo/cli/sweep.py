"""`vve-sumo sweep`: a scenario driven many times into one dataset, and one of its runs again."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli.console import complain, note, notify, plain_console
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError, SimulationError

if TYPE_CHECKING:
    from rich.table import Table

    from vve_sumo.sweep.plan import SweepQuery
    from vve_sumo.sweep.search import AdaptiveSearch
    from vve_sumo.sweep.spec import Keep
    from vve_sumo.sweep.statistics import Group, SweepOutcome

EXIT_CODES = """exit codes:
  0  every run is a row, passed or not; of --rerun: the record is the same
  1  of --rerun: it is not
  2  wrong use or configuration; nothing was driven
  4  every run broke, or the disk is full
  130  interrupted from the keyboard; --resume goes on
"""

#: rows of the table that are shown, and lines of errors; all of them stand in files
MAX_ROWS, MAX_ERRORS = 30, 10
#: figures that are shown where no criterion asks for others, and how many at most
USUAL_FIGURES, MAX_FIGURES = ("min_ttc_s", "stop_gap_m"), 4

SUMMARY = "drive a scenario many times, its parameters varied, into one dataset"
TEXT = """\
Drive every run that a sweep's file asks for, each in a process of its own, and leave a row for each in a
Parquet dataset. A run that crashes, hangs or eats memory is a row with its reason. Ctrl-C, a kill or a full
disk lose nothing finished.

examples:
  vve-sumo sweep parked_car_speeds --out speeds            a file under sweeps/
  vve-sumo sweep mine.toml --out mine --keep-records failed   with full records of what failed
  vve-sumo sweep mine.toml --out mine --resume             go on after a kill
  vve-sumo sweep seen_late_speed --search --out found      where a criterion flips, or the worst case
  vve-sumo sweep mine.toml --out mine --rig ours           the simulated vehicle as the rig calibrates it
  vve-sumo sweep --rerun mine 0f3a9c1b5d7e2a48             one run again: is its record the same?
"""


def arguments(parser: Parser) -> None:
    """Add what the command takes."""
    parser.add_argument("spec", nargs="?", help="name or .toml file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the dataset; of --rerun: of the record")
    parser.add_argument("--workers", type=int, metavar="N", help="runs at a time (default: as many as processors)")
    parser.add_argument("--resume", action="store_true", help="go on with the sweep in DIR; finished runs stay")
    parser.add_argument("--search", action="store_true", help="insist that the file has a [search], and look for that")
    parser.add_argument("--yes", action="store_true", help="drive 100,000 runs or more")
    parser.add_argument(
        "--keep-records", metavar="WHOSE", help="full records: none, failed, all or KEY,KEY (default: the file's)"
    )
    parser.add_argument("--vehicle", metavar="NAME", help="instead of the scenario's: under vehicles/, or a .toml file")
    parser.add_argument("--rig", metavar="NAME", help="the simulated vehicle as this rig declares and calibrates it")
    parser.add_argument("--cluster", metavar="ADDRESS", help="drive on the workers of a Dask scheduler")
    parser.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    parser.add_argument("--rerun", nargs=2, metavar=("DIR", "KEY"), help="drive one run of a dataset again and compare")


def run(arguments: argparse.Namespace) -> int:
    """Drive what is not finished and show what came of it, or one run again; return the exit code."""
    if arguments.rerun is not None:
        if arguments.spec is not None:
            raise ConfigError("--rerun: its folder knows what was driven; leave out the sweep's name")
        folder, key = arguments.rerun
        return rerun(Path(folder), key, arguments.out)
    if arguments.spec is None or arguments.out is None:
        from vve_sumo.workspace import known

        there = ", ".join(known("sweep", Path.cwd()))
        raise ConfigError(
            f"sweep: expected a sweep's name or file and --out DIR (see vve-sumo sweep --help); known: {there}"
        )
    return _drive(arguments)


def _drive(arguments: argparse.Namespace) -> int:
    from vve_sumo.sweep.fill import engine_of, fill
    from vve_sumo.sweep.plan import query_of

    name, out, cluster = arguments.spec, arguments.out, arguments.cluster
    query = query_of(
        name,
        Path.cwd(),
        yes=arguments.yes,
        search=arguments.search,
        vehicle=arguments.vehicle,
        rig=arguments.rig,
    )
    for line in query.notes:
        note(line)
    keep = query.spec.keep if arguments.keep_records is None else _keep(arguments.keep_records)
    engine = engine_of(arguments.workers, cluster)
    again = f"vve-sumo sweep {name} --out {out} --resume" + (f" --cluster {cluster}" if cluster else "")
    again += f" --vehicle {arguments.vehicle}" if arguments.vehicle else ""
    again += f" --rig {arguments.rig}" if arguments.rig else ""
    with progress_bar.of_runs(quiet=arguments.quiet) as shown:
        search = fill(out, query, engine, keep, resume=arguments.resume, again=again, progress=shown, notify=complain)
    return _conclude(out, query) if search is None else _conclude_search(out, query, search)


def _keep(wanted: str) -> Keep:
    from vve_sumo.sweep.spec import kept

    try:
        return kept(wanted if wanted in ("none", "failed", "all") else wanted.split(","))
    except ValueError as error:
        raise ConfigError(f"--keep-records: {error}, got {wanted!r}") from None


def _conclude(out: Path, query: SweepQuery) -> int:
    """Show what a finished sweep came to; return the exit code."""
    from vve_sumo.sweep.conclusion import conclude

    came = conclude(out, query)
    _show(out, query, came)
    return SimulationError.exit_code if came.all.judged == 0 else 0


def _conclude_search(out: Path, query: SweepQuery, search: AdaptiveSearch) -> int:
    """Show what a search found; return the exit code."""
    from vve_sumo.cli.search_results import lines, table_of
    from vve_sumo.sweep.conclusion import keep_found

    assert search.found is not None
    keep_found(out, search.found)
    console = plain_console()
    table = table_of(search.found, query.spec.title or query.plan.scenario)
    if table is not None:
        console.print(table)
    for line in lines(search.found, out):
        console.print(line)
    return SimulationError.exit_code if search.found["errors"] == search.found["runs"] else 0


def _show(out: Path, query: SweepQuery, came: SweepOutcome) -> None:
    from vve_sumo.statistics import wilson
    from vve_sumo.sweep.conclusion import COMBINATIONS, first_failed

    console = plain_console()
    if came.groups and query.plan.parameters:
        console.print(_table(query, came))
        if len(came.groups) > MAX_ROWS:
            console.print(f"… and {len(came.groups) - MAX_ROWS} more in {out / COMBINATIONS}")
    every, errors = came.all, came.all.runs - came.all.judged
    share = ""
    if query.spec.design == "random" and query.cells.count == query.cells.points:
        low, high = wilson(every.passed, every.judged)
        share = f" ({_percent(low, high)} of those drawn)" if every.judged else ""
    failed = every.judged - every.passed
    hit = f"; {every.collisions} with a collision" if every.collisions else ""
    console.print(f"{every.runs} runs: {every.passed} passed{share}, {failed} failed, {errors} with an error{hit}")
    for line in came.unmet_lines():
        console.print(f"  {line}")
    for number, line in enumerate(came.lines()):
        if number == MAX_ERRORS:
            console.print(f"  … and {len(came.errors) - MAX_ERRORS} other errors")
            break
        console.print(f"  {line}")
    key = first_failed(out)
    if key is not None:
        console.print(f"one that failed, again: vve-sumo sweep --rerun {out} {key}")
    console.print(f"rows: {out / 'rows'}")


def _table(query: SweepQuery, came: SweepOutcome) -> Table:
    from rich import box
    from rich.table import Table

    numbers = query.plan.numbers()
    said = [name for name in query.plan.criteria if name in numbers]
    figures = (said or list(USUAL_FIGURES))[:MAX_FIGURES]
    title = query.spec.title or query.plan.scenario
    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    shown = list(came.groups.items())[:MAX_ROWS]
    beside = _beside([group for _values, group in shown])
    for name in (*_tails(list(query.plan.parameters)), "passed", *beside, *figures):
        table.add_column(name, justify="right", overflow="fold")
    for values, group in shown:
        counts = (f"{group.passed} of {group.judged}", *(cell(group) for cell in beside.values()))
        table.add_row(*map(_short, values), *counts, *(_spread(group, name) for name in figures))
    if any(group.runs > 1 for _values, group in shown):
        table.caption = "mean of the runs that have the figure, how many of all that is, and the worst of them"
        table.caption_justify = "left"
    return table


def _beside(groups: Sequence[Group]) -> dict[str, Callable[[Group], str]]:
    """Return the columns that stand beside the passes, as far as they say anything: each head and what makes a cell."""
    columns: dict[str, Callable[[Group], str]] = {}
    if any(group.interval for group in groups):
        columns["share, 95 %"] = lambda group: _percent(*group.interval) if group.interval else "none"
    if any(group.collisions for group in groups):
        columns["collisions"] = lambda group: str(group.collisions)
    if any(group.stopped_by_gateway for group in groups):
        columns["stopped by gateway"] = lambda group: str(group.stopped_by_gateway)
    if any(group.errors for group in groups):
        columns["errors"] = lambda group: str(group.errors)
    return columns


def _tails(names: list[str]) -> list[str]:
    """Return the last parts of dotted keys, or all of them where two end alike."""
    tails = [name.rpartition(".")[2] for name in names]
    return tails if len(set(tails)) == len(tails) else names


def _short(value: object) -> str:
    if value is None:  # a key of another controller's tuning
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _percent(low: float, high: float) -> str:
    return f"{100.0 * low:.0f} to {100.0 * high:.0f} %"


def _spread(group: Group, figure: str) -> str:
    """Return a figure's mean with its interval, how many runs have it where some lack it, and the worst of them."""
    mean, half, worst = group.means[figure], group.half(figure), group.worst(figure)
    if mean.count == 0:
        return "none"
    said = f"{mean.mean:.3g}" if math.isnan(half) else f"{mean.mean:.3f} ± {half:.3f}"
    said += f" ({mean.count} of {group.runs})" if mean.count < group.runs else ""
    return said if group.runs == 1 or math.isnan(worst) else f"{said}, worst {worst:.3g}"


def rerun(folder: Path, key: str, out: Path | None) -> int:
    """Drive one run of a dataset again, keep its record and compare; return 0 if it is the same, else 1."""
    from vve_sumo.plotting.drive_record import draw_drive
    from vve_sumo.sweep import rerun as reruns

    done = reruns.rerun(folder, key, out, lambda line: notify(f"warning: {line}"))
    print(
        f"the same as in the sweep: {done.now}" if done.same else f"DIFFERS: the sweep had {done.then}, now {done.now}"
    )
    if done.folder.is_dir():
        print(f"record: {done.folder}")
    if done.result.figures:
        print(f"picture: {draw_drive(done.drive())}")
    return 0 if done.same else 1
