"""`vve-sumo sweep`: drives a scenario many times into one dataset, or reruns one of its runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo import progress_bar
from vve_sumo.cli.console import complain, note, notify, plain_console
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError, SimulationError

if TYPE_CHECKING:
    from rich.table import Table

    from vve_sumo.sweep.conclusion import SweepOutcome
    from vve_sumo.sweep.plan import SweepQuery
    from vve_sumo.sweep.search import AdaptiveSearch
    from vve_sumo.sweep.spec import Keep

#: a row of `groups.grouped`
Combination = Mapping[Hashable, Any]

EXIT_CODES = """exit codes:
  0  every run is a row, passed or not; of --rerun: the record is the same
  1  of --rerun: it is not
  2  wrong use or configuration; nothing was driven
  4  every run broke, or the disk is full
  130  interrupted from the keyboard; --resume continues
"""

#: rows of the table that are shown, and lines of errors; the files have all of them
MAX_ROWS, MAX_ERRORS = 30, 10
#: metrics that are shown where no criterion uses others, and the largest number of them
DEFAULT_METRICS, MAX_METRICS = ("min_ttc_s", "stop_gap_m"), 4

SUMMARY = "drive a scenario many times with varied parameters into one dataset"
TEXT = """\
Drive every run of a sweep's file, each in a process of its own, and write a row for each into a Parquet dataset.
A run that crashes, hangs or exceeds its memory limit is a row with the reason. Finished runs survive Ctrl-C, a kill
and a full disk.

examples:
  vve-sumo sweep parked_car_speeds --out speeds            a file under sweeps/
  vve-sumo sweep mine.toml --out mine --keep-records failed   with full records of what failed
  vve-sumo sweep mine.toml --out mine --resume             continue after a kill
  vve-sumo sweep seen_late_speed --search --out found      where a criterion flips, or the worst case
  vve-sumo sweep mine.toml --out mine --rig ours           the simulated vehicle as the rig calibrates it
  vve-sumo sweep --rerun mine 0f3a9c1b5d7e2a48             rerun one run and compare its record
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("spec", nargs="?", help="name or .toml file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the dataset; of --rerun: of the record")
    parser.add_argument("--workers", type=int, metavar="N", help="runs in parallel (default: one a processor)")
    parser.add_argument("--resume", action="store_true", help="continue the sweep in DIR; finished runs are kept")
    parser.add_argument("--search", action="store_true", help="search; the file must have a table [search]")
    parser.add_argument("--yes", action="store_true", help="drive 100,000 runs or more")
    parser.add_argument(
        "--keep-records", metavar="WHOSE", help="full records: none, failed, all or KEY,KEY (default: the file's)"
    )
    parser.add_argument(
        "--vehicle", metavar="NAME", help="override the scenario's vehicle: a name under vehicles/ or a .toml file"
    )
    parser.add_argument("--rig", metavar="NAME", help="the simulated vehicle as this rig declares and calibrates it")
    parser.add_argument("--cluster", metavar="ADDRESS", help="drive on the workers of this Dask scheduler")
    parser.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    parser.add_argument("--rerun", nargs=2, metavar=("DIR", "KEY"), help="drive one run of a dataset again and compare")


