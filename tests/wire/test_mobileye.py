"""A Mobileye's obstacle frames: the vectors that Apollo publishes, cantools, and what a list becomes."""

from __future__ import annotations

import math
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo import dbc
from vve_sumo.body_kinds import BODY_KINDS, number_of
from vve_sumo.sensors.camera import no_objects
from vve_sumo.values import CameraObjects, Frame
from vve_sumo.wire import mobileye
from vve_sumo.wire.mobileye import MAX_OBSTACLES, STATUS, TYPES, MobileyeEncoder, ObstacleStatus

FILE = Path(mobileye.__file__).with_name("mobileye.dbc")
OURS, THEIRS = dbc.read(FILE), cantools.database.load_file(FILE)


def objects(
    *rows: tuple[int, str, int, float, float, float, float, float], lane: tuple[float, float] | None = None
) -> CameraObjects:
    """Rows of number, kind, status, x, y, relative speed, width, length."""
    number, kind, status, *floats = zip(*rows, strict=True) if rows else ((),) * 8
    return CameraObjects(
        1.0, np.array(number, np.int64), np.array([number_of(one) for one in kind], np.int8),
        np.array(status, np.int8), *(np.array(column, np.float64) for column in floats),
        lane is not None, *(lane or (0.0, 0.0)),
    )  # fmt: skip


def read(frames: tuple[Frame, ...]) -> list[dict[str, float]]:
    """Each obstacle's signals, as cantools reads them."""
    found: list[dict[str, float]] = []
    for frame in frames[1:]:
        place, part = divmod(frame.id - 0x739, 3)
        signals = THEIRS.decode_message(0x739 + part, frame.data, decode_choices=False)
        found += [{}] * (place + 1 - len(found))
        found[place] = found[place] | signals  # type: ignore[operator]
    return found


@pytest.mark.parametrize(
    ("message", "data", "expected"),
    [
        ("ObstacleA", "0180014002003003", {"ID": 1, "POSITION_X": 24.0, "POSITION_Y": -28.0, "TYPE": 3, "STATUS": 3}),
        ("ObstacleB", "1184030000000000", {"LENGTH": 8.5, "WIDTH": 6.6, "AGE": 3}),
        ("ObstacleC", "0000000000003007", {"ANGLE": 18.40}),
    ],
)
def test_apollo_s_vectors(message: str, data: str, expected: dict[str, float]) -> None:
    """Published with Apollo's parser (modules/drivers/mobileye/protocol, Apache-2.0)."""
    found = OURS[message].decode(bytes.fromhex(data))
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert OURS[message].encode(**expected) == bytes.fromhex(data)


def test_a_list_becomes_obstacles_that_cantools_reads() -> None:
    seen = objects(
        (7, "pedestrian", 3, 25.0, -3.0, -6.5, 0.5, 0.5),
        (3, "truck", 4, 61.03, 3.52, -21.2, 2.5, 9.0),
        (9, "car", 2, 12.0, 0.4, -9.0, 1.8, 4.5),
        lane=(1.7, 1.5),
    )
    frames = MobileyeEncoder().encode(seen, 1000.007)
    status = THEIRS.decode_message(STATUS, frames[0].data)
    assert (frames[0].id, status["NUMBER_OF_OBSTACLES"], status["FAILSAFE"]) == (0x738, 3, 0)
    assert status["TIMESTAMP"] == 1_000_007 % 256
    assert [frame.id for frame in frames[1:]] == list(range(0x739, 0x742))
    near, middle, far = read(frames)
    assert (near["ID"], near["TYPE"], near["STATUS"], near["CLOSEST_IN_PATH"], near["LANE"]) == (9, 0, 2, 1, 1)
    assert (middle["ID"], middle["TYPE"], middle["STATUS"], middle["CLOSEST_IN_PATH"], middle["LANE"]) == (
        7,
        3,
        3,
        0,
        2,
    )
    assert (far["POSITION_X"], far["POSITION_Y"]) == pytest.approx((61.03, 3.52), abs=0.04)
    assert (far["RELATIVE_SPEED"], far["WIDTH"], far["LENGTH"]) == pytest.approx((-21.2, 2.5, 9.0), abs=0.04)
    assert middle["ANGLE"] == pytest.approx(math.degrees(math.atan2(-3.0, 25.0)), abs=0.01)


