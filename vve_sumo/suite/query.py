"""A suite's options, checked before anything is driven, and the drives that its folder does not hold yet.

Prints nothing.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from vve_sumo import workspace
from vve_sumo.drive.plugged_in import PREFIXES
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.drive.resolved_scenario import load_vehicle_model, resolve_scenario, with_effective_deceleration
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import DEFAULT_VEHICLE
from vve_sumo.suite import catalogue
from vve_sumo.suite.journal import NAME, SuiteJournal
from vve_sumo.suite.row import JudgedRow, RowOutcome, RowVerdict, SuiteRow
from vve_sumo.suite.run import Done, drives, run
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.plan import rig_that_drives
from vve_sumo.sweep.progress import Tally
from vve_sumo.vehicle.model import VehicleModel

#: verdicts that fail a suite
BAD = (RowVerdict.FAILED, RowVerdict.INVALID)


class SuiteCar(NamedTuple):
    """The car that drives a suite."""

    model: VehicleModel  #: with its braking limited to what its brakes reach
    vehicle: str  #: its vehicle model: a name or a file
    rig: Path | None  #: rig with the car; None for the vehicle's file
    note: str  #: what limits its braking below the declared value; empty without a limit


class SuiteQuery(NamedTuple):
    """The options of a suite."""

    out: Path | None = None  #: folder of the tables and the journal
    seeds: int = 1  #: drives of each row
    workers: int | None = None  #: drives in parallel; None: one a processor
    controller: str | None = None  #: in place of the row's
    vehicle: str | None = None  #: vehicle model: a name or a file; None: the rig's, or the default one
    rig: str | None = None  #: rig whose car is simulated: a name or a file
    keep: bool = False  #: whether to keep the records
    resume: bool = False  #: whether to continue the suite in `out`


def car_of(query: SuiteQuery, working: Path) -> SuiteCar:
    """Return the car that drives a suite; raises ConfigError for a vehicle or a rig that cannot."""
    if query.rig is None:
        vehicle = query.vehicle or DEFAULT_VEHICLE
        model, note = load_vehicle_model(workspace.find("vehicle", vehicle, working))
        return SuiteCar(model, vehicle, None, note)
    from vve_sumo.rig.load import load
    from vve_sumo.rig.resolve import model_of

    file = rig_that_drives(query.rig, query.vehicle, working)
    rig = load(file, working)
    model, note = with_effective_deceleration(model_of(rig))
    return SuiteCar(model, rig.vehicle.model, file, note)


def rows_of(name: str, query: SuiteQuery, car: SuiteCar, working: Path) -> list[SuiteRow]:
    """Return the rows to drive; raises ConfigError for a query that cannot be driven."""
    rows = [with_vehicle(row, car.vehicle) for row in catalogue.rows(name, car.model)]
    if query.controller is not None:
        rows = [with_controller(row, query.controller) for row in rows]
    first = next(row.scenario for row in rows if row.scenario is not None)
    resolve_scenario(name, first, Path(f"suite {name}"), working).controller(working)
    _check(query)
    return rows


def with_controller(row: SuiteRow, controller: str) -> SuiteRow:
    """Return a row with another controller, without the tuning of the row's own controller."""
    if row.scenario is None or row.scenario.controller.name == controller:
        return row
    other = row.scenario.controller.model_copy(update={"name": controller, "tuning": {}})
    return replace(row, scenario=row.scenario.model_copy(update={"controller": other}))


def with_vehicle(row: SuiteRow, vehicle: str) -> SuiteRow:
    """Return a row whose scenario names a vehicle model."""
    if row.scenario is None:
        return row
    ego = row.scenario.ego.model_copy(update={"vehicle": vehicle})
    return replace(row, scenario=row.scenario.model_copy(update={"ego": ego}))


def _check(query: SuiteQuery) -> None:
    if query.seeds < 1:
        raise ConfigError(f"--seeds: expected 1 or more, got {query.seeds}")
    if query.workers is not None and query.workers < 1:
        raise ConfigError(f"--workers: expected 1 or more, got {query.workers}")
    for requested, option, description in (
        (query.keep, "--keep-records", "the records"),
        (query.resume, "--resume", "the journal"),
    ):
        if requested and query.out is None:
            raise ConfigError(f"{option}: expected --out DIR as well, the folder of {description}")
    out = query.out
    if out is None or not out.exists():
        return
    if query.resume and not (out / NAME).is_file():
        raise ConfigError(f"--resume: {out} has no {NAME}, expected the folder of a begun suite")
    if not query.resume and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(
            f"--out: {out} is not empty, expected an empty or absent folder; --resume continues the suite in a folder"
        )


def drive(
    name: str,
    rows: Sequence[SuiteRow],
    query: SuiteQuery,
    car: SuiteCar,
    working: Path,
    progress: Callable[[Tally], None],
) -> list[JudgedRow]:
    """Drive what the folder's journal does not hold; `progress` takes the tally after every drive."""
    engine = Local(query.workers if query.workers is not None else len(os.sched_getaffinity(0)))
    total = sum(1 for _ in drives(rows, query.seeds))
    if query.out is None:
        return run(name, rows, engine, working, done=_counted(total, [], progress), seeds=query.seeds, rig=car.rig)
    records = query.out / "records" if query.keep else None
    with SuiteJournal(query.out, rows, resume=query.resume, car=car.model, code=code_of(rows, working)) as journal:
        known = [outcome for outcome in journal.known if outcome.seed <= query.seeds]
        done = _counted(total, known, progress, journal.add)
        return run(name, rows, engine, working, records, done, seeds=query.seeds, known=known, rig=car.rig)


def code_of(rows: Sequence[SuiteRow], working: Path) -> str:
    """Return the hash of the driving code: the rows' controllers and sensors, this program and its libraries.

    Raises ConfigError for a controller that cannot be made.
    """
    hashes: dict[str, Any] = {"versions": decisive_versions()}
    for scenario in {row.scenario.controller.name: row.scenario for row in rows if row.scenario is not None}.values():
        resolved = resolve_scenario("suite", scenario, Path("suite"), working)
        resolved.controller(working)
        files = resolved.to_dict(working)["files_sha256"]
        hashes[scenario.controller.name] = {role: files[role] for role in files if role.startswith(PREFIXES)}
    return hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()


def _counted(
    total: int, known: Sequence[RowOutcome], progress: Callable[[Tally], None], also: Done = lambda outcome: None
) -> Done:
    """Return a function of an outcome that counts it and passes the tally to `progress`."""
    failed = sum(outcome.verdict in BAD for outcome in known)
    tally = Tally(total, finished=len(known), failed=failed, errors=0)
    progress(tally)

    def done(outcome: RowOutcome) -> None:
        also(outcome)
        tally.count(outcome.verdict not in BAD, "")
        progress(tally)

    return done
