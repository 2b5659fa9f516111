"""Spoilt, replayed, unasked and forged setpoint datagrams against the inbox that decides what a gateway is asked.

A run is 1000 datagrams to one inbox, half of the runs with a key. A brain sends good ones in between; the others are
cut, changed in some bytes, changed and given a right checksum, sent again, or random from the first byte. Invariants:

 1. No exception; the inbox takes a datagram, or says one of its reason codes.
 2. One that is not taken changes nothing: the command before and after it is the same, at this moment and later.
 3. One that is taken has a right checksum, read apart from the codec, and the key's tag where there is a key; it is
    finite, newer than the one taken before, answers one of the last ten that were asked, at about that time, and its
    bytes are what is asked.
 4. A command is acted on for its lifetime after its arrival and no longer, and that is 100 ms at most.
"""

from __future__ import annotations

import hashlib
import hmac
import math
import random
import struct
import zlib
from typing import Final

from tests.fuzz.invariant import hold
from vve_sumo.wire import setpoints
from vve_sumo.wire.datagrams import SetpointDatagram, Wrong, encode_setpoint
from vve_sumo.wire.setpoints import SetpointInbox
from vve_sumo.wire.signature import TAG, signed

INPUTS: Final = 1000  # of a run
PERIOD: Final = 0.02
LIFETIME: Final = 0.1
REASONS: Final = frozenset({*map(str, Wrong), setpoints.REPLAYED, setpoints.UNASKED, setpoints.LATE, setpoints.FORGED})
#: bytes as docs/brains.md lists them: what the codec reads is read here again
FIELDS: Final = struct.Struct("<4sBBHIIdffIII")
ODD: Final = (math.nan, math.inf, -math.inf, -0.0, 1e-300, 3.4e38, -3.4e38)


def _right(body: bytes) -> bytes:
    """The first 40 bytes, with the checksum that they should have."""
    return body[:40] + struct.pack("<I", zlib.crc32(body[:40]))


def _spoilt(chance: random.Random, data: bytes) -> bytes:
    kind, changed = chance.randrange(7), bytearray(data)
    if kind == 0:
        return data[: chance.randrange(len(data))]
    if kind == 1:
        return chance.randbytes(chance.choice((0, 4, 43, 44, 45, 60, 61, chance.randrange(200))))
    for _ in range(chance.choice((1, 1, 2, 8))):
        changed[chance.randrange(len(changed))] ^= chance.randrange(1, 256)
    if kind == 2:
        return bytes(changed)
    if kind == 3:
        place = chance.choice((24, 28))
        changed = bytearray(data)
        changed[place : place + 4] = struct.pack("<f", chance.choice(ODD))
    if kind == 4:
        changed = bytearray(data)
        changed[12:16] = struct.pack("<I", chance.choice((0, 1, 100_000, 100_001, 2**32 - 1)))
    return _right(bytes(changed))


class _Run:
    def __init__(self, seed: int) -> None:
        self.chance = random.Random(f"setpoints {seed}")
        self.key = self.chance.randbytes(32) if seed % 2 else b""
        self.inbox = SetpointInbox(0.0, self.key)
        self.now, self.asked, self.sequence = 0.0, [0], self.chance.randrange(1 << 32)
        self.inbox.sample_sent(0)
        self.last: int | None = None
        self.sent: list[bytes] = []
        self.expires, self.wish = -math.inf, (0.0, 0.0)

    def step(self) -> None:
        chance = self.chance
        if chance.random() < 0.5:
            self.now += PERIOD * chance.random() * 2.0
            self.asked = [*self.asked, self.asked[-1] + 1][-10:]
            self.inbox.sample_sent(self.asked[-1])
        data = self._datagram()
        before, later = self.inbox.command(self.now), self.now + chance.uniform(0.0, 0.2)
        before_later = self.inbox.command(later)
        reason = self.inbox.take(self.now, data)
        if reason:
            hold(1, reason in REASONS, reason)
            hold(2, self.inbox.command(self.now) == before, (data.hex(), reason))
            hold(2, self.inbox.command(later) == before_later, (data.hex(), reason))
        else:
            self._taken(data)
        command = self.inbox.command(later)
        hold(4, (command is not None) == (later <= self.expires), (later, self.expires))
        if command is not None:
            hold(4, (command.steering, command.acceleration) == self.wish, command)

    def _datagram(self) -> bytes:
        chance = self.chance
        self.sequence += 1
        good = encode_setpoint(
            SetpointDatagram(
                self.sequence, chance.choice(self.asked), self.now, chance.choice((0.001, 0.05, 0.1)),
                chance.uniform(-0.5, 0.5), chance.uniform(-9.0, 2.0), chance.random() < 0.2,
            )
        )  # fmt: skip
        lot = chance.random()
        if lot < 0.1:
            data = signed(good, self.key) if self.key else good
            self.sent.append(data)
            return data
        if lot < 0.2 and self.sent:
            return chance.choice(self.sent)
        if lot < 0.25:
            at = chance.choice((-1e9, -0.3, -0.06, 0.2, 0.3, 1e9))
            late = encode_setpoint(SetpointDatagram(self.sequence, self.asked[-1], self.now - at, 0.1, 0.1, 1.0))
            return signed(late, self.key) if self.key else late
        spoilt = _spoilt(chance, good)
        if self.key and chance.random() < 0.5:
            return signed(spoilt, self.key if chance.random() < 0.5 else chance.randbytes(32))
        return spoilt

    def _taken(self, data: bytes) -> None:
        if self.key:
            data, tag = data[:-TAG], data[-TAG:]
            hold(3, hmac.new(self.key, data, hashlib.sha256).digest()[:TAG] == tag, data.hex())
        hold(3, len(data) == FIELDS.size, data.hex())
        magic, version, kind, _, sequence, lifetime, time, steering, acceleration, answers, _, crc = FIELDS.unpack(data)
        hold(3, (magic, version, kind) == (b"VVES", 1, 2) and zlib.crc32(data[:40]) == crc, data.hex())
        hold(3, all(map(math.isfinite, (time, steering, acceleration))), data.hex())
        hold(3, 0 < lifetime <= 1e6 * LIFETIME, data.hex())
        hold(3, self.last is None or 0 < (sequence - self.last) % 2**32 < 2**31, (self.last, sequence))
        hold(3, answers in self.asked, (answers, self.asked))
        hold(3, -0.05 <= self.now - time <= 0.25, (self.now, time))
        self.last, self.expires = sequence, self.now + lifetime / 1e6
        self.sequence = sequence  # one that was changed may be far ahead: the brain then goes on after it
        self.wish = (steering, acceleration)


def run(seed: int) -> int:
    """Send once; how many datagrams that were. Raises Violation."""
    drive = _Run(seed)
    for _ in range(INPUTS):
        drive.step()
    hold(1, drive.inbox.taken + sum(drive.inbox.counts.values()) == INPUTS, drive.inbox.counts)
    hold(3, drive.inbox.taken > 20, "hardly any good one was taken")
    return INPUTS
