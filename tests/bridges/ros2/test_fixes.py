"""Fixes made of NavSatFix, Imu and Odometry: against the values that the messages were made of, and every refusal."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from vve_sumo.bridges.ros2.fixes import (
    ALONE,
    FIX,
    IMU,
    MALFORMED,
    NO_ORIENTATION,
    NOT_FINITE,
    NOT_NEWER,
    ODOM,
    SECOND,
    FixAssembler,
)
from vve_sumo.drive.brain import virtual_placement
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.pose.ncom import Decoder, Encoder
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Fix, FixQuality, Point, Pose
from vve_sumo.wire.ros2 import messages
from vve_sumo.wire.ros2.messages import unix_nanoseconds

EPOCH = 1_451_260_818.0
FRAME = MapFrame("+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs")
MOUNTING = Mounting(0.9, -0.35)
PLACEMENT = virtual_placement(FRAME, MOUNTING, EPOCH)
RADIUS, SPEED, CORRECTIONS = 40.0, 8.0, 5.0
Messages = dict[str, Any]  # by type


def _true(now: float) -> tuple[Pose, Fix]:
    """Return pose and fix of a car on a circle to the left at a time."""
    turned = SPEED * now / RADIUS
    x, y = 329_000.0 + RADIUS * math.sin(turned), 4_428_000.0 + RADIUS * (1.0 - math.cos(turned))
    pose = Pose(now, Point.REAR_AXLE, x, y, turned, SPEED, 0.0, SPEED / RADIUS, 0.0, 0.0)
    fix = PLACEMENT.unplace(pose)
    changes: dict[str, Any] = {
        "altitude": 230.0, "roll": 0.02, "pitch": -0.03, "locked": True, "quality": FixQuality.RTK_FIXED,
        "position_sigma": 0.02, "velocity_sigma": 0.03, "heading_sigma": 0.002, "differential_age": CORRECTIONS,
    }  # fmt: skip
    return pose, Fix(**({name: getattr(fix, name) for name in Fix.__slots__} | changes))


def true_fix(now: float) -> Fix:
    """Return the fix of the car at a time."""
    return _true(now)[1]


def good_messages(now: float) -> Messages:
    """Return the messages of a time, all of them good."""
    pose, fix = _true(now)
    at = unix_nanoseconds(EPOCH + now)
    return {IMU: messages.imu(at, fix), ODOM: messages.odometry(at, pose, fix), FIX: messages.nav_sat_fix(at, fix)}


def _taken(assembler: FixAssembler, sent: Messages) -> Fix | None:
    return [
        assembler.take(kind, number, copy.deepcopy(message)) for number, (kind, message) in enumerate(sent.items())
    ][-1]


def _assembler() -> FixAssembler:
    return FixAssembler(MOUNTING, CORRECTIONS)


@given(st.floats(0.0, 60.0))
def test_a_fix_is_the_one_that_the_messages_were_made_of(now: float) -> None:
    got, (_, wanted) = _taken(_assembler(), good_messages(now)), _true(now)
    assert got is not None
    assert abs(got.time - wanted.time) < 2e-6
    for name in Fix.__slots__:
        if name not in ("time", "time_received", "velocity_down"):
            assert getattr(got, name) == pytest.approx(getattr(wanted, name), abs=1e-9), name
    assert math.isnan(got.velocity_down)


@pytest.mark.parametrize("order", [(IMU, ODOM, FIX), (FIX, IMU, ODOM), (ODOM, FIX, IMU)])
def test_the_order_of_the_messages_does_not_matter(order: tuple[str, ...]) -> None:
    assembler, sent = _assembler(), good_messages(3.0)
    made = [assembler.take(kind, order.index(kind), sent[kind]) for kind in order]
    assert made[:2] == [None, None]
    assert made[2] is not None
    assert (assembler.made, dict(assembler.refused)) == (1, {})


def test_the_heading_is_turned_on_from_an_earlier_imu() -> None:
    earlier, now = good_messages(2.985), good_messages(3.0)
    got = _taken(_assembler(), {IMU: earlier[IMU], ODOM: now[ODOM], FIX: now[FIX]})
    assert got is not None
    assert got.heading == pytest.approx(_true(3.0)[1].heading, abs=1e-7)


@pytest.mark.parametrize("missing", [IMU, ODOM])
def test_a_fix_without_the_others_of_its_time_is_none(missing: str) -> None:
    assembler = _assembler()
    assert _taken(assembler, good_messages(2.9) | {FIX: good_messages(3.0)[FIX]}) is None
    sent = {kind: message for kind, message in good_messages(3.1).items() if kind != missing}
    numbers = {IMU: 0, ODOM: 1, FIX: 2}
    assert all(assembler.take(kind, numbers[kind], message) is None for kind, message in sent.items())
    assert assembler.made == 0
    assert assembler.refused[ALONE] == 1


def _longitude_beyond(sent: Messages) -> None:
    sent[FIX].longitude = 181.0


def _altitude_beyond(sent: Messages) -> None:
    sent[FIX].altitude = 1e300


def _nan_latitude(sent: Messages) -> None:
    sent[FIX].latitude = math.nan


def _nan_speed(sent: Messages) -> None:
    sent[ODOM].twist.twist.linear.x = math.nan


def _nan_yaw_rate(sent: Messages) -> None:
    sent[IMU].angular_velocity.z = math.inf


def _no_quaternion(sent: Messages) -> None:
    sent[IMU].orientation.w = sent[IMU].orientation.z = 0.0


def _no_orientation(sent: Messages) -> None:
    sent[IMU].orientation_covariance[0] = -1.0


def _no_yaw_rate(sent: Messages) -> None:
    sent[IMU].angular_velocity_covariance[0] = -1.0


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (_nan_latitude, NOT_FINITE),
        (_longitude_beyond, NOT_FINITE),
        (_altitude_beyond, NOT_FINITE),
        (_nan_speed, NOT_FINITE),
        (_nan_yaw_rate, NOT_FINITE),
        (_no_quaternion, NOT_FINITE),
        (_no_yaw_rate, NOT_FINITE),
        (_no_orientation, NO_ORIENTATION),
    ],
)
def test_what_is_no_number_makes_no_fix(spoil: Callable[[Messages], None], reason: str) -> None:
    assembler, sent = _assembler(), good_messages(3.0)
    spoil(sent)
    assert _taken(assembler, sent) is None
    assert assembler.refused[reason] == 1
    assert _taken(assembler, good_messages(3.05)) is not None  # the next one is whole


def test_a_stamp_that_is_not_newer_makes_no_fix() -> None:
    assembler = _assembler()
    assert _taken(assembler, good_messages(3.0)) is not None
    assert _taken(assembler, good_messages(3.0)) is None
    assert _taken(assembler, good_messages(2.9)) is None
    assert assembler.refused[NOT_NEWER] == 2


@pytest.mark.parametrize("kind", [IMU, ODOM, FIX])
def test_from_a_second_publisher_on_no_fix_is_made(kind: str) -> None:
    assembler, sent = _assembler(), good_messages(3.0)
    assert _taken(assembler, sent) is not None
    assert assembler.take(kind, 7, sent[kind]) is None
    assert _taken(assembler, good_messages(3.05)) is None
    assert assembler.silenced
    assert assembler.refused[SECOND] == 4


def test_bytes_that_are_no_message_are_counted() -> None:
    assembler = _assembler()
    assert assembler.take(FIX, 0, None) is None
    assert dict(assembler.refused) == {MALFORMED: 1}


def _unknown_place(sent: Messages) -> None:
    sent[FIX].position_covariance_type = 0


def _unknown_heading(sent: Messages) -> None:
    sent[IMU].orientation_covariance[8] = 0.0


def _unknown_speed(sent: Messages) -> None:
    sent[ODOM].twist.covariance = np.zeros(36)


def _float_solution(sent: Messages) -> None:
    sent[FIX].position_covariance = np.diag([0.2**2, 0.2**2, 1.0]).ravel()


def _satellites_corrections(sent: Messages) -> None:
    sent[FIX].status.status = 1


def _no_fix(sent: Messages) -> None:
    sent[FIX].status.status = -1


@pytest.mark.parametrize(
    "spoil",
    [_unknown_place, _unknown_heading, _unknown_speed, _float_solution, _satellites_corrections, _no_fix],
)
def test_the_drives_gate_trusts_what_is_good_and_nothing_else_from_the_first_message_on(
    spoil: Callable[[Messages], None],
) -> None:
    assembler, encoder, decoder, gate = _assembler(), Encoder(), Decoder(), TrustGate(DRIVE, EPOCH)
    trusted = []
    for number in range(80):
        sent = good_messages(0.05 * number)
        if number >= 60:
            spoil(sent)
        fix = _taken(assembler, sent)
        assert fix is not None
        now = 0.05 * number + 0.03
        (decoded,) = decoder.feed(encoder.encode(fix), now) or (None,)
        trusted.append(decoded is not None and gate.step(now, decoded).trusted)
    assert all(trusted[30:60])
    assert not any(trusted[60:])
