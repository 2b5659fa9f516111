"""OXTS CAN: both ways against a DBC written from the manuals' tables, and frames as bad as a bus makes them."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fixes import ACCURACIES
from tests.pose.ncom_packets import fix_at
from vve_sumo.pose.oxts_can import LOCKING, Decoder, Encoder, Outcome
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Fix, Frame

START = 1_300_000_020.0
DBC = cantools.database.load_string(
    """VERSION ""
BU_: RT
BO_ 1537 LatitudeLongitude: 8 RT
 SG_ PosLat : 0|32@1- (1E-007,0) [0|0] "deg" RT
 SG_ PosLon : 32|32@1- (1E-007,0) [0|0] "deg" RT
BO_ 1538 Altitude: 4 RT
 SG_ Altitude : 0|32@1- (0.001,0) [0|0] "m" RT
BO_ 1539 Velocity: 8 RT
 SG_ VelNorth : 0|16@1- (0.01,0) [0|0] "m/s" RT
 SG_ VelEast : 16|16@1- (0.01,0) [0|0] "m/s" RT
 SG_ VelDown : 32|16@1- (0.01,0) [0|0] "m/s" RT
 SG_ Speed2D : 48|16@1+ (0.01,0) [0|0] "m/s" RT
BO_ 1541 AccelVehicle: 6 RT
 SG_ AccelX : 0|16@1- (0.01,0) [0|0] "m/s2" RT
 SG_ AccelY : 16|16@1- (0.01,0) [0|0] "m/s2" RT
 SG_ AccelZ : 32|16@1- (0.01,0) [0|0] "m/s2" RT
BO_ 1542 AccelLevel: 8 RT
 SG_ AccelForward : 0|16@1- (0.01,0) [0|0] "m/s2" RT
 SG_ AccelLateral : 16|16@1- (0.01,0) [0|0] "m/s2" RT
 SG_ AccelDown : 32|16@1- (0.01,0) [0|0] "m/s2" RT
 SG_ AccelSlip : 48|16@1- (0.01,0) [0|0] "m/s2" RT
BO_ 1543 HeadingPitchRoll: 6 RT
 SG_ AngleHeading : 0|16@1+ (0.01,0) [0|0] "deg" RT
 SG_ AnglePitch : 16|16@1- (0.01,0) [0|0] "deg" RT
 SG_ AngleRoll : 32|16@1- (0.01,0) [0|0] "deg" RT
BO_ 1544 RateVehicle: 6 RT
 SG_ AngRateX : 0|16@1- (0.01,0) [0|0] "deg/s" RT
 SG_ AngRateY : 16|16@1- (0.01,0) [0|0] "deg/s" RT
 SG_ AngRateZ : 32|16@1- (0.01,0) [0|0] "deg/s" RT
BO_ 1545 RateLevel: 6 RT
 SG_ AngRateForward : 0|16@1- (0.01,0) [0|0] "deg/s" RT
 SG_ AngRateLateral : 16|16@1- (0.01,0) [0|0] "deg/s" RT
 SG_ AngRateDown : 32|16@1- (0.01,0) [0|0] "deg/s" RT
BO_ 1584 MilliTime: 7 RT
 SG_ MilliTime : 0|48@1- (1,0) [0|0] "ms" RT
 SG_ UtcOffset : 48|8@1- (1,0) [0|0] "s" RT
