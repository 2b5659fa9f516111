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
from typing import NamedTuple

from vve_sumo import workspace
from vve_sumo.drive.resolved_scenario import resolve_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import DEFAULT_VEHICLE
from vve_sumo.suite import catalogue, table
from vve_sumo.suite.journal import NAME, Journal
from vve_sumo.suite.row import Judged, Outcome, Row, Verdict
from vve_sumo.suite.run import Done, drives, run
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.progress import Tally, telling
from vve_sumo.vehicle.load import load as load_vehicle

#: verdicts that make the command fail
BAD = (Verdict.FAILED, Verdict.INVALID)
WIDTH = 190  #: of the table where nobody's screen says how wide it is


class Asked(NamedTuple):
    """What the command line asks of a suite, besides its name."""

    out: Path | None = None  #: folder of the tables and the journal
    seeds: int = 1  #: drives of each row
    workers: int | None = None  #: drives at a time; None: as many as processors
    controller: str | None = None  #: another than the row's
    vehicle: str = DEFAULT_VEHICLE  #: vehicle model: a name or a file
    keep: bool = False  #: the records
    resume: bool = False  #: with what is in `out`


def suite(name: str | None, asked: Asked) -> int:
    """Run the command: list the suites, or drive one; return the exit code."""
    if name is None:
        for known, listed in catalogue.SUITES.items():
            print(f"{known:<20} {listed.title}")
        return 0
    working = Path.cwd()
    car = load_vehicle(workspace.find("vehicle", asked.vehicle, working))
    rows = [with_vehicle(row, asked.vehicle) for row in catalogue.rows(name, car)]
    if asked.controller is not None:
        rows = [driven_by(row, asked.controller) for row in rows]
    check(name, rows, working)
    check_asked(asked)
    judged = drive(name, rows, asked, working)
    _show(catalogue.SUITES[name].title, judged)
    if asked.out is not None:
        for file in table.write(name, judged, asked.out):
            print(f"written: {file}")
    return 1 if any(row.verdict in BAD for row in judged) else 0


def drive(name: str, rows: Sequence[Row], asked: Asked, working: Path) -> list[Judged]:
    """Drive what is not in the journal of the folder asked for."""
    engine = Local(asked.workers if asked.workers is not None else len(os.sched_getaffinity(0)))
    total = sum(1 for _ in drives(rows, asked.seeds))
    if asked.out is None:
        with _progress(total, []) as done:
            return run(name, rows, engine, working, done=done, seeds=asked.seeds)
    records = asked.out / "records" if asked.keep else None
    with Journal(asked.out, rows, resume=asked.resume) as journal:
        known = [outcome for outcome in journal.known if outcome.seed <= asked.seeds]
        with _progress(total, known, journal.add) as done:
            return run(name, rows, engine, working, records, done, seeds=asked.seeds, known=known)


def check_asked(asked: Asked) -> None:
    """Raise ConfigError, before anything is driven, where what is asked for does not fit together."""
    if asked.seeds < 1:
        raise ConfigError(f"--seeds: expected 1 or more, got {asked.seeds}")
    if asked.workers is not None and asked.workers < 1:
        raise ConfigError(f"--workers: expected 1 or more, got {asked.workers}")
    for wanted, option, what in ((asked.keep, "--keep", "the records"), (asked.resume, "--resume", "the journal")):
        if wanted and asked.out is None:
            raise ConfigError(f"{option}: expected --out DIR beside it, the folder of {what}")
    out = asked.out
    if out is None or not out.exists():
        return
    if asked.resume and not (out / NAME).is_file():
        raise ConfigError(f"--resume: {out} holds no {NAME}, expected the folder of a suite that was begun")
    if not asked.resume and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"--out: {out} is not empty, expected an empty or absent folder; --resume goes on with one")


def driven_by(row: Row, controller: str) -> Row:
    """Return a row with another controller, and without tuning, which would be no other's."""
    if row.scenario is None or row.scenario.controller.name == controller:
        return row
    other = row.scenario.controller.model_copy(update={"name": controller, "tuning": {}})
    return replace(row, scenario=row.scenario.model_copy(update={"controller": other}))


def with_vehicle(row: Row, vehicle: str) -> Row:
    """Return a row whose scenario names a vehicle model."""
    if row.scenario is None:
        return row
    ego = row.scenario.ego.model_copy(update={"vehicle": vehicle})
    return replace(row, scenario=row.scenario.model_copy(update={"ego": ego}))


def check(name: str, rows: Sequence[Row], working: Path) -> None:
    """Raise ConfigError, before anything is driven, where the track or the controller is missing or wrong."""
    first = next(row.scenario for row in rows if row.scenario is not None)
    resolve_scenario(name, first, Path(f"suite {name}"), working).controller(working)


@contextlib.contextmanager
def _progress(total: int, known: Sequence[Outcome], also: Done = lambda outcome: None) -> Iterator[Done]:
    tally = Tally(total, finished=len(known), failed=sum(outcome.verdict in BAD for outcome in known), faults=0)
    with telling(tally, quiet=False) as told:

        def done(outcome: Outcome) -> None:
            also(outcome)
            tally.count(outcome.verdict not in BAD, "")
            told()

        yield done


def _show(title: str, rows: Sequence[Judged]) -> None:
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    console.print(table.table(title, rows))
    for line in (*table.whys(rows), table.counted(rows)):
        print(line)
