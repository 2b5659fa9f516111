"""A receiver that drifts slowly, in the whole loop."""

from __future__ import annotations

import math
from functools import partial

import pytest

from tests import vehicles
from tests.vehicle.closed_loop import ClosedLoop, came_of, straight
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.lot.geofence import Geofence
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.values import ControlCommand, FallbackPath, Observation, Pose
from vve_sumo.vehicle.drift import unseen_drift

AT = 16.0  #: of the fault, after the first motion: the car has driven more than 100 m at 8 m/s by then [s]


@pytest.mark.thorough
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
