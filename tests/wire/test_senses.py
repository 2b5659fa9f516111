"""Datagrams of one sensor's measurements: parts of turns come together again, each measurement goes out once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bits import bits
from tests.bridges.ros2.drive import EPOCH, sample_at
from vve_sumo.messages import MalformedMessage
from vve_sumo.sensors.camera import no_objects
from vve_sumo.values import CameraObjects, Detections
from vve_sumo.wire.sample import LidarTurn, Sample
from vve_sumo.wire.senses import (
    PART_RAYS,
    SenseDatagram,
    SenseOutput,
    TurnAssembler,
    decode_sense,
    encode_sense,
    parts_of,
)

LONGEST = 65_507  # bytes of a UDP datagram


def _turn(firings: int, channels: int) -> LidarTurn:
    rays = np.arange(firings * channels)
    return LidarTurn(
        0.1, 5e-5, np.arange(firings, dtype=np.uint16), np.linspace(0.0, -0.002, channels),
        np.linspace(-0.2, 0.2, channels), (rays % 65_536).astype(np.uint16), (rays % 256).astype(np.uint8),
    )  # fmt: skip


def _with(sample: Sample, **changes: object) -> Sample:
    assert sample.measured is not None
    return dataclasses.replace(sample, measured=dataclasses.replace(sample.measured, **changes))  # type: ignore[arg-type]


def _listing(tick: int, listed: CameraObjects) -> Sample:
    return _with(sample_at(tick), lists={"front": listed}).seen_by("front")


def _read(data: bytes) -> SenseDatagram:
    got = decode_sense(data)
    assert isinstance(got, SenseDatagram)
    return got


@given(st.integers(1, 4000), st.sampled_from([1, 5, 16, 64, 128]))
def test_a_turn_comes_together_again_from_parts_that_fit_into_datagrams(firings: int, channels: int) -> None:
    turn = _turn(firings, channels)
    sent = SenseOutput().step(_with(sample_at(7), turn=turn))
    assert max(map(len, sent)) < LONGEST
    assert len(sent) == -(-firings // (PART_RAYS // channels))
    assembler = TurnAssembler()
    *none, whole = [assembler.take(_read(data)) for data in sent]
    assert none == [None] * (len(sent) - 1)
    assert whole is not None
    assert (whole.sequence, whole.time) == (8, EPOCH + 0.1)
    assert bits(whole.turn) == bits(turn)


@given(st.integers(2, 6), st.data())
def test_a_turn_of_which_a_part_is_missing_never_comes_out(parts: int, data: st.DataObject) -> None:
    datagrams = [SenseDatagram(3, 0.0, number, parts, turn=part)
                 for number, part in enumerate(parts_of(_turn(parts, PART_RAYS)))]  # fmt: skip
    lost = data.draw(st.sets(st.integers(0, parts - 1), min_size=1))
    assembler = TurnAssembler()
    assert all(assembler.take(one) is None for one in datagrams if one.part not in lost)
    after = [assembler.take(dataclasses.replace(one, sequence=4)) for one in datagrams]
    assert [one is not None for one in after] == [False] * (parts - 1) + [True]


def test_a_list_goes_out_once_and_not_when_it_is_old() -> None:
    output = SenseOutput()
    listed = dataclasses.replace(no_objects(0.1), number=np.array([7]), lane_known=True, lane_left=1.25)
    (data,) = output.step(_listing(7, listed))  # at 0.14 s
    got = _read(data)
    assert (got.sequence, got.time) == (8, EPOCH + 0.1)
    assert bits(got.objects) == bits(listed)
    assert output.step(_listing(8, listed)) == ()
    late = dataclasses.replace(listed, time=0.15)
    assert output.step(_listing(33, late)) == ()  # 0.51 s old
    assert len(output.step(_listing(32, late))) == 1


def test_a_scan_of_another_radar_goes_out() -> None:
    scan = Detections(0.1, np.array([20.0]), np.array([0.1]), np.array([-8.0]), np.zeros(1, np.int8))
    sample = _with(sample_at(7), others={"second": scan}).seen_by("second")
    (data,) = SenseOutput().step(sample)
    assert bits(_read(data).scan) == bits(scan)
    assert SenseOutput().step(_with(sample_at(7)).seen_by("second")) == ()  # it has none


def test_an_invalid_sample_sends_nothing() -> None:
    assert SenseOutput().step(sample_at(7, valid=False)) == ()


@pytest.mark.parametrize("data", [b"", b"VVES", encode_sense(SenseDatagram(1, 0.0))[:-1]])
def test_bytes_that_are_none_are_told(data: bytes) -> None:
    assert isinstance(decode_sense(data), MalformedMessage)
