"""Long bodies in bends: where SUMO put them, and when they meet the ego, against circles and shapely."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
import shapely

from tests.drive.street import recorded
from tests.exhaustive import with_slow
from tests.metrics.tables import CAR, PERIOD, actors_of, straight, ticks_of
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.contact import Pairs, Prediction
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lanes import fronts
from vve_sumo.values import Floats

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "drive"

LONG = 8.0  #: a body from this length on is long [m]
RADIUS, LENGTH, WIDTH = 12.0, 12.2, 2.5  #: of the lane's bend and of the bus [m]
CENTRE = (60.0, 14.0)  #: of the bend, which turns left; its lowest point is 2 m left of the ego's path
STEP = 0.01  #: of the brute force [s]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> DriveData:
    return Run(recorded(tmp_path_factory, {}, tmp_path_factory.mktemp("drive") / "record")).data


@pytest.mark.thorough
def test_a_long_vehicle_is_predicted_where_sumo_then_puts_it(drive: DriveData) -> None:
    """The bus of the paper's street turns right by 105 degrees: its front's way is given, its body is SUMO's."""
    actors, (ways, places) = drive.actor_rows, drive.predicted
    boxes, ends = actors.boxes, fronts(actors.boxes)
    prediction = Prediction(drive.course, ways)
    turned, errors = [0.0], [0.0]
    for code in np.unique(actors.code[boxes.length >= LONG]):
        rows = np.flatnonzero(actors.code == code)
        rows = rows[np.argsort(actors.at[rows])]
        gone = np.append(0.0, np.cumsum(np.hypot(np.diff(ends.x[rows]), np.diff(ends.y[rows]))))
        for now, later in ((i, i + ticks) for ticks in (25, 75, 150) for i in range(0, len(rows) - ticks, 10)):
            one, other = rows[[now]], rows[[later]]
            if places.chord[one[0]] == 0.0 or actors.at[other[0]] - actors.at[one[0]] != later - now:
                continue
            moved, zero = gone[[later]] - gone[[now]], np.zeros(1)
            pairs = Pairs(
                drive.course.starts.select(zero.astype(np.int64)), zero, places.select(one), moved,
                boxes.length[one], boxes.width[one], zero, zero + 1.0,
            )  # fmt: skip
            predicted, true = prediction.other(pairs, zero + 1.0).corners(), boxes.select(other).corners()
            errors.append(float(np.hypot(predicted[0] - true[0], predicted[1] - true[1]).max()))
            turned.append(abs(float(boxes.heading[other[0]] - boxes.heading[one[0]])))
    assert len(errors) > 200
    assert max(turned) > 1.4
    # The lanes' lines have corners, between samples 1 m apart.
    assert max(errors) < 0.2


def test_the_bus_that_turns_off_beside_the_ego_is_no_conflict(drive: DriveData) -> None:
    """It keeps 0.9 m and more: with its middle on its lane it cut the corner, and met the ego in 0.5 s."""
    actors, found = drive.actor_rows, drive.contacts
    long = actors.boxes.length >= LONG
    bodies, egos = (
        shapely.polygons(np.stack(boxes.corners(), axis=2).swapaxes(0, 1))
        for boxes in (actors.boxes.select(long), drive.ego_boxes.select(actors.at[long]))
    )
    apart = shapely.distance(bodies, egos)
    assert 0.5 < apart.min() < 2.0
    assert np.nanmin(found.time[long], initial=math.inf) > 2.0


def bend() -> pa.Table:
    """A lane around the bend, from the direction of the ego's path, begun straight 60 m before."""
    angle = np.linspace(-math.pi / 2, math.pi, 600)
    x, y = CENTRE[0] + RADIUS * np.cos(angle), CENTRE[1] + RADIUS * np.sin(angle)
    x, y = np.append(CENTRE[0] - 60.0, x), np.append(CENTRE[1] - RADIUS, y)
    row = {"lane": "bend_0", "kind": "lane", "width_m": 3.2, "x_m": x.tolist(), "y_m": y.tolist(), "successors": []}
    return pa.Table.from_pylist([row])


def on_line(gone: Floats, aside: float) -> tuple[Floats, Floats]:
    """Points beside the bend's lane (left positive), by arc length from where the lane begins to turn [m]."""
    angle = -math.pi / 2 + np.maximum(gone, 0.0) / RADIUS
    straight_on, radius = np.minimum(gone, 0.0), RADIUS - aside
    return CENTRE[0] + radius * np.cos(angle) + straight_on, CENTRE[1] + radius * np.sin(angle)


