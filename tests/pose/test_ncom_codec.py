"""NCOM codec: a genuine packet, round trips to the last bit, and what statuses and their channels say."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import ACCURACIES
from tests.pose.ncom_packets import NOTHING, START, decoded, fix_at, minute_channel, sealed, with_status
from vve_sumo.pose.ncom import Decoder, Encoder, Outcome, checksums_hold, pack
from vve_sumo.values import FixQuality

# --- a genuine packet -------------------------------------------------------------------------------------------------


def test_genuine_packet_decodes_to_its_known_values(shared_data):
    packet = bytes.fromhex((shared_data / "ncom" / "real_packet.hex").read_text())
    known = json.loads((shared_data / "ncom" / "real_packet.json").read_text())
    decoder = Decoder()
    (fix,) = decoder.feed(packet, 0.0)
    assert checksums_hold(packet)
    assert decoder.codes == (known["nav"], known["pos_mode"]) == (2, 3)
    assert not fix.locked
    assert fix.time == pytest.approx(known["minutes"] * 60 + known["ms"] / 1000, abs=1e-6)
    assert (fix.latitude, fix.longitude) == (known["lat_rad"], known["lon_rad"])
    assert fix.altitude == pytest.approx(known["alt"], abs=1e-6)
    assert fix.velocity_north == pytest.approx(known["vn"])
    assert fix.velocity_east == pytest.approx(known["ve"])
    assert fix.velocity_down == pytest.approx(known["vd"])
    assert fix.acceleration == pytest.approx(known["ax"])
    assert fix.quality is FixQuality.SINGLE
    assert all(math.isnan(angle) for angle in (fix.heading, fix.pitch, fix.roll))
    assert math.isnan(fix.position_sigma)


# --- round trip -------------------------------------------------------------------------------------------------------

angles = st.floats(-math.pi, math.pi)
small = st.floats(-800.0, 800.0)


@given(
    latitude=st.floats(-math.pi / 2, math.pi / 2),
    altitude=st.floats(-500, 9000),
    yaw_rate=st.floats(-80, 80),
    **dict.fromkeys(("longitude", "heading", "pitch", "roll"), angles),
    **dict.fromkeys(("velocity_north", "velocity_east", "velocity_down", "acceleration"), small),
    **ACCURACIES,
    locked=st.booleans(),
    milliseconds=st.integers(0, 10**8),
)
def test_round_trip_to_the_last_bit(milliseconds, **fields):
    sent = fix_at(START + milliseconds / 1000.0, **fields)
    encoder = Encoder()
    (fix, *_, last) = decoded(b"".join(encoder.encode(replace(sent, time=sent.time + k / 1000)) for k in range(6)))
    assert fix.time == sent.time
    assert (fix.latitude, fix.longitude, fix.locked) == (sent.latitude, sent.longitude, sent.locked)
    assert fix.altitude == struct.unpack("<f", struct.pack("<f", sent.altitude))[0]
    assert abs(math.remainder(fix.heading - sent.heading, math.tau)) <= 0.6e-6
    assert -math.pi <= fix.heading <= math.pi
    for name, bit in (
        ("pitch", 1e-6),
        ("roll", 1e-6),
        ("velocity_north", 1e-4),
        ("velocity_east", 1e-4),
        ("velocity_down", 1e-4),
        ("yaw_rate", 1e-5),
        ("acceleration", 1e-4),
    ):
        assert abs(getattr(fix, name) - getattr(sent, name)) <= 0.5001 * bit, name
    assert last.quality is sent.quality
    for name, bit in (
        ("position_sigma", 1e-3),
        ("velocity_sigma", 1e-3),
        ("heading_sigma", 1e-5),
        ("differential_age", 1e-2),
    ):
        assert abs(getattr(last, name) - getattr(sent, name)) <= 0.5001 * bit, name


def field(packet: bytes, offset: int, scale: float) -> float:
    """A 24-bit field as the manual words it: three bytes, lowest first, in two's complement; the lowest is invalid."""
    raw = int.from_bytes(packet[offset : offset + 3], "little", signed=True)
    return math.nan if raw == -(2**23) else raw * scale


@given(st.binary(min_size=48, max_size=48), angles, angles, st.integers(0, 17))
def test_every_field_is_read_from_its_own_bytes(body, latitude, longitude, invalid):
    """All fields hold any bits, one of them the pattern for invalid; the offsets are those of OXTS's manual."""
    packet = bytearray(pack(fix_at(START, latitude=latitude / 2, longitude=longitude), 0, minute_channel(START)))
    packet[3:21], packet[39:61] = body[:18], body[18:40]
    at = [3, 18, 43, 46, 49, 52, 55, 58][invalid % 8]
    if invalid >= 8:
        packet[at : at + 3] = b"\x00\x00\x80"
    (fix,) = decoded(sealed(bytes(packet)))
    (altitude,) = struct.unpack_from("<f", packet, 39)
    expected = {
        "latitude": latitude / 2,
        "longitude": longitude,
        "altitude": altitude if math.isfinite(altitude) else math.nan,
        "acceleration": field(packet, 3, 1e-4),
        "yaw_rate": -field(packet, 18, 1e-5),
        "velocity_north": field(packet, 43, 1e-4),
        "velocity_east": field(packet, 46, 1e-4),
        "velocity_down": field(packet, 49, 1e-4),
        "pitch": field(packet, 55, 1e-6),
        "roll": field(packet, 58, 1e-6),
    }
    assert {name: getattr(fix, name) for name in expected} == pytest.approx(expected, rel=0, abs=0, nan_ok=True)
    off = math.remainder(fix.heading + field(packet, 52, 1e-6) - math.pi / 2, math.tau)
    assert abs(off) < 1e-12 or math.isnan(off) == math.isnan(fix.heading) == (packet[52:55] == b"\x00\x00\x80")


