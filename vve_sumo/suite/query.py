"""A suite's options, checked before anything is driven, and the drives that its folder does not hold yet.

Prints nothing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from vve_sumo import workspace
from vve_sumo.drive.resolved_scenario import load_vehicle_model, with_effective_deceleration
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import DEFAULT_VEHICLE
from vve_sumo.suite import catalogue
from vve_sumo.suite.design import design_of
from vve_sumo.suite.row import JudgedRow, RowVerdict, SuiteRow
from vve_sumo.sweep.fill import Progress, drive_into, engine_of, require_begun
from vve_sumo.sweep.plan import rig_that_drives
from vve_sumo.sweep.spec import Keep
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

    out: Path | None = None  #: folder of the tables and the dataset
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
    for requested, option, description in (
        (query.keep, "--keep-records", "the records"),
        (query.resume, "--resume", "the begun suite"),
    ):
        if requested and query.out is None:
            raise ConfigError(f"{option}: expected --out DIR as well, the folder of {description}")
    if query.resume and query.out is not None:
        require_begun(query.out, "suite")


def drive(
    name: str,
    rows: Sequence[SuiteRow],
    query: SuiteQuery,
    car: SuiteCar,
    working: Path,
    progress: Progress,
) -> list[JudgedRow]:
    """Drive what the suite's folder does not hold; without one, the dataset is deleted at the end.

    `progress` takes the tally after every drive. Raises KeyboardInterrupt and SimulationError as `drive_into` does.
    """
    engine = engine_of(query.workers, None)
    title = catalogue.SUITES[name].title
    design = design_of(name, title, rows, query.seeds, working, car.rig)
    keep: Keep = "all" if query.keep else "none"

    def judged(out: Path) -> list[JudgedRow]:
        again = f"the same command with --out {out} --resume"
        drive_into(out, design, engine, keep, resume=query.resume, resume_command=again, progress=progress)
        return design.outcomes(out)

    if query.out is not None:
        return judged(query.out)
    with tempfile.TemporaryDirectory(prefix="vve_suite_") as scratch:
        try:
            return judged(Path(scratch))
        except KeyboardInterrupt:
            raise KeyboardInterrupt("interrupted; without --out no drive is kept") from None
