"""Bits of CAN frames: the catalogued check value of the checksum, a frame counted by hand, and the published bounds."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from benchmarks.bus_load import crc15, least, on_the_wire, stuffed, worst
from vve_sumo.values import Frame


def test_the_checksum_has_the_check_value_of_the_catalogue():
    """CRC-15/CAN in the catalogue of parametrised CRC algorithms: 0x059E for the digits 1 to 9."""
    bits = [byte >> place & 1 for byte in b"123456789" for place in reversed(range(8))]
    assert crc15(bits) == 0x059E


def test_a_frame_of_zeros_is_stuffed_after_every_fifth_bit():
    """Identifier 0 without data is 19 zeros, whose checksum is 0, too: six stuffed bits among 34, and 13 after them."""
    assert stuffed(Frame(0, b"")) == [0] * 34
    assert on_the_wire(Frame(0, b"")) == 34 + 6 + 13


def test_frames_of_eight_bytes_take_111_to_135_bits():
    assert (least(8), worst(8)) == (111, 135)


@given(st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8)))
def test_no_frame_takes_less_or_more_than_the_bounds(frame: Frame):
    assert least(len(frame.data)) <= on_the_wire(frame) <= worst(len(frame.data))