@given(st.binary(min_size=72, max_size=72), st.lists(st.booleans(), min_size=3, max_size=3))
def test_checksums_are_the_sums_of_all_bytes_before(packet, right):
    """Without the sync byte, to the modulus 256; `right` says which of the three are made so."""
    packet = bytearray(packet)
    for end, made in zip((22, 61, 71), right, strict=True):
        if made:
            packet[end] = sum(packet[1:end]) % 256
    assert checksums_hold(bytes(packet)) == all(packet[end] == sum(packet[1:end]) % 256 for end in (22, 61, 71))


@pytest.mark.parametrize(
    ("compass_deg", "heading_deg"), [(0, 90), (90, 0), (180, -90), (270, 180), (350, 100), (10, 80), (359.9, 90.1)]
)
def test_heading_is_sent_clockwise_from_north(compass_deg, heading_deg):
    packet = pack(fix_at(START, heading=math.radians(heading_deg)), 0, minute_channel(START))
    raw = int.from_bytes(packet[52:55], "little", signed=True) * 1e-6
    assert math.degrees(math.remainder(raw - math.radians(compass_deg), math.tau)) == pytest.approx(0, abs=1e-4)


def test_yaw_rate_is_sent_about_the_downward_axis():
    packet = pack(fix_at(START, yaw_rate=0.25), 0, minute_channel(START))
    assert int.from_bytes(packet[18:21], "little", signed=True) == -25_000


def test_not_a_number_is_sent_as_invalid_and_comes_back():
    gone = {"heading": math.nan, "velocity_north": math.nan, "acceleration": math.nan, "yaw_rate": math.nan}
    packet = pack(fix_at(START, **gone), 0, minute_channel(START))
    assert packet[52:55] == b"\x00\x00\x80"
    (fix,) = decoded(packet)
    assert all(math.isnan(getattr(fix, name)) for name in gone)
    assert fix.velocity_east == pytest.approx(4.0)


def test_what_does_not_fit_saturates_and_is_not_invalid():
    (fix,) = decoded(pack(fix_at(START, velocity_north=-5000.0, acceleration=math.inf), 0, minute_channel(START)))
    assert fix.velocity_north == pytest.approx(-838.8607)
    assert fix.acceleration == pytest.approx(838.8607)


# --- statuses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "outcome"),
    [
        (0, Outcome.NOT_NAVIGATION),
        (1, Outcome.NOT_NAVIGATION),
        (5, Outcome.NOT_NAVIGATION),
        (6, Outcome.NOT_NAVIGATION),
        (7, Outcome.NOT_NAVIGATION),
        (10, Outcome.STATUS_ONLY),
        (11, Outcome.STRUCTURE_B),
        (20, Outcome.TRIGGER),
        (21, Outcome.TRIGGER),
        (22, Outcome.TRIGGER),
        (99, Outcome.NOT_NAVIGATION),
    ],
)
def test_other_packets_are_never_fixes_and_do_not_move_the_clock(status, outcome):
    far = START + 31 * 60.0
    odd = with_status(status, pack(fix_at(far), 0, minute_channel(far)))
    decoder = Decoder()
    data = pack(fix_at(START), 0, minute_channel(START)) + odd + pack(fix_at(START + 0.01), 16, NOTHING)
    assert [fix.time for fix in decoder.feed(data, 0.0)] == [START, START + 0.01]
    assert decoder.counts[outcome] == 1


def test_structure_b_does_not_even_say_an_accuracy():
    accuracy = struct.pack("<HHHBB", 5, 5, 5, 0, 0)
    start = pack(fix_at(START), 0, minute_channel(START))
    probe = pack(fix_at(START + 0.02), 16, NOTHING)
    structure_b = with_status(11, pack(fix_at(START + 0.01), 3, accuracy))
    status_only = with_status(10, pack(fix_at(START + 0.01), 3, accuracy))
    assert math.isnan(decoded(start + structure_b + probe)[-1].position_sigma)
    assert decoded(start + status_only + probe)[-1].position_sigma == pytest.approx(0.005)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.6, 1e300])
def test_impossible_positions_are_not_fixes(bad):
    decoder = Decoder()
    assert decoder.feed(pack(fix_at(START, latitude=bad), 0, minute_channel(START)), 0.0) == []
    assert decoder.counts[Outcome.NO_POSITION] == 1


# --- what travels in status channels ----------------------------------------------------------------------------------