def run(arguments: argparse.Namespace) -> int:
    """Drive the unfinished runs and show the outcome, or rerun one run; return the exit code."""
    if arguments.rerun is not None:
        if arguments.spec is not None:
            raise ConfigError("--rerun: expected no sweep's name: the folder holds the sweep's plan")
        folder, key = arguments.rerun
        return rerun(Path(folder), key, arguments.out)
    if arguments.spec is None or arguments.out is None:
        from vve_sumo.workspace import known

        known_names = ", ".join(known("sweep", Path.cwd()))
        raise ConfigError(
            f"sweep: expected a sweep's name or file and --out DIR (see vve-sumo sweep --help); known: {known_names}"
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
    resume_command = f"vve-sumo sweep {name} --out {out} --resume" + (f" --cluster {cluster}" if cluster else "")
    resume_command += f" --vehicle {arguments.vehicle}" if arguments.vehicle else ""
    resume_command += f" --rig {arguments.rig}" if arguments.rig else ""
    with progress_bar.of_runs(quiet=arguments.quiet) as shown:
        search = fill(
            out,
            query,
            engine,
            keep,
            resume=arguments.resume,
            resume_command=resume_command,
            progress=shown,
            notify=complain,
        )
    return _conclude(out, query) if search is None else _conclude_search(out, query, search)


def _keep(text: str) -> Keep:
    from vve_sumo.sweep.spec import parse_keep

    try:
        return parse_keep(text if text in ("none", "failed", "all") else text.split(","))
    except ValueError as error:
        raise ConfigError(f"--keep-records: {error}, got {text!r}") from None


def _conclude(out: Path, query: SweepQuery) -> int:
    """Show the outcome of a finished sweep; return the exit code."""
    from vve_sumo.sweep.conclusion import conclude

    outcome = conclude(out, query)
    _show(out, query, outcome)
    return SimulationError.exit_code if outcome.all["judged"] == 0 else 0


def _conclude_search(out: Path, query: SweepQuery, search: AdaptiveSearch) -> int:
    """Show the result of a search; return the exit code."""
    from vve_sumo.cli.search_results import lines, table_of
    from vve_sumo.sweep.conclusion import write_search_result

    assert search.result is not None
    write_search_result(out, search.result)
    console = plain_console()
    table = table_of(search.result, query.spec.title or query.plan.scenario)
    if table is not None:
        console.print(table)
    for line in lines(search.result, out):
        console.print(line)
    return SimulationError.exit_code if search.result["errors"] == search.result["runs"] else 0


def _show(out: Path, query: SweepQuery, outcome: SweepOutcome) -> None:
    from vve_sumo.statistics import wilson
    from vve_sumo.sweep.conclusion import COMBINATIONS, first_failed

    console = plain_console()
    if len(outcome.combinations):
        console.print(_table(query, outcome))
        if len(outcome.combinations) > MAX_ROWS:
            console.print(f"… and {len(outcome.combinations) - MAX_ROWS} more in {out / COMBINATIONS}")
    runs, judged, passed, collisions = (outcome.all[name] for name in ("runs", "judged", "passed", "collisions"))
    share = ""
    if query.spec.design == "random" and query.cells.count == query.cells.points:
        share = f" ({_percent(*wilson(passed, judged))} of those drawn)" if judged else ""
    hit = f"; {collisions} with a collision" if collisions else ""
    counts = f"{passed} passed{share}, {judged - passed} failed, {runs - judged} with an error"
    console.print(f"{runs} runs: {counts}{hit}")
    for line in outcome.unmet_lines():
        console.print(f"  {line}")
    for number, line in enumerate(outcome.lines()):
        if number == MAX_ERRORS:
            console.print(f"  … and {len(outcome.errors) - MAX_ERRORS} other errors")
            break
        console.print(f"  {line}")
    key = first_failed(out)
    if key is not None:
        console.print(f"rerun a failed run: vve-sumo sweep --rerun {out} {key}")
    console.print(f"rows: {out / 'rows'}")


def _table(query: SweepQuery, outcome: SweepOutcome) -> Table:
    from rich import box
    from rich.table import Table

    numbers = query.plan.numbers()
    text = [name for name in query.plan.criteria if name in numbers]
    metrics = (text or list(DEFAULT_METRICS))[:MAX_METRICS]
    title = query.spec.title or query.plan.scenario
    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    shown = outcome.combinations.head(MAX_ROWS).to_dict("records")
    extra = _extra_columns(shown)
    for name in (*_short_names(list(query.plan.parameters)), "passed", *extra, *metrics):
        table.add_column(name, justify="right", overflow="fold")
    for row in shown:
        counts = (f"{row['passed']} of {row['judged']}", *(cell(row) for cell in extra.values()))
        values = (_short(row[name]) for name in query.plan.parameters)
        table.add_row(*values, *counts, *(_spread(row, name) for name in metrics))
    if any(row["runs"] > 1 for row in shown):
        table.caption = "mean over the runs with a value, the number of these runs, and the worst value"
        table.caption_justify = "left"
    return table


def _extra_columns(rows: Sequence[Combination]) -> dict[str, Callable[[Combination], str]]:
    """Return the columns after `passed` that are not empty: each head, and the function of its cells."""
    columns: dict[str, Callable[[Combination], str]] = {}
    if any(_interval(row) != "none" for row in rows):
        columns["share, 95 %"] = _interval
    counts = {"collisions": "collisions", "stopped by gateway": "stopped_by_gateway", "errors": "errors"}
    return columns | {
        head: lambda row, name=name: str(row[name]) for head, name in counts.items() if any(row[name] for row in rows)
    }


def _interval(row: Combination) -> str:
    low, high = row["passed_low_share"], row["passed_high_share"]
    return "none" if not row["judged"] or math.isnan(low) else _percent(low, high)


def _short_names(names: list[str]) -> list[str]:
    """Return the last parts of dotted keys, or the whole keys where two last parts are equal."""
    short = [name.rpartition(".")[2] for name in names]
    return short if len(set(short)) == len(short) else names


def _short(value: object) -> str:
    if value is None or value != value:  # a key of another controller's tuning
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _percent(low: float, high: float) -> str:
    return f"{100.0 * low:.0f} to {100.0 * high:.0f} %"


def _spread(row: Combination, metric: str) -> str:
    """Return a metric's mean with its interval, the number of runs with a value if not all, and the worst value."""
    mean, half, worst = (row[f"{which}_{metric}"] for which in ("mean", "half_width", "worst"))
    count, runs = row[f"{metric}_count"], row["runs"]
    if count == 0:
        return "none"
    text = f"{mean:.3g}" if math.isnan(half) else f"{mean:.3f} ± {half:.3f}"
    text += f" ({count} of {runs})" if count < runs else ""
    return text if runs == 1 or math.isnan(worst) else f"{text}, worst {worst:.3g}"


def rerun(folder: Path, key: str, out: Path | None) -> int:
    """Rerun one run of a dataset, keep its record and compare; return 0 if the record is the same, else 1."""
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
