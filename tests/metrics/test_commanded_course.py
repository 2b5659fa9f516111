"""Conflict measures along commanded paths: against stepping bodies, and against the same line as scenario's path."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
import shapely

from tests.drive.swerve import over_and_back
from tests.metrics.tables import CAR, PERIOD, actors_of, straight, ticks_of
from tests.metrics.test_course import body
from vve_sumo.commanded_path import by_tick
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.metrics.routes import Routes
from vve_sumo.path import ReferencePath
from vve_sumo.record.layout import COMMANDED, OPTIONAL_SCHEMAS
from vve_sumo.values import Actors, Floats, Point, Pose

SPEED = 10.0  #: [m/s]
TICKS = 20
#: 3.2 m to the left between 25 m and 55 m, past a car that stands at 70 m, and back between 85 m and 115 m
AROUND = over_and_back((25.0, 55.0, 85.0, 115.0), 3.2)
PARKED = {"actor": "parked", "x_m": 70.0, "length_m": 4.8, "width_m": 2.0}
#: it stands where the commanded path leads
STRUCK = {"actor": "struck", "x_m": 70.0, "y_m": 3.2, "length_m": 4.8, "width_m": 2.0}


def commanded(line: ReferencePath, begins: Floats, reach: float) -> pa.Table:
    """Return the table of paths along a line, from a place of it on, a tick each."""
    rows = [
        {"tick": tick, "x_m": line.at(s).x, "y_m": line.at(s).y, "speed_mps": SPEED}
        for tick, begin in enumerate(begins)
        for s in np.arange(begin, begin + reach, 2.0)
    ]
    return pa.Table.from_pylist(rows, OPTIONAL_SCHEMAS[COMMANDED])


def drive(
    actors: list[dict[str, object]], paths: pa.Table | None, path: ReferencePath | None = None, begin: float = 10.0
) -> DriveData:
    """Return a drive at 10 m/s along x from a place on [m], among actors whose rows are given for its first tick."""
    x = begin + SPEED * PERIOD * np.arange(TICKS)
    ticks = ticks_of([
        {"time_s": PERIOD * n, "true_x_m": a, "true_speed_mps": SPEED, "s_m": a} for n, a in enumerate(x.tolist())
    ])  # fmt: skip
    rows = [
        actor
        | {"tick": tick}
        | {
            axis: float(actor.get(axis, 0.0))  # type: ignore[arg-type]
            + tick * PERIOD * float(actor.get("speed_mps", 0.0)) * turned(float(actor.get("heading_rad", 0.0)))  # type: ignore[arg-type]
            for axis, turned in (("x_m", math.cos), ("y_m", math.sin))
        }
        for actor in actors
        for tick in range(TICKS)
    ]
    return DriveData(ticks, actors_of(rows), path or straight(), CAR, PERIOD, None, paths)


def ways(reach: float = 120.0) -> pa.Table:
    return commanded(AROUND, 10.0 + SPEED * PERIOD * np.arange(TICKS), reach)


def test_a_car_that_the_commanded_path_passes_is_no_conflict() -> None:
    without, passing = drive([PARKED], None), drive([PARKED], ways())
    assert set(without.conflict.actor) == {"parked"}
    assert np.isfinite(without.lead.gap).all()
    for column in (passing.conflict.time, passing.conflict.deceleration, passing.lead.gap, passing.strip_lead.gap):
        assert np.isnan(column).all()


def test_a_car_that_the_commanded_path_hits_is_one() -> None:
    """The time is that of a body that is stepped along the line, the gap no less than bodies are apart."""
    without, hitting = drive([STRUCK], None), drive([STRUCK], ways())
    assert np.isnan(without.conflict.time).all()
    assert set(hitting.conflict.actor) == set(hitting.lead.actor) == {"struck"}
    car = shapely.box(70.0 - 2.4, 3.2 - 1.0, 70.0 + 2.4, 3.2 + 1.0)
    begin = AROUND.project(10.0, 0.0).s
    gone = next(
        gone
        for gone in np.arange(0.0, 80.0, 0.01)
        if shapely.intersects(body(*AROUND.at(begin + gone)[:3]), car)
    )  # fmt: skip
    assert hitting.conflict.time[0] == pytest.approx(gone / SPEED, abs=0.01)
    assert hitting.lead.gap[0] == pytest.approx(gone, abs=0.1)
    assert np.diff(hitting.conflict.time) == pytest.approx(-PERIOD, abs=0.003)
    # Behind what stands, the deceleration that just avoids it is v / 2 t.
    np.testing.assert_allclose(hitting.conflict.deceleration, SPEED / (2.0 * hitting.conflict.time), rtol=0.02)


CROSSING = {
    "actor": "crossing", "x_m": 70.0, "y_m": -22.0, "heading_rad": math.pi / 2.0, "speed_mps": 4.0, "length_m": 4.5,
}  # fmt: skip


#: 1 m to the left and soon back
SHORT = over_and_back((15.0, 30.0, 40.0, 55.0), 1.0)


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    ("actor", "line", "reach"),
    [
        (STRUCK, AROUND, 120.0),
        (CROSSING, AROUND, 120.0),
        (STRUCK | {"x_m": 75.0, "y_m": 3.2, "speed_mps": 2.0}, AROUND, 120.0),
        # The path ends where it is back on the scenario's; what stands farther on is in conflict all the same.
        (STRUCK | {"x_m": 95.0, "y_m": 0.0}, SHORT, 60.0),
        (CROSSING | {"x_m": 95.0, "y_m": -33.0}, SHORT, 60.0),
    ],
)
def test_it_is_as_if_the_commanded_path_were_the_scenarios(
    actor: dict[str, object], line: ReferencePath, reach: float
) -> None:
    """A commanded path's curve is not refitted over its arc length, hence the tolerance."""
    own = drive([actor], None, line)
    said = drive([actor], commanded(line, 10.0 + SPEED * PERIOD * np.arange(TICKS), reach))
    assert np.isfinite(own.conflict.time).all()
    np.testing.assert_allclose(said.conflict.time, own.conflict.time, atol=0.01)
    np.testing.assert_allclose(said.conflict.deceleration, own.conflict.deceleration, atol=0.05)
    np.testing.assert_allclose(said.lead.gap, own.lead.gap, atol=0.1)


