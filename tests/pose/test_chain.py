"""From a true pose to NCOM bytes and back through decoder, gate and placement: every sign and unit at once."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement, wrap_angle
from vve_sumo.pose.ncom import Decoder, Encoder
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Point, Pose

EPOCH = 1_300_000_010.0
LOT = "+proj=tmerc +lat_0=40.31 +lon_0=-83.55 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
UTM17 = "+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
QUALITY = {"status": 4, "position_mode": 6, "position_sigma": 0.01, "velocity_sigma": 0.02}
QUALITY |= {"heading_sigma": 0.001, "differential_age": 1.0, "altitude": 250.0}


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
