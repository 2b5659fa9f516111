"""ARS408 frames against the arithmetic that public drivers of the sensor read them with, written down independently."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.values import Frame
from vve_sumo.wire import ars408

OBJECTS = st.builds(
    ars408.Object,
    number=st.integers(0, 255),
    longitudinal=st.floats(-400.0, 1000.0),
    lateral=st.floats(-204.0, 204.0),
    longitudinal_speed=st.floats(-127.0, 127.0),
    lateral_speed=st.floats(-63.0, 63.0),
    motion=st.sampled_from(ars408.Motion),
    cross_section=st.floats(-64.0, 63.0),
    existence=st.sampled_from(ars408.EXISTENCE),
    measurement=st.sampled_from(ars408.Measurement),
    kind=st.sampled_from(ars408.Kind),
    orientation=st.floats(-math.pi, math.pi),
    length=st.floats(0.0, 51.0),
    width=st.floats(0.0, 51.0),
)
LISTS = st.builds(
    ars408.ObjectList,
    counter=st.integers(0, ars408.COUNTS - 1),
    objects=st.lists(OBJECTS, max_size=12, unique_by=lambda one: one.number).map(tuple),
)


def _general(data: bytes) -> dict[str, float]:
    """Read an object's general frame by shifts and masks, byte by byte."""
    return {
        "number": data[0],
        "longitudinal": ((data[1] << 5) | (data[2] >> 3)) * 0.2 - 500.0,
        "lateral": (((data[2] & 0x07) << 8) | data[3]) * 0.2 - 204.6,
        "longitudinal_speed": ((data[4] << 2) | (data[5] >> 6)) * 0.25 - 128.0,
        "lateral_speed": (((data[5] & 0x3F) << 3) | (data[6] >> 5)) * 0.25 - 64.0,
        "motion": data[6] & 0x07,
        "cross_section": data[7] * 0.5 - 64.0,
    }


@pytest.mark.thorough
@given(found=LISTS, sensor=st.integers(0, 7))
def test_frames_as_drivers_of_the_sensor_read_them(found: ars408.ObjectList, sensor: int) -> None:
    frames = ars408.encode(found, sensor)
    by_id: dict[int, list[Frame]] = {}
    for frame in frames:
        by_id.setdefault(frame.id - 0x10 * sensor, []).append(frame)
    (state,), (status,) = by_id[0x201], by_id[0x60A]
    assert (state.data[2] >> 5) & 1 == 0
    assert state.data[4] & 7 == sensor
    assert (state.data[5] >> 2) & 3 == 1  # objects
    assert status.data[0] == len(found.objects)
    assert (status.data[1] << 8 | status.data[2], status.data[3] >> 4) == (found.counter, 1)
    for one, general, quality, extended in zip(
        found.objects, by_id.get(0x60B, []), by_id.get(0x60C, []), by_id.get(0x60D, []), strict=True
    ):
        read = _general(general.data)
        assert read["number"] == quality.data[0] == extended.data[0] == one.number
        assert read["longitudinal"] == pytest.approx(one.longitudinal, abs=0.1 + 1e-9)
        assert read["lateral"] == pytest.approx(one.lateral, abs=0.1 + 1e-9)
        assert read["longitudinal_speed"] == pytest.approx(one.longitudinal_speed, abs=0.125 + 1e-9)
        assert read["lateral_speed"] == pytest.approx(one.lateral_speed, abs=0.125 + 1e-9)
        assert read["motion"] == one.motion
        assert read["cross_section"] == pytest.approx(one.cross_section, abs=0.25 + 1e-9)
        assert len(quality.data) == 7
        assert ars408.EXISTENCE[quality.data[6] >> 5 & 7] == one.existence
        assert quality.data[6] >> 2 & 7 == one.measurement
        assert extended.data[3] & 7 == one.kind
        turn = (extended.data[4] << 2 | extended.data[5] >> 6) * 0.4 - 180.0
        assert turn == pytest.approx(math.degrees(one.orientation), abs=0.2 + 1e-9)
        assert extended.data[6] * 0.2 == pytest.approx(one.length, abs=0.1 + 1e-9)
        assert extended.data[7] * 0.2 == pytest.approx(one.width, abs=0.1 + 1e-9)


@given(found=LISTS, sensor=st.integers(0, 7))
def test_decoder_is_the_inverse(found: ars408.ObjectList, sensor: int) -> None:
    decoder = ars408.Decoder(sensor)
    (back,) = decoder.feed(ars408.encode(found, sensor))
    assert not decoder.failed
    assert back.counter == found.counter
    assert ars408.encode(back, sensor) == ars408.encode(found, sensor)


@given(found=LISTS, data=st.data())
def test_a_list_with_a_frame_missing_is_none(found: ars408.ObjectList, data: st.DataObject) -> None:
    frames = ars408.encode(found)
    left = data.draw(st.integers(1, len(frames) - 1))  # 0 is the sensor's state, which no list needs
    assert not ars408.Decoder().feed(frame for n, frame in enumerate(frames) if n != left)


def test_an_invalid_list_is_empty_and_reports_an_error() -> None:
    decoder = ars408.Decoder()
    (back,) = decoder.feed(ars408.encode(ars408.ObjectList(3, (ars408.Object(1, 20.0, 0.0, -5.0),)), valid=False))
    assert decoder.failed
    assert back.objects == ()


@pytest.mark.parametrize(
    ("found", "sensor"),
    [
        (ars408.ObjectList(0, ()), 8),
        (ars408.ObjectList(0, (ars408.Object(256, 1.0, 0.0, 0.0),)), 0),
        (ars408.ObjectList(0, (ars408.Object(1, math.nan, 0.0, 0.0),)), 0),
        (ars408.ObjectList(0, (ars408.Object(1, math.inf, 0.0, 0.0),)), 0),
        (ars408.ObjectList(0, tuple(ars408.Object(n, 1.0, 0.0, 0.0) for n in range(101))), 0),
    ],
)
def test_what_the_sensor_cannot_say_is_refused(found: ars408.ObjectList, sensor: int) -> None:
    with pytest.raises(ValueError, match=r"ARS408|finite"):
        ars408.encode(found, sensor)