def test_behind_its_end_a_commanded_path_leads_on_along_the_scenarios_or_straight() -> None:
    base = over_and_back((100.0, 150.0, 200.0, 250.0), 20.0)
    onto = ReferencePath.from_points(*zip(*[base.at(at_s)[:2] for at_s in np.arange(20.0, 61.0, 2.0)], strict=True))
    off = ReferencePath.from_points([20.0, 40.0, 60.0], [0.0, 2.0, 4.0])
    routes = Routes.from_paths(base, [(onto, 20.0), (off, 20.0)])
    s = np.array([0.0, 35.0, 90.0, 150.0])
    own, joined, straight_on = (routes.at(np.full(4, n), s + (20.0 if n == 0 else 0.0)) for n in range(3))
    np.testing.assert_allclose([joined.x, joined.y, joined.heading], [own.x, own.y, own.heading], atol=0.02)
    direction = math.atan2(4.0, 40.0)
    x, y = 20.0 + s * math.cos(direction), s * math.sin(direction)
    np.testing.assert_allclose([straight_on.x, straight_on.y], [x, y], atol=1e-6)
    assert routes.length.tolist() == pytest.approx([base.length, base.length - 20.0, math.inf], abs=0.01)


def test_who_has_left_the_commanded_path_goes_along_an_arc() -> None:
    line = ReferencePath.from_points([10.0, 200.0], [2.0, 2.0])
    aside = drive([PARKED], commanded(line, np.zeros(TICKS), 100.0))
    assert aside.course.starts.leaves.all()
    assert set(aside.conflict.actor) == {"parked"}


def test_only_ticks_with_a_path_go_by_it() -> None:
    half = ways().filter(pa.compute.greater_equal(ways()["tick"], 10))
    assert drive([PARKED], half).conflict.actor == ["parked"] * 10 + [""] * 10


def test_while_the_drive_goes_on_the_gap_is_along_the_newest_command() -> None:
    """As the record says it afterwards of what is in the strip."""
    at = np.zeros(1)
    actors = Actors(
        0.0, ("struck",), at + 70.0, at + 3.2, at, at, at + 4.8, at + 2.0, at, at, at + 1.5, at.astype(np.int8)
    )
    ego = Pose(0.0, Point.REAR_AXLE, 10.0, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0, 0.0)
    path = by_tick(ways(90.0))[0]
    without, said = (lead_vehicle_now(ego, 10.0, actors, straight(), CAR, one) for one in (None, path))
    assert without.actor == [""]
    assert said.actor == ["struck"]
    afterwards = drive([STRUCK], ways(90.0)).strip_lead
    assert said.gap[0] == pytest.approx(afterwards.gap[0], abs=1e-9)
    assert said.time_to_collision[0] == pytest.approx(afterwards.time_to_collision[0], abs=1e-9)
