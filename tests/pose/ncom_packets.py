"""NCOM packets: fixes, streams and drives as a real unit sends them, and packets that lie."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import replace

from tests.fixes import GOOD
from vve_sumo.pose.ncom import Decoder, Encoder, pack
from vve_sumo.values import Fix

START = 1_300_000_020.0  # a whole GPS minute
NOTHING = bytes(8)


def fix_at(time: float, **changes: float) -> Fix:
    moving = replace(
        GOOD, time=time, latitude=0.6983, longitude=-1.4483, altitude=250.5, heading=0.3, pitch=0.01, roll=-0.02,
        velocity_north=3.0, velocity_east=4.0, velocity_down=-0.1, yaw_rate=0.1, acceleration=0.5, differential_age=1.2,
    )  # fmt: skip
    return replace(moving, **changes)


def stream(count: int, start: float = START, period: float = 0.01) -> list[bytes]:
    encoder = Encoder()
    return [encoder.encode(fix_at(start + k * period, latitude=0.6983 + 1e-8 * k)) for k in range(count)]


def minute_channel(time: float) -> bytes:
    return struct.pack("<iBBBB", int(time // 60), 12, 6, 6, 6)


def decoded(data: bytes) -> list[Fix]:
    return Decoder().feed(data, 0.0)


def arrived(packets: Iterable[tuple[float, bytes]], decoder: Decoder | None = None) -> list[Fix]:
    """What comes of packets that are each fed with their own arrival."""
    decoder = decoder or Decoder()
    return [fix for received, packet in packets for fix in decoder.feed(packet, received)]


def with_status(status: int, packet: bytes) -> bytes:
    """The packet with another navigation status."""
    return sealed(packet[:21] + bytes((status,)) + packet[22:])


def sealed(packet: bytes) -> bytes:
    """The packet with its three checksums made right."""
    body = bytearray(packet)
    for end in (22, 61, 71):
        body[end] = sum(body[1:end]) & 0xFF
    return bytes(body)


PACKETS = stream(30)


def content(fix: Fix) -> tuple[float, ...]:
    """All that one packet alone says."""
    return (
        *(fix.time, fix.latitude, fix.longitude, fix.altitude, fix.heading, fix.pitch, fix.roll),
        *(fix.velocity_north, fix.velocity_east, fix.velocity_down, fix.yaw_rate, fix.acceleration, fix.locked),
    )


def drive(seconds: float, start: float = START, cycle: int = 20) -> list[tuple[float, bytes]]:
    """Arrivals and packets at 100 Hz, 5 ms late; only one in `cycle` says the minute, as with a real unit."""
    rows = []
    for k in range(round(seconds * 100)):
        channel, payload = (0, minute_channel(start + 0.01 * k)) if k % cycle == 0 else (16, NOTHING)
        rows.append((0.01 * k + 0.005, pack(fix_at(start + 0.01 * k), channel, payload)))
    return rows


def lie(time: float, minutes: int = 0, channel: int = 16) -> bytes:
    """A packet that says `time` and with its channel 0 another minute."""
    payload = struct.pack("<iBBBB", int(time // 60) + minutes, 12, 6, 6, 6) if channel == 0 else NOTHING
    return pack(fix_at(time), channel, payload)
