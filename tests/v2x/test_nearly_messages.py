"""Bytes that are nearly a message: each is read, and can be sent again as it was read, or is refused with one error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from random import Random
from typing import Any

import pytest

from tests.v2x import test_cam, test_cpm, test_denm, test_geonetworking, test_mapem, test_spatem, test_vam
from tests.v2x.packets import nearly
from vve_sumo.v2x import cam, cpm, denm, geonetworking, mapem, spatem, vam
from vve_sumo.v2x.decode_error import MessageDecodeError

#: codec, a message of it, and what its `decode` takes beside the bytes
GENUINE = [
    (cam, test_cam.CAR, (test_cam.NOW,)),
    (denm, test_denm.EVENT, ()),
    (denm, test_denm.OVER, ()),
    (vam, test_vam.CYCLIST, (test_vam.NOW,)),
    (cpm, test_cpm.MESSAGE, ()),
    (cpm, test_cpm.ROADSIDE, ()),
    (spatem, test_spatem.MESSAGE, ()),
    (mapem, test_mapem.MESSAGE, ()),
    (geonetworking, test_geonetworking.BROADCAST, ()),
    (geonetworking, test_geonetworking.FOR_AREA, ()),
]


def read(codec: Any, spoilt: Iterable[bytes], more: tuple[int, ...]) -> tuple[int, int]:
    """How many were read and refused; fail where something else happens, or what was read is not what is sent again."""
    accepted = refused = 0
    for data in spoilt:
        try:
            found = codec.decode(data, *more)
        except MessageDecodeError:
            refused += 1
            continue
        again = codec.decode(codec.encode(found), *more)
        assert again == (found if codec is geonetworking else codec.rounded(found))
        accepted += 1
    return accepted, refused


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(("codec", "message", "more"), GENUINE)
def test_one_wrong_bit_or_a_missing_end(codec: Any, message: Any, more: tuple[int, ...]) -> None:
    accepted, refused = read(codec, nearly(codec.encode(message)), more)
    assert accepted > 0
    assert refused >= len(codec.encode(message)) - 1


def several_wrong_bits(genuine: bytes, random: Random, trials: int) -> Iterator[bytes]:
    for _ in range(trials):
        data = bytearray(genuine)
        for _ in range(random.randint(2, 6)):
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        yield bytes(data)
        yield genuine[:6] + random.randbytes(random.randrange(150))


@pytest.mark.parametrize("trials", [100, pytest.param(5000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("codec", "message", "more"), GENUINE)
def test_several_wrong_bits_or_a_header_before_noise(
    codec: Any, message: Any, more: tuple[int, ...], trials: int
) -> None:
    accepted, refused = read(codec, several_wrong_bits(codec.encode(message), Random(61), trials), more)
    assert accepted > 0
    assert refused > 0