def test_an_object_is_new_once_and_ages() -> None:
    encoder = MobileyeEncoder()
    one, two = objects((1, "car", 3, 20.0, 0.0, 0.0, 1.8, 4.5)), objects((2, "car", 3, 20.0, 0.0, 0.0, 1.8, 4.5))
    aged = [
        (found["VALID"], found["AGE"]) for seen in (one, one, two, one) for found in read(encoder.encode(seen, 0.0))
    ]
    assert aged == [(1, 1), (2, 2), (1, 1), (1, 1)]
    for _ in range(300):
        frames = encoder.encode(one, 0.0)
    assert read(frames)[0]["AGE"] == 255


def test_the_nearest_ten_are_sent() -> None:
    many = objects(*((n, "car", 3, 100.0 - 5.0 * n, 0.0, 0.0, 1.8, 4.5) for n in range(14)))
    frames = MobileyeEncoder().encode(many, 0.0)
    assert [found["ID"] for found in read(frames)] == list(range(13, 13 - MAX_OBSTACLES, -1))
    assert frames[-1].id == 0x756


def test_a_failed_camera_and_an_empty_road_are_two_things() -> None:
    (failed,), (empty,) = (MobileyeEncoder().encode(seen, 0.0) for seen in (None, no_objects(1.0)))
    assert [THEIRS.decode_message(STATUS, frame.data)["FAILSAFE"] for frame in (failed, empty)] == [1, 0]


def test_without_lanes_nothing_is_in_one() -> None:
    (found,) = read(MobileyeEncoder().encode(objects((1, "car", 3, 20.0, 0.0, 0.0, 1.8, 4.5)), 0.0))
    assert (found["LANE"], found["CLOSEST_IN_PATH"]) == (0, 0)


def test_every_kind_and_status_has_its_number() -> None:
    assert TYPES.keys() == set(BODY_KINDS)
    assert OURS["ObstacleA"].signals["STATUS"].choices == {status.value: status.name for status in ObstacleStatus}
    assert OURS["ObstacleA"].signals["TYPE"].choices == {kind.value: kind.name for kind in mobileye.ObstacleType}
    assert OURS["ObstacleB"].signals["LANE"].choices == {lane.value: lane.name for lane in mobileye.Lane}


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 1e6))
def test_what_a_signal_cannot_carry_saturates(x: float, y: float, speed: float, width: float) -> None:
    (found,) = read(MobileyeEncoder().encode(objects((1, "car", 3, x, y, speed, width, 4.5)), 0.0))
    assert found["POSITION_X"] == pytest.approx(min(max(x, 0.0), 255.9375), abs=0.04)
    assert found["POSITION_Y"] == pytest.approx(min(max(y, -32.0), 31.9375), abs=0.04)
    assert found["RELATIVE_SPEED"] == pytest.approx(min(max(speed, -128.0), 127.9375), abs=0.04)
    assert found["WIDTH"] == pytest.approx(min(width, 12.75), abs=0.03)


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        MobileyeEncoder().encode(objects((1, "car", 3, math.nan, 0.0, 0.0, 1.8, 4.5)), 0.0)


def test_a_list_is_read_back_and_what_is_no_whole_frame_of_it_says_nothing() -> None:
    frames = MobileyeEncoder().encode(objects((1, "car", 1, 20.0, -3.0, 0.0, 1.8, 4.5)), 12.345)
    status = mobileye.decode_status(frames[0])
    assert status == mobileye.CameraStatus(1, 12345 % 256, failed=False)
    (found,) = [one for frame in frames if (one := mobileye.decode_obstacle(frame)) is not None]
    assert (found.x, found.y) == pytest.approx((20.0, -3.0), abs=0.04)
    failed = mobileye.decode_status(mobileye.with_failure(frames[0]))
    assert failed is not None
    assert failed.failed
    assert [mobileye.with_failure(frame) for frame in frames[1:]] == list(frames[1:])
    for length in range(8):
        assert mobileye.decode_status(frames[0]._replace(data=frames[0].data[:length])) is None
        assert mobileye.decode_obstacle(frames[1]._replace(data=frames[1].data[:length])) is None
    assert mobileye.decode_status(frames[1]) is None
    assert mobileye.decode_obstacle(frames[0]) is None
