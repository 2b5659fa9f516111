"""`vve-sumo suite` from a name to a table and an exit code.

The only module of the room that prints.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from vve_sumo.drive.setting import resolve
from vve_sumo.errors import ConfigError
from vve_sumo.suite import catalogue, sheet
from vve_sumo.suite.row import Outcome, Row, Verdict
from vve_sumo.suite.run import Done, run
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.progress import Tally, telling

#: verdicts that make the command fail
BAD = (Verdict.FAILED, Verdict.INVALID)
WIDTH = 160  #: of the table where nobody's screen says how wide it is


def suite(name: str | None, *, out: Path | None, workers: int | None, controller: str | None, keep: bool) -> int:
    """Run the command: list the suites, or drive one; return the exit code."""
    if name is None:
        for known, listed in catalogue.SUITES.items():
            print(f"{known:<14} {listed.title}")
        return 0
    if keep and out is None:
        raise ConfigError("--keep: expected --out DIR beside it, the folder for the records")
    rows = catalogue.rows(name)
    working = Path.cwd()
    if controller is not None:
        rows = [driven_by(row, controller) for row in rows]
    check(name, rows, working)
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"--out: {out} is not empty, expected an empty or absent folder")
    records = out / "records" if keep and out is not None else None
    count = workers if workers is not None else len(os.sched_getaffinity(0))
    if count < 1:
        raise ConfigError(f"--workers: expected 1 or more, got {count}")
    with _progress(sum(row.scenario is not None for row in rows)) as done:
        outcomes = run(name, rows, Local(count), working, records, done)
    _show(catalogue.SUITES[name].title, outcomes)
    if out is not None:
        for file in sheet.write(name, outcomes, out):
            print(f"written: {file}")
    return 1 if any(outcome.verdict in BAD for outcome in outcomes) else 0


def driven_by(row: Row, controller: str) -> Row:
    """Return a row with another controller, and without tuning, which would be no other's."""
    if row.scenario is None or row.scenario.controller.name == controller:
        return row
    other = row.scenario.controller.model_copy(update={"name": controller, "tuning": {}})
    return replace(row, scenario=row.scenario.model_copy(update={"controller": other}))


def check(name: str, rows: Sequence[Row], working: Path) -> None:
    """Raise ConfigError, before anything is driven, where the track or the controller is missing or wrong."""
    first = next(row.scenario for row in rows if row.scenario is not None)
    resolve(name, first, Path(f"suite {name}"), working).controller(working)


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Done]:
    tally = Tally(total, finished=0, failed=0, faults=0)
    with telling(tally, quiet=False) as told:

        def done(outcome: Outcome) -> None:
            tally.count(outcome.verdict not in BAD, "")
            told()

        yield done


def _show(title: str, outcomes: Sequence[Outcome]) -> None:
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    console.print(sheet.table(title, outcomes))
    for line in (*sheet.whys(outcomes), sheet.counted(outcomes)):
        print(line)
