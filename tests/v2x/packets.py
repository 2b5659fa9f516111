"""Packets around messages, for readers that want whole frames; bytes that are nearly a message."""

from __future__ import annotations

from collections.abc import Iterator

from hypothesis import strategies as st

from vve_sumo.v2x import geonetworking
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.geonetworking import PORTS, Area, AreaShape, Packet, PositionVector
from vve_sumo.v2x.pdu_header import MessageId

ADDRESS = bytes.fromhex("020000000042")
SOURCE = PositionVector(ADDRESS, StationType.PASSENGER_CAR, 4_000_000_000, 40.0, -83.0, 13.9, 1.0)
AROUND = Area(AreaShape.CIRCLE, 40.0, -83.0, 500)


def frame(message: MessageId, payload: bytes, area: Area | None = None) -> bytes:
    """Return an Ethernet frame with a message, as a single-hop broadcast unless it is for an area."""
    hops = 1 if area is None else 10
    packet = Packet(SOURCE, PORTS[message], payload, area, hops=hops, max_hops=hops)
    return geonetworking.ethernet_frame(geonetworking.encode(packet), ADDRESS)


def nearly(genuine: bytes) -> Iterator[bytes]:
    """Yield a message with each of its bits flipped, and each of its beginnings."""
    whole, size = int.from_bytes(genuine), len(genuine)
    for bit in range(8 * size):
        yield (whole ^ 1 << bit).to_bytes(size)
    for length in range(size):
        yield genuine[:length]


def spoilt(genuine: bytes) -> st.SearchStrategy[bytes]:
    """Return bytes that are a message cut off, one with flipped bits, or no message at all."""
    size = len(genuine)
    whole = int.from_bytes(genuine)
    flipped = st.lists(st.integers(0, 8 * size - 1), min_size=1, max_size=8).map(
        lambda bits: (whole ^ sum({1 << bit for bit in bits})).to_bytes(size)
    )
    cut = st.integers(0, size - 1).map(lambda length: genuine[:length])
    headed = st.binary(max_size=120).map(lambda rest: genuine[:6] + rest)
    return st.one_of(flipped, cut, headed, st.binary(max_size=120))
