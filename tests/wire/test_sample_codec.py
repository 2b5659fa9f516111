"""Samples come through the way between two processes as they were: compared field by field, bit by bit."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.bits import bits
from vve_sumo.sensors.camera import no_objects
from vve_sumo.values import Actors, Detections, Fix, FixQuality, Point, Pose
from vve_sumo.wire.sample import NO_SCAN, LidarTurn, Sample, SampleContent, no_fix
from vve_sumo.wire.sample_codec import decode_sample, encode_sample

NUMBERS = st.floats()


def _of(kind: type[Any], **chosen: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    names = [field.name for field in dataclasses.fields(kind)]
    return st.builds(kind, **{name: chosen.get(name, NUMBERS) for name in names})


@st.composite
def _tables(draw: st.DrawFn) -> tuple[Detections, Actors]:
    def column(rows: int) -> np.ndarray:
        return np.array(draw(st.lists(NUMBERS, min_size=rows, max_size=rows)), float)

    found, seen = draw(st.integers(0, 4)), draw(st.integers(0, 4))
    modes = np.array(draw(st.lists(st.integers(0, 1), min_size=found, max_size=found)), np.int8)
    names = tuple(draw(st.lists(st.text(), min_size=seen, max_size=seen)))
    scan = Detections(draw(NUMBERS), *(column(found) for _ in range(3)), modes)
    kinds = np.array(draw(st.lists(st.integers(0, 7), min_size=seen, max_size=seen)), np.int8)
    return scan, Actors(draw(NUMBERS), names, *(column(seen) for _ in range(9)), kinds)


FIXES = _of(Fix, locked=st.booleans(), quality=st.sampled_from(FixQuality))
POSES = _of(Pose, point=st.sampled_from(Point))


def test_a_turn_and_a_list_come_through_bit_for_bit() -> None:
    turn = LidarTurn(
        0.1,
        5e-5,
        np.array([0, 35_999], np.uint16),
        np.zeros(16),
        np.linspace(-0.1, 0.1, 16),
        np.arange(32, dtype=np.uint16),
        np.full(32, 200, np.uint8),
    )
    seen = no_objects(0.3)
    listed = dataclasses.replace(seen, number=np.array([7]), x=np.array([0.1]), lane_known=True, lane_left=1.25)
    pose = Pose(0.0, Point.REAR_AXLE, *([0.0] * 8))
    content = SampleContent(
        no_fix(0.0, 0.0), pose, NO_SCAN, 0.0, Actors.none(0.0), turns={"roof": turn}, lists={"front": listed}
    )
    sample = Sample(3, 1.4e9, 0.3, content)
    assert bits(decode_sample(encode_sample(sample, actors=False))) == bits(sample)
    front, roof = sample.seen_by("front").measured, sample.seen_by("roof").measured
    assert front is not None
    assert roof is not None
    assert front.objects is listed
    assert roof.turn is turn
    assert front.turn is roof.objects is None


@given(FIXES, POSES, _tables(), NUMBERS, st.integers(0, 2**40))
def test_every_field_comes_through(fix: Fix, pose: Pose, tables: Any, age: float, sequence: int) -> None:
    scan, actors = tables
    sample = Sample(sequence, 1.4e9, age, SampleContent(fix, pose, scan, age, actors))
    assert bits(decode_sample(encode_sample(sample, actors=True))) == bits(sample)
    nobody = Actors.none(actors.time)
    without = dataclasses.replace(sample, measured=SampleContent(fix, pose, scan, age, nobody))
    assert bits(decode_sample(encode_sample(sample, actors=False))) == bits(without)


def test_a_sample_without_measurements_stays_one() -> None:
    assert decode_sample(encode_sample(Sample(7, 1.5e9, 3.25, None), actors=True)) == Sample(7, 1.5e9, 3.25, None)