def test_accuracies_are_the_worse_axis_and_expire_by_their_age_counter():
    start = pack(fix_at(START), 0, minute_channel(START))
    fresh = pack(fix_at(START + 0.01), 3, struct.pack("<HHHBB", 11, 17, 99, 149, 0))
    stale = pack(fix_at(START + 0.02), 3, struct.pack("<HHHBB", 11, 17, 99, 150, 0))
    fixes = decoded(start + fresh + stale)
    assert fixes[1].position_sigma == pytest.approx(0.017)
    assert math.isnan(fixes[2].position_sigma)


def test_a_channel_that_is_not_repeated_says_nothing_any_more():
    start = pack(fix_at(START), 0, minute_channel(START))
    said = pack(fix_at(START + 0.01), 5, struct.pack("<HHHBB", 200, 0, 0, 0, 0))
    silence = b"".join(pack(fix_at(START + 0.02 + 0.1 * k), 16, NOTHING) for k in range(80))
    fixes = decoded(start + said + silence)
    sigmas = [fix.heading_sigma for fix in fixes if fix.time > START]
    known = [fix.time - START for fix in fixes if not math.isnan(fix.heading_sigma)]
    assert sigmas[0] == pytest.approx(0.002)
    assert 2.0 < max(known) <= 5.01
    assert {fix.quality for fix in fixes if fix.time > START + 5.0} == {FixQuality.UNKNOWN}


#: position modes as the manual words them; "gx" and "ix" are the unit's own tightly coupled solutions
MODE_WORDS = {
    "none": FixQuality.NONE, "search": FixQuality.NONE, "Doppler": FixQuality.NONE, "SPS": FixQuality.SINGLE,
    "differential": FixQuality.DIFFERENTIAL, "RTK float": FixQuality.RTK_FLOAT, "RTK integer": FixQuality.RTK_FIXED,
    "SBAS": FixQuality.DIFFERENTIAL, "OmniSTAR VBS": FixQuality.DIFFERENTIAL, "OmniSTAR HP": FixQuality.PPP,
    "no data": FixQuality.NONE, "blanked": FixQuality.NONE, "Doppler, post-processed": FixQuality.NONE,
    "SPS, post-processed": FixQuality.SINGLE, "differential, post-processed": FixQuality.DIFFERENTIAL,
    "RTK float, post-processed": FixQuality.RTK_FLOAT, "RTK integer, post-processed": FixQuality.RTK_FIXED,
    "OmniSTAR XP": FixQuality.PPP, "CDGPS": FixQuality.DIFFERENTIAL, "not recognised": FixQuality.UNKNOWN,
    "gx Doppler": FixQuality.NONE, "gx SPS": FixQuality.SINGLE, "gx differential": FixQuality.DIFFERENTIAL,
    "gx float": FixQuality.RTK_FLOAT, "gx integer": FixQuality.RTK_FIXED,
    "ix Doppler": FixQuality.NONE, "ix SPS": FixQuality.SINGLE, "ix differential": FixQuality.DIFFERENTIAL,
    "ix float": FixQuality.RTK_FLOAT, "ix integer": FixQuality.RTK_FIXED,
    "PPP converging": FixQuality.PPP, "PPP": FixQuality.PPP,
}  # fmt: skip


@pytest.mark.parametrize("mode", range(256))
def test_a_position_mode_becomes_a_quality(mode):
    """RTK-fixed are 6, 16, 24 and 29 alone, for on these a car drives."""
    packet = pack(fix_at(START), 0, struct.pack("<iBBBB", int(START // 60), 12, mode, 6, 6))
    decoder = Decoder()
    (fix,) = decoder.feed(packet, 0.0)
    assert fix.quality is dict(enumerate(MODE_WORDS.values())).get(mode, FixQuality.UNKNOWN)
    assert (fix.quality is FixQuality.RTK_FIXED) == (mode in (6, 16, 24, 29))
    assert decoder.codes == (4, mode if mode < 0x80 else -1)


@pytest.mark.parametrize("status", [2, 3, 4])
def test_only_status_4_is_locked(status):
    decoder = Decoder()
    (fix,) = decoder.feed(with_status(status, pack(fix_at(START), 0, minute_channel(START))), 0.0)
    assert fix.locked == (status == 4)
    assert decoder.codes[0] == status


@pytest.mark.parametrize("value", [0x80, 0xFF, 0x86])
def test_position_mode_with_its_top_bit_set_is_not_known(value):
    (fix,) = decoded(pack(fix_at(START), 0, struct.pack("<iBBBB", int(START // 60), 12, value, 6, 6)))
    assert fix.quality is FixQuality.UNKNOWN


def test_encoder_sends_what_is_not_known_as_stale():
    unknown = {"position_sigma": math.nan, "differential_age": math.nan, "quality": FixQuality.UNKNOWN}
    encoder = Encoder()
    last = decoded(b"".join(encoder.encode(fix_at(START + 0.01 * k, **unknown)) for k in range(6)))[-1]
    assert math.isnan(last.position_sigma)
    assert math.isnan(last.differential_age)
    assert last.quality is FixQuality.UNKNOWN
    assert last.velocity_sigma == pytest.approx(0.02)
