"""What the tests of UBX, SBF and NovAtel share: drives as bytes, and streams as bad as lines make them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace

from hypothesis import strategies as st

from tests.pose.test_trust import EPOCH, drive
from vve_sumo.pose.stream import StreamDecoder
from vve_sumo.values import Fix, FixQuality

DELAY = 0.01
Encode = Callable[[Fix], bytes]

#: fixes anywhere, at any time from 2011 to 2031, to the millisecond
FIXES = st.builds(
    lambda milliseconds, latitude, longitude, heading, north, east, quality: replace(
        drive(1)[0],
        time=1e-3 * milliseconds,
        latitude=latitude,
        longitude=longitude,
        heading=heading,
        velocity_north=north,
        velocity_east=east,
        quality=quality,
    ),
    st.integers(1_000_000_000_000, 1_640_000_000_000),
    st.floats(-1.5, 1.5),
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi, math.pi),
    st.floats(-50.0, 50.0),
    st.floats(-50.0, 50.0),
    st.sampled_from([FixQuality.SINGLE, FixQuality.DIFFERENTIAL, FixQuality.RTK_FLOAT, FixQuality.RTK_FIXED]),
)


def sent(encode: Encode, count: int) -> list[tuple[float, bytes]]:
    """A drive of 100 fixes a second as rows of arrival and bytes."""
    return [(fix.time - EPOCH + DELAY, encode(fix)) for fix in drive(count)]


def fed(decoder: StreamDecoder, rows: list[tuple[float, bytes]]) -> list[Fix]:
    return [fix for received, data in rows for fix in decoder.feed(data, received)]


def content(fix: Fix) -> str:
    """What the messages of one time say: not the arrival, what is differenced, or what comes less often."""
    names = (
        "time",
        "latitude",
        "longitude",
        "altitude",
        "heading",
        "velocity_north",
        "velocity_east",
        "locked",
        "quality",
    )
    return repr([getattr(fix, name) for name in names])


def spoilt(chance: random.Random, data: bytes) -> bytes:
    """A portion with a bit flipped, cut short, or with garbage in it that may look like a beginning."""
    kind = chance.randrange(4)
    if kind == 0:
        changed = bytearray(data)
        changed[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        return bytes(changed)
    if kind == 1:
        return data[: chance.randrange(len(data))]
    garbage = chance.choice(
        (chance.randbytes(40), data[:9], b"$GPGGA,12", b"#INSPVAXA,CO", b"$@\x00\x00", b"\xb5b\x01\x07")
    )
    place = 0 if kind == 2 else chance.randrange(len(data))
    return data[:place] + garbage + data[place:]


def hold_in_noise(make: Callable[[], StreamDecoder], encode: Encode, seed: int) -> None:
    """Hold a decoder to a drive of which every third portion is spoilt: no wrong fix, and none of a whole one lost."""
    chance = random.Random(seed)
    rows = sent(encode, 60)
    expected = [content(fix) for fix in fed(make(), rows)]
    assert len(expected) == len(rows)
    whole = {k for k in range(len(rows)) if chance.random() > 0.33}
    stream = [(at, data if k in whole else spoilt(chance, data)) for k, (at, data) in enumerate(rows)]
    decoder = make()
    # Quiet at the end, in which what looked like the beginning of a message turns out to be none.
    found = [content(fix) for fix in fed(decoder, [*stream, (rows[-1][0], bytes(5000))])]
    assert set(found) <= set(expected)
    assert {expected[k] for k in whole} <= set(found)
    assert found == sorted(found, key=expected.index), "in the order of their times"
    assert decoder.held == 0


def hold_without_delay(make: Callable[[], StreamDecoder], encode: Encode) -> None:
    """Hold a decoder to giving every whole portion's fix at once, however much of the one before it was lost."""
    (first, one), (second, other) = sent(encode, 2)
    for kept in range(len(one)):
        decoder = make()
        before = decoder.feed(one[:kept], first)
        fixes = decoder.feed(other, second)
        assert [fix.time_received for fix in fixes] == [second], kept
        assert [content(fix) for fix in fixes] == [content(fix) for fix in make().feed(other, second)]
        assert len(before) <= 1
