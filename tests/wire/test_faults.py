"""Faults on wires: what a reader of the bytes finds, against the codecs' own decoders and plain counting."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.pose import ncom
from vve_sumo.pose import nmea_encoder as nmea
from vve_sumo.values import FixQuality, Frame
from vve_sumo.wire import ars408, esr, faults
from vve_sumo.wire.datagrams import RadarDatagram, Target, decode_radar, encode_radar
from vve_sumo.wire.sample import no_fix

PERIOD = 0.02


def datagram(sequence: int, targets: int = 2) -> RadarDatagram:
    """A valid datagram of tick `sequence`, whose scan is as old as a tick."""
    now = 1000.0 + PERIOD * sequence
    seen = tuple(Target(n, 20.0 + n - 0.1 * sequence, 0.0, -8.0) for n in range(targets))
    return RadarDatagram(sequence, now, 0.1, now - PERIOD, 8.0, 0.0, seen)


def stream(fault: faults.WireFault, ticks: int, begins: int, ends: int) -> list[list[bytes]]:
    """What a wire with a fault from tick `begins` to before `ends` carries."""
    return [
        list(fault.step(PERIOD * n, (encode_radar(datagram(n)),), begins <= n < ends)) for n in range(ticks)
    ]  # fmt: skip


MADE = {
    "freeze": faults.Freeze,
    "drop_out": faults.DropOut,
    "delay": lambda: faults.Delay(0.06),
    "bit_flips": lambda: faults.BitFlips(Random(1)),
    "aged": lambda: faults.EditedRadar(faults.aged),
    "counter": lambda: faults.EditedRadar(faults.counter_stopped),
    "invalid": lambda: faults.EditedRadar(faults.marked_invalid),
    "nan": lambda: faults.EditedRadar(faults.not_a_number),
}


@pytest.mark.parametrize("name", MADE)
@settings(deadline=None)
@given(begins=st.integers(1, 15), lasts=st.integers(0, 15))
def test_a_fault_touches_nothing_outside_its_window_and_repeats_itself(name: str, begins: int, lasts: int) -> None:
    found = stream(MADE[name](), 30, begins, begins + lasts)
    assert found == stream(MADE[name](), 30, begins, begins + lasts)
    for n, carried in enumerate(found):
        healthy = [encode_radar(datagram(n))]
        assert (carried == healthy) == (not begins <= n < begins + lasts), n


@given(late=st.integers(1, 10))
def test_a_delay_carries_every_datagram_once_and_just_so_much_later(late: int) -> None:
    found = stream(faults.Delay(late * PERIOD), 30, 0, 30)
    assert found == [[encode_radar(datagram(n - late))] if n >= late else [] for n in range(30)]


def test_a_freeze_repeats_the_last_healthy_bytes_at_the_rate_of_the_wire() -> None:
    fault = faults.Freeze()
    assert fault.step(0.0, (b"a",), False) == (b"a",)
    assert fault.step(0.02, (), False) == ()
    assert [fault.step(0.0, due, True) for due in ((b"b",), (), (b"c",))] == [(b"a",), (), (b"a",)]


@given(data=st.binary(min_size=1, max_size=100), seed=st.integers(0, 99))
def test_one_bit_and_no_more_is_the_other_one(data: bytes, seed: int) -> None:
    (flipped,) = faults.BitFlips(Random(seed)).step(0.0, (data,), True)
    assert len(flipped) == len(data)
    assert sum((a ^ b).bit_count() for a, b in zip(data, flipped, strict=True)) == 1


def test_every_fifth_portion_is_hit_and_frames_as_well() -> None:
    frames = [Frame(0x500 + n, bytes(8)) for n in range(10)]
    hit = [a != b for a, b in zip(frames, faults.BitFlips(Random(1), 5).step(0.0, frames, True), strict=True)]
    assert hit == 2 * ([False] * 4 + [True])


@given(seed=st.integers(0, 200))
def test_every_flipped_bit_is_found_by_crc_and_by_checksums(seed: int) -> None:
    fix = replace(no_fix(1.4e9, 0.0), latitude=0.7, longitude=-1.4, heading=0.1, locked=True)
    packet = ncom.Encoder().encode(fix)
    (radar,) = faults.BitFlips(Random(seed)).step(0.0, (encode_radar(datagram(3)),), True)
    (place,) = faults.BitFlips(Random(seed)).step(0.0, (packet,), True)
    assert decode_radar(radar) is None
    assert len(ncom.Decoder().feed(packet, 0.0)) == 1
    assert ncom.Decoder().feed(place, 0.0) == []


def edited(edit: faults.RadarEdit) -> tuple[bytes, RadarDatagram, RadarDatagram]:
    """The third datagram of a stream that was healthy for two, with the one in its place and the last healthy one."""
    (data,) = stream(faults.EditedRadar(edit), 4, 2, 4)[3]
    assert zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    return data, datagram(3), datagram(1)


def test_edited_datagrams_have_a_right_crc_and_differ_in_one_thing() -> None:
    data, newest, last = edited(faults.aged)
    read = decode_radar(data)
    assert read is not None
    assert (read.sequence, read.time, read.measured) == (newest.sequence, newest.time, last.measured)
    assert read.targets[0].range == pytest.approx(last.targets[0].range)

    read = decode_radar(edited(faults.counter_stopped)[0])
    assert read is not None
    assert (read.sequence, read.time, read.measured) == (last.sequence, newest.time, newest.measured)

    read = decode_radar(edited(faults.marked_invalid)[0])
    assert read is not None
    assert not read.valid
    assert len(read.targets) == len(newest.targets)
    assert read.targets[0].range == pytest.approx(newest.targets[0].range)

    data = edited(faults.not_a_number)[0]
    assert decode_radar(data) is None
    assert math.isnan(struct.unpack_from("<f", data, 48)[0])
    assert data[6] & 1


def test_what_is_invalid_is_not_edited() -> None:
    nothing = encode_radar(replace(datagram(2), valid=False))
    assert faults.EditedRadar(faults.aged).step(0.0, (nothing,), True) == [nothing]


@pytest.mark.parametrize("dated", [False, True])
def test_nmea_without_a_fix_keeps_its_place_and_its_checksums(dated: bool) -> None:
    """Read by hand: fields between commas; the checksum is the exclusive or of all between $ and *."""
    fix = replace(
        no_fix(1.4e9, 0.0), latitude=0.7, longitude=-1.4, heading=0.1, velocity_north=3.0, velocity_east=4.0,
        velocity_down=0.0, altitude=200.0, locked=True, quality=FixQuality.RTK_FIXED,
    )  # fmt: skip
    healthy = nmea.encode(fix, dated=dated)
    (marked,) = faults.Rewritten(faults.nmea_without_fix).step(0.0, (healthy,), True)
    assert faults.Rewritten(faults.nmea_without_fix).step(0.0, (healthy,), False) == (healthy,)
    before, after = (text.decode().strip().split("\r\n") for text in (healthy, marked))
    assert len(before) == len(after) == (6 if dated else 5)
    for old, new in zip(before, after, strict=True):
        body, _, checksum = new.removeprefix("$").partition("*")
        total = 0
        for letter in body.encode():
            total ^= letter
        assert int(checksum, 16) == total
        differ = [
            (n, field) for n, (field, was) in enumerate(zip(body.split(","), old[1:-3].split(","), strict=True))
            if field != was
        ]  # fmt: skip
        assert differ == {"GGA": [(6, "0")], "RMC": [(2, "V")]}.get(body[2:5], [])


def test_a_radar_that_reports_an_error_shows_its_tracks_all_the_same() -> None:
    cycle = esr.Cycle(3, 0.1, esr.HostMotion(8.0, 0.0), (esr.Track(5, 20.0, 0.1, -8.0),))
    frames = faults.Rewritten(esr.with_internal_error).step(0.0, esr.encode(cycle), True)
    (read,) = esr.Decoder().feed(frames)
    assert (read.valid, [track.number for track in read.tracks]) == (False, [5])
    assert [old.id for old, new in zip(esr.encode(cycle), frames, strict=True) if old != new] == [esr.STATUS_2]

    found = ars408.ObjectList(3, (ars408.Object(7, 20.0, 1.0, -8.0),))
    frames = faults.Rewritten(ars408.with_persistent_error).step(0.0, ars408.encode(found), True)
    decoder = ars408.Decoder()
    (seen,) = decoder.feed(frames)
    assert (decoder.failed, [one.number for one in seen.objects]) == (True, [7])


def test_an_unlocked_packet_has_right_checksums_and_the_same_place() -> None:
    fix = replace(no_fix(1.4e9, 0.0), latitude=0.7, longitude=-1.4, heading=0.1, locked=True)
    packet = ncom.Encoder().encode(fix)
    (marked,) = faults.UnlockedNcom().step(0.0, (packet,), True)
    (read,) = ncom.Decoder().feed(marked, 0.0)
    assert (read.locked, read.latitude, read.longitude) == (False, 0.7, -1.4)
    assert ncom.with_status(packet, ncom.LOCKED) == packet
