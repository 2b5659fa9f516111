"""The link's codec: everything comes back to the bit, and no bytes break it."""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.setpoints import setpoint as complete
from vve_sumo.messages import MalformedMessage
from vve_sumo.values import ArmingState, FallbackPath, GatewayStatus, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.fallback import well_formed

FLOATS = st.integers(0, 2**64 - 1).map(lambda bits: struct.unpack("<d", struct.pack("<Q", bits))[0]) | st.floats()
SHORT = st.text(st.characters(codec="utf-8"), max_size=60)
CODES = st.lists(SHORT, max_size=64).map(tuple)
PROFILES = st.builds(FallbackPath, FLOATS, st.lists(FLOATS, max_size=65).map(tuple))
SETPOINTS = st.builds(
    Setpoint,
    steering=FLOATS,
    acceleration=FLOATS,
    emergency=st.booleans(),
    note=SHORT,
    sequence=st.integers(-1, 2**63 - 1),
    **dict.fromkeys(("time", "expires", "speed", "yaw_rate", "grade"), FLOATS),
    faults=CODES,
    fallback_path=st.none() | PROFILES,
)
VERDICTS = st.builds(GatewayStatus, st.sampled_from(ArmingState), CODES, FLOATS, FLOATS, CODES, FLOATS, FLOATS)
FEEDBACKS = st.builds(
    link.Feedback,
    FLOATS,
    st.integers(-1, 2**63 - 1),
    FLOATS,
    VERDICTS,
    FLOATS,
    FLOATS,
    SHORT,
    st.integers(0, 2**63 - 1),
)
DECODERS = (link.decode_setpoint, link.decode_operator_command, link.decode_feedback)


def bits(value):
    """The same thing with every float as its bytes, so that NaN equals itself and zeros differ by sign."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, tuple):
        return tuple(map(bits, value))
    if dataclasses.is_dataclass(value):
        return tuple(bits(getattr(value, field.name)) for field in dataclasses.fields(value))
    return value


def sealed(message: bytes) -> bytes:
    return message + struct.pack("<I", zlib.crc32(message))


@given(SETPOINTS)
def test_a_setpoint_comes_back_bit_for_bit(setpoint):
    data = link.encode_setpoint(setpoint)
    back = link.decode_setpoint(data)
    assert isinstance(back, Setpoint)
    assert bits(back) == bits(setpoint)
    assert link.encode_setpoint(back) == data


@given(FEEDBACKS)
def test_a_feedback_comes_back_bit_for_bit(feedback):
    back = link.decode_feedback(link.encode_feedback(feedback))
    assert isinstance(back, link.Feedback)
    assert bits(back) == bits(feedback)
    assert isinstance(back.status.state, ArmingState)


@pytest.mark.parametrize("command", OperatorCommand)
def test_a_command_comes_back(command):
    assert link.decode_operator_command(link.encode_operator_command(command)) is command


def test_the_layout_on_the_wire():
    """Written down by hand from MessagePack's specification: arrays 0x90 + n, texts 0xa0 + n, doubles 0xcb."""

    def double(number: float) -> bytes:
        return b"\xcb" + struct.pack(">d", number)

    numbers = b"".join(map(double, (1.5, 1.6, 3.0, 4.0, 0.7, 8.0, 0.2, 0.01)))
    message = b"VV\x04\x01\x9f" + double(0.1) + double(-2.0) + b"\xc3\xa3why\x07" + numbers
    message += b"\x92\xa1a\xa2bb" + b"\x92" + double(0.5) + b"\x92" + double(0.03) + double(0.04)
    setpoint = Setpoint(
        0.1, -2.0, True, "why", 7, 1.5, 1.6, 3.0, 4.0, 0.7, 8.0, 0.2, 0.01, ("a", "bb"), FallbackPath(0.5, (0.03, 0.04))
    )  # fmt: skip
    assert link.encode_setpoint(setpoint) == sealed(message)
    assert link.decode_setpoint(sealed(message)) == setpoint
    assert link.encode_operator_command(OperatorCommand.GO) == sealed(b"VV\x04\x02\xa2go")


@given(st.binary(max_size=300))
@example(b"")
@example(sealed(b"VV\x04"))
def test_no_bytes_break_it(data):
    for decode in DECODERS:
        assert isinstance(decode(data), MalformedMessage)


@given(st.sampled_from([1, 2, 3]), st.binary(max_size=400))
def test_no_body_breaks_it_even_under_a_right_sum(kind, body):
    for decode, own in zip(DECODERS, (1, 2, 3), strict=True):
        message = decode(sealed(b"VV\x04" + bytes((kind,)) + body))
        if kind != own:
            assert message == MalformedMessage("wrong_kind")
        else:
            assert isinstance(message, (MalformedMessage, Setpoint, link.Feedback, OperatorCommand))


