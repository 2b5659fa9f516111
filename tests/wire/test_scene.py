"""The wire `scene`: what a tick's datagram says of it, also of an invalid one, and bytes that are none."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bridges.ros2.drive import EPOCH, sample_at
from vve_sumo.messages import MalformedMessage
from vve_sumo.wire.sample_codec import encode_sample
from vve_sumo.wire.scene import Scene, decode_scene, encode_scene


def _decoded(data: bytes) -> Scene:
    scene = decode_scene(data)
    assert isinstance(scene, Scene)
    return scene


def test_a_valid_tick_says_where_everybody_is() -> None:
    sample = sample_at(7)
    scene, content = _decoded(encode_scene(sample)), sample.measured
    assert content is not None
    assert (scene.sequence, scene.time, scene.state, scene.faults) == (8, EPOCH + 0.14, "engaged", ())
    assert scene.pose == content.pose
    assert scene.actors.ids == content.actors.ids
    for column in ("x", "y", "heading", "speed", "length", "width", "height", "kind"):
        assert getattr(scene.actors, column).tolist() == getattr(content.actors, column).tolist()


def test_an_invalid_tick_says_why_and_shows_nobody() -> None:
    scene = _decoded(encode_scene(sample_at(7, valid=False)))
    assert (scene.state, scene.faults, scene.pose, scene.actors.ids) == ("stopping", ("pose_stale",), None, ())


@given(st.integers(0, 10_000), st.integers(0, 7))
def test_a_flipped_bit_is_noticed(byte: int, bit: int) -> None:
    data = bytearray(encode_scene(sample_at(3)))
    data[byte % len(data)] ^= 1 << bit
    assert isinstance(decode_scene(bytes(data)), MalformedMessage)


@pytest.mark.parametrize("data", [b"", b"VV", encode_sample(sample_at(1), actors=True)])
def test_other_bytes_are_no_scene(data: bytes) -> None:
    assert isinstance(decode_scene(data), MalformedMessage)


def test_any_state_and_reasons_come_through() -> None:
    sample = replace(sample_at(2), state="fault", faults=("a", "b"))
    assert _decoded(encode_scene(sample)).faults == ("a", "b")