""",
    "dbc",
)


def frame(name: str, **signals: float) -> Frame:
    message = DBC.get_message_by_name(name)
    return Frame(message.frame_id, bytes(message.encode(signals)))


def cycle(time: float, **without: bool) -> list[Frame]:
    """What a unit sends in one cycle, by the DBC, in the order of identifiers."""
    frames = [
        frame("LatitudeLongitude", PosLat=39.9980512, PosLon=-82.9832109),
        frame("Altitude", Altitude=231.4),
        frame("Velocity", VelNorth=4.23, VelEast=9.06, VelDown=-0.12, Speed2D=10.0),
        frame("AccelVehicle", AccelX=0.31, AccelY=0.02, AccelZ=-9.8),
        frame("HeadingPitchRoll", AngleHeading=65.0, AnglePitch=1.5, AngleRoll=-0.5),
        frame("RateVehicle", AngRateX=0.0, AngRateY=0.0, AngRateZ=5.73),
        frame("MilliTime", MilliTime=round(time * 1000), UtcOffset=-18),
    ]
    return [one for one in frames if not without.get(DBC.get_message_by_frame_id(one.id).name)]


def fed(frames) -> list[Fix]:
    return Decoder().feed_frames(frames, 0.0)


def test_frames_of_the_manual_s_tables_become_a_fix():
    (fix,) = Decoder().feed_frames(cycle(START), 7.5)
    assert fix.time == START
    assert fix.time_received == 7.5
    assert math.degrees(fix.latitude) == pytest.approx(39.9980512, abs=1e-9)
    assert math.degrees(fix.longitude) == pytest.approx(-82.9832109, abs=1e-9)
    assert (fix.altitude, fix.velocity_north, fix.velocity_east) == pytest.approx((231.4, 4.23, 9.06))
    assert fix.velocity_down == pytest.approx(-0.12)
    assert math.degrees(fix.heading) == pytest.approx(25.0)
    assert (math.degrees(fix.pitch), math.degrees(fix.roll)) == pytest.approx((1.5, -0.5))
    assert math.degrees(fix.yaw_rate) == pytest.approx(-5.73)
    assert fix.acceleration == pytest.approx(0.31)


def test_frames_of_the_encoder_mean_the_same_to_a_dbc():
    sent = fix_at(START, latitude=0.6983, longitude=-1.4483, heading=-2.0, velocity_north=-3.0)
    said = {one.id: DBC.decode_message(one.id, one.data) for one in Encoder().encode(sent) if one.id > 0x600}
    assert said[0x601]["PosLat"] == pytest.approx(math.degrees(0.6983), abs=0.51e-7)
    assert said[0x601]["PosLon"] == pytest.approx(math.degrees(-1.4483), abs=0.51e-7)
    assert said[0x603] == pytest.approx({"VelNorth": -3.0, "VelEast": 4.0, "VelDown": -0.1, "Speed2D": 5.0})
    assert said[0x607]["AngleHeading"] == pytest.approx(90.0 + math.degrees(2.0), abs=0.0051)
    assert said[0x608]["AngRateZ"] == pytest.approx(-math.degrees(0.1), abs=0.0051)
    assert said[0x605]["AccelX"] == 0.5
    assert said[0x630] == {"MilliTime": round(START * 1000), "UtcOffset": -18}


angles = st.floats(-math.pi, math.pi)


@given(
    latitude=st.floats(-math.pi / 2, math.pi / 2),
    pitch=st.floats(-1.5, 1.5),
    yaw_rate=st.floats(-5, 5),
    **dict.fromkeys(("longitude", "heading", "roll"), angles),
    **dict.fromkeys(("velocity_north", "velocity_east", "acceleration"), st.floats(-300, 300)),
    **ACCURACIES,
    milliseconds=st.integers(0, 10**9),
)
def test_round_trip_to_the_last_bit(milliseconds, **fields):
    sent = fix_at(START + milliseconds / 1000.0, **fields)
    encoder = Encoder()
    frames = [one for k in range(6) for one in encoder.encode(replace(sent, time=sent.time + k / 1000))]
    fix, *_, last = fed(frames)
    assert fix.time == sent.time
    for name, bit in (("latitude", 1e-7), ("longitude", 1e-7), ("heading", 0.01), ("pitch", 0.01), ("roll", 0.01)):
        off = math.degrees(math.remainder(getattr(fix, name) - getattr(sent, name), math.tau))
        assert abs(off) <= 0.5001 * bit, name
    for name, bit in (("velocity_north", 0.01), ("velocity_east", 0.01), ("acceleration", 0.01)):
        assert abs(getattr(fix, name) - getattr(sent, name)) <= 0.5001 * bit, name
    assert abs(fix.yaw_rate - sent.yaw_rate) <= 0.5001 * math.radians(0.01)
    assert last.quality is sent.quality
    for name, bit in (("position_sigma", 1e-3), ("velocity_sigma", 1e-3), ("heading_sigma", 1e-5)):
        assert abs(getattr(last, name) - getattr(sent, name)) <= 0.5001 * bit, name
    assert last.differential_age == pytest.approx(sent.differential_age, abs=0.0051)


@pytest.mark.parametrize("compass", [0.0, 0.001, 359.994, 359.996, 180.0, 270.0])
def test_headings_about_north(compass):
    heading = math.remainder(math.radians(90.0 - compass), math.tau)
    (fix,) = fed(Encoder().encode(fix_at(START, heading=heading)))
    assert math.degrees(math.remainder(fix.heading - heading, math.tau)) == pytest.approx(0.0, abs=0.0051)


# --- cycles -----------------------------------------------------------------------------------------------------------


def test_what_did_not_come_in_its_cycle_is_not_a_number():
    frames = cycle(START) + cycle(START + 0.01, HeadingPitchRoll=True, RateVehicle=True, AccelVehicle=True)
    first, second = fed(frames)
    assert math.isfinite(first.heading + first.yaw_rate + first.acceleration)
    assert all(math.isnan(value) for value in (second.heading, second.pitch, second.yaw_rate, second.acceleration))
    assert second.velocity_north == first.velocity_north


def test_no_position_is_no_fix():
    decoder = Decoder()
    assert decoder.feed_frames(cycle(START, LatitudeLongitude=True), 0.0) == []
    assert decoder.counts[Outcome.INCOMPLETE] == 1


def test_level_frames_serve_where_the_vehicle_s_axes_are_not_sent():
    frames = cycle(START, AccelVehicle=True, RateVehicle=True)
    level = frame("AccelLevel", AccelForward=0.5, AccelLateral=0.0, AccelDown=0.0, AccelSlip=0.0)
    turn = frame("RateLevel", AngRateForward=0.0, AngRateLateral=0.0, AngRateDown=-10.0)
    (fix,) = fed([level, turn, *frames])
    assert fix.acceleration == pytest.approx(0.5 + 9.80665 * math.sin(math.radians(1.5)))
    assert math.degrees(fix.yaw_rate) == pytest.approx(10.0)


def test_a_lost_time_frame_mixes_no_cycles():
    """A run of frames lost from the middle of one cycle to the middle of the next looks whole, but for its time."""
    whole = cycle(START) + cycle(START + 0.01)
    decoder = Decoder()
    fixes = decoder.feed_frames(whole + cycle(START + 0.02)[:3] + cycle(START + 0.03)[3:] + cycle(START + 0.04), 0.0)
    assert [fix.time - START for fix in fixes] == pytest.approx([0.0, 0.01, 0.04], abs=1e-6)
    assert decoder.counts[Outcome.TIME_LOST] == 1


def test_duplicates_and_a_clock_that_goes_back_make_no_fix():
    decoder = Decoder()
    assert len(decoder.feed_frames(cycle(START) + cycle(START) + cycle(START - 5.0), 0.0)) == 1
    assert decoder.counts[Outcome.NOT_INCREASING] == 2


@pytest.mark.parametrize("milliseconds", [0, -1, 59_999_999, -(1 << 47), (1 << 47) - 1])
def test_a_unit_that_does_not_know_the_time_gives_no_fix(milliseconds):
    decoder = Decoder()
    frames = [*cycle(START, MilliTime=True), frame("MilliTime", MilliTime=milliseconds, UtcOffset=0)]
    assert decoder.feed_frames(frames, 0.0) == []
    assert decoder.counts[Outcome.NO_TIME] == 1


@pytest.mark.parametrize(("latitude", "longitude"), [(91.0, 0.0), (0.0, 181.0), (-214.0, 0.0)])
def test_impossible_positions_are_not_fixes(latitude, longitude):
    position = frame("LatitudeLongitude", PosLat=latitude, PosLon=longitude)
    assert fed([position, *cycle(START, LatitudeLongitude=True)]) == []


def test_locked_only_after_cycles_without_a_break():
    times = [0.0, 0.5, *(1.0 + 0.01 * k for k in range(2000)), *(30.0 + 0.01 * k for k in range(1300))]
    fixes = fed([one for time in times for one in Encoder().encode(fix_at(START + time))])
    locked = [fix.time - START for fix in fixes if fix.locked]
    breaks = [after for before, after in itertools.pairwise(locked) if after - before > 1.0]
    assert locked[0] == pytest.approx(LOCKING / 1000, abs=0.02)
    assert breaks == [pytest.approx(30.0 + LOCKING / 1000, abs=0.02)]


def test_a_drive_over_can_is_trusted_also_when_it_creeps():
    """At 0.3 m/s and 100 Hz the position stands still for three fixes in a row: 1.1 cm is its last digit."""
    encoder, gate, decoder, newest = Encoder(), TrustGate(DRIVE, START), Decoder(), -math.inf
    gaps = []
    for k in range(3000):
        time = k * 0.01
        fix = fix_at(
            START + time,
            latitude=0.6983 + 0.3 * time / 6_371_000,
            velocity_north=0.3,
            velocity_east=0.0,
            yaw_rate=0.0,
            acceleration=0.0,
        )
        for one in decoder.feed_frames(encoder.encode(fix), time):
            if gate.step(time + 0.01, one).trusted:
                gaps.append(time - newest)
                newest = time
    assert newest == pytest.approx(29.99, abs=0.05)
    assert len(gaps) > 1000 / 3
    assert max(gaps[1:]) < DRIVE.stale_limit / 2


# --- bad buses --------------------------------------------------------------------------------------------------------

IDENTIFIERS = st.sampled_from([*range(0x600, 0x60A), 0x630, 0x500, 0x503, 0x504, 0x505, 0x514, 0x5FF, 0x123])


@given(st.lists(st.tuples(IDENTIFIERS, st.binary(max_size=8)), max_size=60))
def test_any_frames_are_survived(pairs):
    decoder = Decoder()
    fixes = decoder.feed_frames(cycle(START) + [Frame(*pair) for pair in pairs] + cycle(START + 1.0), 0.0)
    assert all(math.isfinite(fix.time + fix.latitude + fix.longitude) for fix in fixes)
    assert all(before.time < after.time for before, after in itertools.pairwise(fixes))
    assert sum(decoder.counts.values()) + decoder.discarded == len(pairs) + 14


@pytest.mark.thorough
@settings(max_examples=200)
@given(st.integers(0, 2**32))
def test_lost_and_doubled_frames_never_mix_cycles(seed):
    """Each cycle's north velocity, heading and latitude are its own number."""
    chance, frames = random.Random(seed), []
    for k in range(1, 4):  # at first the unit's period is learnt
        frames += Encoder().encode(fix_at(START + k))
    for k in range(4, 60):
        own = {"latitude": math.radians(k), "velocity_north": float(k), "heading": math.radians(k)}
        frames += [
            one for one in Encoder().encode(fix_at(START + k, **own)) for _ in range(chance.choice([0, 1, 1, 2]))
        ]
    for fix in fed(frames)[3:]:
        k = round(fix.time - START)
        assert math.degrees(fix.latitude) == pytest.approx(k)
        assert math.isnan(fix.velocity_north) or fix.velocity_north == pytest.approx(k)
        assert math.isnan(fix.heading) or math.degrees(fix.heading) == pytest.approx(k, abs=0.006)


