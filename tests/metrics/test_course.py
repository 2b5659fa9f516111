"""Where the ego goes on: arcs against integration and brute force, and a drive that leaves its path on purpose."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.metrics.tables import CAR, PERIOD, actors_of, drive_of, straight, ticks_of
from vve_sumo.metrics.braked_for import hardest_braking_for
from vve_sumo.metrics.course import MAX_ARC, MAX_DEVIATION, MAX_HEADING_ERROR, PredictedCourse, Starts, starts
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.path import ReferencePath
from vve_sumo.values import Floats

SPEED = 10.0  #: [m/s]
TRUCK = (72.0, 12.0, 2.5)  #: middle along the path, length, width [m]
AHEAD = CAR.rear_axle_to_bumper - CAR.length / 2.0  #: middle of the ego before its rear axle [m]


def one(x: float, y: float, heading: float, curvature: float, leaves: bool = True) -> Starts:
    return Starts(*(np.array([value]) for value in (x, x, y, heading, curvature)), np.array([leaves]), np.zeros(1, int))


ARCS = {
    "y": st.floats(-20.0, 20.0), "heading": st.floats(-3.0, 3.0),
    "curvature": st.floats(-0.2, 0.2) | st.sampled_from([0.0, 1e-12, -1e-9]),
}  # fmt: skip


@settings(deadline=None, max_examples=25)
@given(gone=st.floats(0.0, 15.0), **ARCS)
def test_an_arc_is_where_steps_of_constant_curvature_lead(
    y: float, heading: float, curvature: float, gone: float
) -> None:
    along = np.linspace(0.0, gone, 4_001)
    turned = heading + curvature * along
    x_end, y_end = 30.0 + np.trapezoid(np.cos(turned), along), y + np.trapezoid(np.sin(turned), along)
    start = one(30.0, y, heading, curvature)
    body = PredictedCourse(straight(), CAR, start).body(start, np.array([gone]), np.array([SPEED]))
    middle = x_end + AHEAD * math.cos(turned[-1]), y_end + AHEAD * math.sin(turned[-1])
    assert (body.x[0], body.y[0]) == pytest.approx(middle, abs=1e-6)
    assert body.heading[0] == pytest.approx(turned[-1], abs=1e-9)


@pytest.mark.thorough
@settings(deadline=None, max_examples=25)
@given(ahead=st.floats(0.0, 14.0), beside=st.floats(-3.0, 3.0), **ARCS)
def test_a_point_beside_an_arc_is_found_where_it_was_put(
    y: float, heading: float, curvature: float, ahead: float, beside: float
) -> None:
    along = np.linspace(0.0, ahead, 4_001)
    turned = heading + curvature * along
    foot = 30.0 + np.trapezoid(np.cos(turned), along), y + np.trapezoid(np.sin(turned), along)
    x, y_put = foot[0] - beside * math.sin(turned[-1]), foot[1] + beside * math.cos(turned[-1])
    start = one(30.0, y, heading, curvature)
    found = PredictedCourse(straight(), CAR, start).project(start, np.array([x]), np.array([y_put]), np.zeros(1))
    assert np.concatenate(found) == pytest.approx([ahead, beside], abs=1e-6)


def test_path_and_arc_join_where_the_car_drives_as_the_path_goes() -> None:
    """On a circle, at its radius and along it, both predict the same; a course ends after half a turn."""
    angle = np.linspace(0.0, 1.5 * math.pi, 200)
    path = ReferencePath.from_points(40.0 * np.sin(angle), 40.0 - 40.0 * np.cos(angle))
    s = 30.0
    x, y, heading = 40.0 * math.sin(s / 40.0), 40.0 - 40.0 * math.cos(s / 40.0), s / 40.0
    bodies = []
    for leaves in (False, True):
        start = one(x, y, heading, 1.0 / 40.0, leaves)._replace(s=np.array([s]))
        course = PredictedCourse(path, CAR, start)
        bodies.append(
            np.array([course.body(start, np.array([gone]), np.array([SPEED]))[:3] for gone in (0.0, 20.0, 70.0)])
        )
        expected = min(path.length - s, MAX_ARC * 40.0) if leaves else path.length - s
        assert course.end(start)[0] == pytest.approx(expected)
    np.testing.assert_allclose(*bodies, atol=2e-3)


@pytest.mark.parametrize(
    ("deviation", "error", "leaves"),
    [
        (0.99 * MAX_DEVIATION, 0.99 * MAX_HEADING_ERROR, False), (1.01 * MAX_DEVIATION, 0.0, True),
        (-1.01 * MAX_DEVIATION, 0.0, True), (0.0, -1.01 * MAX_HEADING_ERROR, True), (math.nan, 0.0, False),
        (0.0, math.tau, False),
    ],
)  # fmt: skip
def test_the_path_is_left_beyond_the_bounds(deviation: float, error: float, leaves: bool) -> None:
    values = (np.array([value]) for value in (50.0, 50.0, 0.0, 0.3 + error, SPEED, 0.2, 0.3, deviation))
    assert starts(*values).leaves[0] == leaves


def test_at_rest_the_arc_is_straight() -> None:
    rest, moving = (starts(*(np.array([v]) for v in (0, 0, 3, 0, v, w, 0, 3))) for v, w in ((0.0, 0.0), (5.0, 0.5)))
    assert rest.curvature[0] == 0.0
    assert moving.curvature[0] == pytest.approx(0.1)


def evasion(clearance: float, beside_the_truck: float = 0.0) -> tuple[DriveData, Floats, Floats, Floats]:
    """Return a drive around a truck that stands on the path, and the ego's x, y and heading.

    The ego goes over by 30 m to the left, passes the truck, and comes back. It brakes gently beside the truck.
    """
    time = np.arange(0.0, 16.0, PERIOD)
    brakes = (time > 7.4) & (time < 8.2)
    speed = SPEED - np.cumsum(np.where(brakes, beside_the_truck, 0.0)) * PERIOD
    x = np.concatenate(([0.0], np.cumsum(speed[:-1] * PERIOD)))
    over = TRUCK[2] / 2.0 + CAR.width / 2.0 + clearance
    first, last = TRUCK[0] - TRUCK[1] / 2.0 - CAR.rear_axle_to_bumper - 34.0, TRUCK[0] + TRUCK[1] / 2.0 + 4.0

    def step(share: Floats) -> Floats:
        u = np.clip(share, 0.0, 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    y = over * (step((x - first) / 30.0) - step((x - last) / 30.0))
    heading = np.arctan(np.gradient(y, x))
    ticks = [
        {"time_s": t, "true_x_m": a, "true_y_m": b, "true_heading_rad": h, "true_speed_mps": v, "s_m": a}
        | {"true_acceleration_mps2": -beside_the_truck if braked else 0.0}
        for t, a, b, h, v, braked in np.column_stack((time, x, y, heading, speed, brakes)).tolist()
    ]
    truck = {"actor": "truck", "x_m": TRUCK[0], "length_m": TRUCK[1], "width_m": TRUCK[2]}
    return drive_of(ticks_of(ticks), actors_of([truck | {"tick": tick} for tick in range(len(time))])), x, y, heading


def body(x: float, y: float, heading: float) -> shapely.Polygon:
    front, rear, half = CAR.rear_axle_to_bumper, CAR.rear_axle_to_bumper - CAR.length, CAR.width / 2.0
    box = shapely.affinity.rotate(shapely.box(rear, -half, front, half), heading, (0, 0), use_radians=True)
    return shapely.affinity.translate(box, x, y)


def test_who_steers_around_a_truck_had_no_gap_below_the_clearance() -> None:
    clearance = 1.01
    drive, x, y, heading = evasion(clearance, beside_the_truck=1.5)
    truck = shapely.box(TRUCK[0] - TRUCK[1] / 2.0, -TRUCK[2] / 2.0, TRUCK[0] + TRUCK[1] / 2.0, TRUCK[2] / 2.0)
    apart = np.array([shapely.distance(body(*place), truck) for place in zip(x, y, heading, strict=True)])
    assert apart.min() == pytest.approx(clearance, abs=1e-6)
    for lead in (drive.lead, drive.strip_lead):
        there = np.isfinite(lead.gap)
        assert there.any()
        assert (lead.gap >= apart - 1e-9)[there].all()
        assert np.nanmin(lead.gap) > 5.0
    # Beside the truck nothing is ahead, and on the way back neither.
    passed = x + CAR.rear_axle_to_bumper > TRUCK[0] - TRUCK[1] / 2.0
    assert np.isnan(drive.lead.gap[passed]).all()
    assert np.isnan(drive.conflict.time[passed]).all()
    assert np.nanmax(drive.conflict.deceleration) < 6.0
    assert hardest_braking_for(drive) == ""
    assert drive.course.starts.leaves.any()
    assert not drive.course.starts.leaves[[0, -1]].any()