def bus(front: Floats, aside: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Middle and heading of a bus whose front has gone so far on the lane: its rear is on the lane, a length behind."""
    (front_x, front_y), (rear_x, rear_y) = on_line(front, aside), on_line(front - LENGTH, aside)
    heading = np.arctan2(front_y - rear_y, front_x - rear_x)
    return front_x - 0.5 * LENGTH * np.cos(heading), front_y - 0.5 * LENGTH * np.sin(heading), heading


def polygons(x: Floats, y: Floats, heading: Floats, length: float, width: float) -> shapely.Geometry:
    along = np.array([1, -1, -1, 1]) * length / 2.0
    across = np.array([1, 1, -1, -1]) * width / 2.0
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return shapely.polygons(
        np.stack((x[:, None] + along * cos - across * sin, y[:, None] + along * sin + across * cos), 2)
    )


def scene(ego_s: float, speed: float, front: float, other: float, aside: float) -> DriveData:
    """A drive whose first tick is judged, and a bus that is seen for another 2 s."""
    x, y, heading = bus(front + other * PERIOD * np.arange(100.0), aside)
    unknown = {"true_x_m": math.nan, "x_m": math.nan, "s_m": math.nan}
    ego = [{"time_s": PERIOD * i, **unknown} for i in range(len(x))]
    ego[0] = {"true_x_m": ego_s, "s_m": ego_s, "true_speed_mps": speed}
    actors = [
        {"tick": i, "actor": "bus", "x_m": x[i], "y_m": y[i], "heading_rad": heading[i], "speed_mps": other}
        | {"length_m": LENGTH, "width_m": WIDTH}
        for i in range(len(x))
    ]
    return DriveData(ticks_of(ego), actors_of(actors), straight(), CAR, PERIOD, bend())


@pytest.mark.thorough
@pytest.mark.parametrize("seed", with_slow(range(2), lambda seed: seed == 0))
def test_contact_with_a_bus_in_a_bend_is_when_brute_force_has_it(seed: int) -> None:
    """The ego on y = 0 and the bus on a lane 2 m beside it that turns away: its rear may swing into the ego's way."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 4.0, STEP)
    found, clear = 0, 0
    for _ in range(200):
        ego_s, speed = random.uniform(20.0, 60.0), random.uniform(0.0, 15.0)
        front, other, aside = random.uniform(-20.0, 25.0), random.uniform(1.0, 10.0), random.uniform(-1.5, 1.0)
        drive = scene(ego_s, speed, front, other, aside)
        assert drive.predicted.places.chord[0] == LENGTH
        x, y, heading = bus(front + other * time, aside)
        bodies = polygons(x, y, heading, LENGTH, WIDTH)
        ego_x = ego_s + speed * time + CAR.rear_axle_to_bumper - CAR.length / 2.0
        ego = polygons(ego_x, np.zeros(len(time)), np.zeros(len(time)), CAR.length, CAR.width)
        apart, met = shapely.distance(ego, bodies), drive.contacts.time[0]
        touches = np.flatnonzero(apart <= 0.0)
        if not len(touches) and apart.min() > 0.05:
            assert not met < 4.0
            clear += 1
        elif len(touches) and touches[0] > 0 and shapely.area(shapely.intersection(ego, bodies)).max() > 0.1:
            first = touches[0]
            if x[first] > ego_x[first] - CAR.length / 2.0:  # else the bus runs into the ego's rear
                assert met == pytest.approx(time[first], abs=0.05)
                found += 1
    assert found >= 5
    assert clear >= 10


def test_the_oracles_bus_is_a_chord_of_its_circle() -> None:
    """On a circle the middle of a chord is nearer to its centre by the sagitta, and the body is along the chord."""
    front = np.array([LENGTH, 20.0, 30.0])
    x, y, heading = bus(front)
    half = 0.5 * LENGTH / RADIUS
    toward = np.hypot(x - CENTRE[0], y - CENTRE[1])
    expected = math.hypot(RADIUS * math.cos(half), RADIUS * math.sin(half) - 0.5 * LENGTH)
    np.testing.assert_allclose(toward, expected, rtol=1e-12)
    np.testing.assert_allclose(heading, (front - 0.5 * LENGTH) / RADIUS, rtol=1e-12)