# --- a time frame that lies -------------------------------------------------------------------------------------------


def on_the_bus(count: int, begin: float = 0.0) -> list[tuple[float, list[Frame]]]:
    """Arrivals and cycles at 100 Hz, 5 ms late."""
    return [(begin + 0.01 * k + 0.005, cycle(START + begin + 0.01 * k)) for k in range(count)]


@pytest.mark.parametrize("ahead", [-20.0, -1.0, 0.01, 0.5, 12.0, 86_400.0])
def test_one_wrong_time_between_the_cycles_costs_no_more_than_one_of_them(ahead):
    """Nor does the unit count as locking again, which takes twelve seconds."""
    rows = on_the_bus(2000)
    lie = frame("MilliTime", MilliTime=round((START + 15.0 + ahead) * 1000), UtcOffset=-18)
    rows[1500] = (rows[1500][0], [lie, *rows[1500][1]])
    decoder, fixes = Decoder(), []
    for received, frames in rows:
        fixes += decoder.feed_frames(frames, received)
    assert len(fixes) >= 1999
    assert all(fix.locked for fix in fixes if fix.time > START + 12.1)
    assert decoder.counts[Outcome.AHEAD] + decoder.counts[Outcome.NOT_INCREASING] == 1


def test_a_unit_whose_clock_goes_back_counts_as_locking_again_once_it_has_caught_up():
    decoder, fixes = Decoder(), []
    for received, frames in on_the_bus(1500):
        fixes += decoder.feed_frames(frames, received)
    assert fixes[-1].locked
    for k in range(300):  # a second in arrears, catching up at half a second a second
        time = START + 15.0 - 1.0 + 0.015 * k
        fixes += decoder.feed_frames(cycle(time), 15.0 + 0.01 * k + 0.005)
    assert fixes[-1].time > START + 17.0
    assert not fixes[-1].locked