@given(st.one_of(SETPOINTS.map(link.encode_setpoint), FEEDBACKS.map(link.encode_feedback)), st.data())
def test_a_right_message_cut_short_or_made_longer_under_a_right_sum_is_none(data, draws):
    body = data[:-4]
    cut = draws.draw(st.integers(4, len(body) - 1))
    for decode in DECODERS:
        assert isinstance(decode(sealed(body[:cut])), MalformedMessage)
        assert isinstance(decode(sealed(body + b"\0")), MalformedMessage)


@given(SETPOINTS, st.data())
def test_a_flipped_bit_is_found(setpoint, draws):
    data = bytearray(link.encode_setpoint(setpoint))
    place = draws.draw(st.integers(0, 8 * len(data) - 1))
    data[place // 8] ^= 1 << place % 8
    assert link.decode_setpoint(bytes(data)) == MalformedMessage("wrong_crc")


def test_what_is_wrong_is_said():
    right = link.encode_operator_command(OperatorCommand.STOP)
    assert link.decode_operator_command(right[:7]) == MalformedMessage("too_short")
    assert link.decode_operator_command(right[:-1]) == MalformedMessage("wrong_crc")
    assert link.decode_operator_command(sealed(b"VX\x04\x02\xa4stop")) == MalformedMessage("wrong_magic")
    assert link.decode_operator_command(sealed(b"VV\x03\x02\xa4stop")) == MalformedMessage("wrong_version")
    assert link.decode_operator_command(sealed(b"VV\x04\x01\xa4stop")) == MalformedMessage("wrong_kind")
    assert link.decode_operator_command(sealed(b"VV\x04\x02\xa4fly!")) == MalformedMessage("wrong_content")
    assert link.decode_operator_command(sealed(b"VV\x04\x02\xa4stop!")) == MalformedMessage("wrong_content")


def test_a_sequence_that_no_table_could_hold_is_none():
    right = link.encode_setpoint(complete(0.0, 0.0, sequence=(1 << 63) - 1))
    most = b"\xcf" + ((1 << 63) - 1).to_bytes(8, "big")
    assert right.count(most) == 1
    wrong = right[:-4].replace(most, b"\xcf" + (1 << 63).to_bytes(8, "big"))
    assert link.decode_setpoint(sealed(wrong)) == MalformedMessage("wrong_content")
    status = GatewayStatus(ArmingState.DISARMED, (), 0.0, 0.0, (), 0.0, 0.0)
    told = link.encode_feedback(link.Feedback(0.0, 1 << 63, math.nan, status, 0.0, 0.0, "", 1))
    assert told.count(most) == 1, "the greatest is sent for what is greater"
    wrong = told[:-4].replace(most, b"\xcf" + (1 << 63).to_bytes(8, "big"))
    assert link.decode_feedback(sealed(wrong)) == MalformedMessage("wrong_content")


def test_what_no_text_can_hold_comes_back_as_a_question_mark():
    said = complete(0.0, 0.0, note="a\ud800b", faults=("\udfff",))
    back = link.decode_setpoint(link.encode_setpoint(said))
    assert (back.note, back.faults) == ("a?b", ("?",))
    status = GatewayStatus(ArmingState.FAULT, ("\ud800",), 0.0, 0.0, ("x\ud800",), 0.0, 0.0)
    feedback = link.decode_feedback(
        link.encode_feedback(link.Feedback(0.0, 1, math.nan, status, 0.0, 0.0, "\ud800", 1))
    )
    assert (feedback.status.reasons, feedback.status.limited, feedback.gear) == (("?",), ("x?",), "?")


def test_what_is_too_long_goes_out_cut_short_and_a_way_that_is_too_long_stays_so():
    said = complete(
        0.0, 0.0, note="ä" * 1000, faults=("x" * 300,) * 100, fallback_path=FallbackPath(1.0, (0.0,) * 10_000)
    )
    data = link.encode_setpoint(said)
    assert len(data) < 20_000
    back = link.decode_setpoint(data)
    assert back.note == "ä" * 255
    assert back.faults == ("x" * 255,) * 64
    assert not well_formed(back.fallback_path)
    status = GatewayStatus(ArmingState.FAULT, ("y",) * 1000, 0.0, 0.0, (), 0.0, 0.0)
    feedback = link.decode_feedback(
        link.encode_feedback(link.Feedback(0.0, 1 << 80, math.nan, status, 0.0, 0.0, "", 1))
    )
    assert (len(feedback.status.reasons), feedback.sequence) == (64, (1 << 63) - 1)
