"""A receiver that drifts slowly: against brute force, and in the whole loop."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests import vehicles
from tests.vehicle.closed_loop import ClosedLoop, came_of, straight
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.lot.geofence import Geofence
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.values import ControlCommand, FallbackPath, Observation, Pose
from vve_sumo.vehicle.drift import DriftCheck, FeasibleSet, Sample, unseen_drift

AT = 16.0  #: of the fault, after the first motion: the car has driven more than 100 m at 8 m/s by then [s]


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**31), st.integers(1, 12))
def test_what_is_left_to_explain_is_what_a_linear_programme_finds(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    feasible, rows, bounds = FeasibleSet(1.0, 2.0), [], []
    for _ in range(count):
        p, q, difference = random.uniform(-3.0, 3.0, 3)
        allowed = random.uniform(0.1, 3.0)
        rows += [(p, q, -1.0), (-p, -q, -1.0)]
        bounds += [difference + allowed, allowed - difference]
        # The least slack with which every difference is explained; close calls are left to rounding.
        answer = linprog((0, 0, 1), A_ub=rows, b_ub=bounds, bounds=[(-1, 1), (-2, 2), (None, None)])
        assert answer.fun is not None
        slack = float(answer.fun)
        explained = feasible.explain(difference, p, q, allowed)
        if abs(slack) > 1e-9:
            assert explained is (slack < 0.0)
        if not explained:
            break


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", Sample._fields)
def test_a_sample_that_is_not_finite_is_not_explained(field: str, bad: float) -> None:
    check = DriftCheck(0.0075, 0.02)
    assert check.explain(Sample(0.0, 0.0, 0.0, 5.0, 5.0, 0.0))
    assert not check.explain(Sample(0.5, 0.0, 0.0, 5.0, 5.0, 0.5)._replace(**{field: bad}))
    assert check.explain(Sample(9.0, 9.0, 0.0, 5.0, 5.0, 0.5)), "and the way begins anew"


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("rate", [0.02, 0.05, 0.1, 0.3])
def test_no_drift_after_the_first_hundred_metres_grows_beyond_what_is_said(rate: float, side: int, sign: float) -> None:
    """At 8 m/s, a misaligned receiver and wheels that are half their tolerance wrong; the drift begins at 100 m."""
    check = DriftCheck(0.0075, 0.02)
    for tick in range(1200):
        way = 0.8 * tick
        off = sign * rate * max(way - 100.0, 0.0) / 8.0
        moved = (way + off, 0.0035 * way) if side == 0 else (way, 0.0035 * way + off)
        if not check.explain(Sample(*moved, 0.0, 8.0, 7.92, 0.99 * way)):
            break
        assert abs(off) <= unseen_drift(way)


@pytest.mark.parametrize(
    ("kind", "value"), [("pose_drift_lateral", 0.07), ("pose_drift_lateral", -0.07), ("pose_drift_along", 0.1)]
)
def test_a_slow_drift_with_agreeing_velocity_stops_the_car_before_it_is_larger_than_said(
    kind: str, value: float
) -> None:
    loop = ClosedLoop(
        straight(700.0),
        8.0,
        [InjectedFault(kind, AT, 3600.0, value)],
        vehicles.parameters(heading_misalignment=math.radians(0.2)),
    )
    came = came_of(loop, AT, 30.0)
    assert came.reasons[0] == "position_mismatch"
    assert abs(value) * came.noticed <= unseen_drift(8.0 * (AT + came.noticed))


class Listening(Geofence):
    """A geofence that never objects, and notes the way that it is told."""

    def __init__(self) -> None:
        self.ways: list[float] = []

    def check(
        self,
        pose: Pose,
        steering: float,
        profile: FallbackPath | None,
        driven: float = 0.0,
        requested: tuple[float, float] | None = None,
    ) -> tuple[str, ...]:
        self.ways.append(driven)
        return ()


class Weaving:
    """Swings the wheel to and fro, so that the car drives farther than it comes along the path."""

    def step(self, observation: Observation) -> ControlCommand:
        return ControlCommand(0.5 * math.sin(0.9 * observation.time), 0.5 if observation.pose.speed < 4.0 else 0.0)


def test_the_geofence_hears_the_way_driven_and_not_only_the_way_along_the_path() -> None:
    fence = Listening()
    loop = ClosedLoop(straight(), 4.0, controller=Weaving(), pipeline=partial(Pipeline, geofence=fence))  # type: ignore[arg-type]
    way, last = 0.0, loop.car.truth()
    for ticked in loop.ticks():
        way += math.hypot(ticked.truth.x - last.x, ticked.truth.y - last.y)
        last = ticked.truth
        if ticked.now > 20.0:
            break
    assert way > last.x + 5.0, "it would tell nothing"
    assert fence.ways[-1] == pytest.approx(way, rel=0.02)
