"""From a true pose to NCOM bytes and back through decoder, gate and placement: every sign and unit at once."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.drive.street import altered
from vve_sumo.controller import Guarded
from vve_sumo.drive.assembly import sensors_of
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement, wrap_angle
from vve_sumo.pose.dating import FixDater
from vve_sumo.pose.ncom import Decoder, Encoder, pack
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Actors, ControlCommand, FixQuality, Observation, Point, Pose

EPOCH = 1_300_000_010.0
LOT = "+proj=tmerc +lat_0=40.31 +lon_0=-83.55 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
UTM17 = "+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
QUALITY = {"locked": True, "quality": FixQuality.RTK_FIXED, "position_sigma": 0.01, "velocity_sigma": 0.02}
QUALITY |= {"heading_sigma": 0.001, "differential_age": 1.0, "altitude": 250.0}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("projection", "offset"), [(LOT, (0.0, 0.0)), (UTM17, (-283_200.0, -4_465_400.0))])
@pytest.mark.parametrize("left", [True, False])
def test_a_circle_comes_back_as_it_was_driven(projection, offset, left):
    """70 s at 6 m/s on a radius of 15 m: a minute wrap, four heading wraps, every packet trusted and placed."""
    speed, radius = 6.0, 15.0 if left else -15.0
    rate = speed / radius
    placement = Placement(
        MapFrame(projection, offset), Alignment(0.8, 400.0, 300.0), Mounting(1.3, 0.2, math.radians(0.5)), EPOCH
    )
    encoder, decoder, gate, placed = Encoder(), Decoder(), TrustGate(DRIVE, EPOCH), 0
    for k in range(7000):
        time = 0.01 * k
        angle = rate * time
        x, y = 420.0 + radius * math.sin(angle), 310.0 - radius * math.cos(angle)
        true = Pose(time, Point.REAR_AXLE, x, y, wrap_angle(angle), speed, 0.0, rate, 0.0, 0.01)
        packet = encoder.encode(replace(placement.unplace(true), **QUALITY))
        (fix,) = decoder.feed(packet, time + 0.02)
        trust = gate.step(time + 0.02, fix)
        assert trust.trusted or k < 4, trust.reasons
        pose = placement.place(fix)
        placed += trust.trusted
        assert abs(pose.time - time) < 1e-6
        assert math.hypot(pose.x - x, pose.y - y) < 1e-4
        assert abs(wrap_angle(pose.heading - angle)) < 2e-6
        assert (pose.speed, pose.lateral_speed) == pytest.approx((speed, 0.0), abs=2e-4)
        assert (pose.yaw_rate, pose.acceleration, pose.grade) == pytest.approx((rate, 0.0, 0.01), abs=2e-4)
    assert placed == 6996


class _Straight:
    def step(self, observation: Observation) -> ControlCommand:
        return ControlCommand(0.0, 0.0)


def predicted(lies: dict[int, float]) -> tuple[list[tuple[float, float]], list[tuple[str, ...]]]:
    """Where the pipeline of a live drive believes the car to be, every 10 ms, while fixes that lie come among the true.

    `lies` says by how much one lies that arrives just before the true fix of a number: dated ahead, and 30 m north.
    """
    resolved = altered({})
    frame, speed = MapFrame(LOT), 10.0
    placement = Placement(frame, Alignment(), Mounting(0.0, 0.0), EPOCH)
    pipeline = Pipeline(
        decoder=Decoder(),
        gate=TrustGate(DRIVE, EPOCH),
        placement=placement,
        predictor=Predictor(),
        sensors=sensors_of(resolved),
        controller=Guarded(_Straight()),
        vehicle=resolved.vehicle,
        path=resolved.path,
        desired_speed=speed,
        dater=FixDater(0.01, EPOCH),
        epoch=EPOCH,
    )
    encoder, places, refused = Encoder(), [], []
    for k in range(1500):
        time = 0.01 * k
        true = Pose(time, Point.REAR_AXLE, speed * time, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0)
        fix = replace(placement.unplace(true), **QUALITY)
        if k in lies:
            wrong = replace(fix, time=fix.time + lies[k], latitude=fix.latitude + 30.0 / 6_371_000.0)
            pipeline.receive(time + 0.0095, pack(wrong, 16, bytes(8)))
        pipeline.receive(time + 0.01, encoder.encode(fix))
        pipeline.see(time + 0.01, Actors.none(time))
        decided = pipeline.decide(k, time + 0.01, 0.0)
        pose = pipeline.front_bumper_at(time + 0.01)
        if pose is not None:
            places.append((pose.x, pose.y))
        refused.append(decided.pose_reasons)
    return places, refused


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("ahead", [0.01, 0.5, 12.0])
def test_fixes_dated_ahead_displace_and_move_nothing(ahead):
    """One every 10 ms for nine seconds: each would have made a true one too old."""
    alone, _ = predicted({})
    among, refused = predicted(dict.fromkeys(range(500, 1400), ahead + 0.0005))
    assert among == alone
    assert set(refused[500:]) == {()}
