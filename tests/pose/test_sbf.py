"""SBF: written and read by pysbf2, streams as bad as lines make them, and which values are believed."""

from __future__ import annotations

import io
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pysbf2 import SBFMessage, SBFReader

from tests.pose.stream_bench import FIXES, fed, hold_in_noise, hold_without_delay, sent
from tests.pose.test_trust import EPOCH
from vve_sumo.frames import wrap_angle
from vve_sumo.pose import sbf
from vve_sumo.pose.sbf_encoder import Encoder
from vve_sumo.pose.stream import Outcome
from vve_sumo.pose.trust import SBF, TrustGate
from vve_sumo.values import Fix, FixQuality

WEEK = 604_800
NO_NUMBER = -2e10
NOON = 2400 * WEEK + 3 * 86_400 + 43_200.0


def crc(data: bytes) -> int:
    """CRC-CCITT by its definition, bit by bit."""
    remainder = 0
    for byte in data:
        remainder ^= byte << 8
        for _ in range(8):
            remainder = (remainder << 1 ^ (0x1021 if remainder & 0x8000 else 0)) & 0xFFFF
    return remainder


def block(name: str, seconds: float, *, revision: int = 0, **fields: float) -> bytes:
    """A block at a GPS time, as pysbf2 writes it."""
    milliseconds = round(1e3 * seconds)
    time = {"TOW": milliseconds % (1000 * WEEK), "WNc": milliseconds // (1000 * WEEK)}
    data: bytes = SBFMessage(name, **(time | fields)).serialize()
    # pysbf2 writes every block as one of revision 0; the revision is the upper three bits of the number.
    protected = data[4:5] + bytes([data[5] | revision << 5]) + data[6:]
    return data[:2] + crc(protected).to_bytes(2, "little") + protected


def pvt(seconds: float = NOON, *, revision: int = 2, **changes: float) -> bytes:
    fields = {
        "Type": 4, "Error": 0, "Latitude": math.radians(40.0), "Longitude": math.radians(-83.0), "Height": 200.0,
        "Undulation": -33.0, "Vn": 3.0, "Ve": 4.0, "Vu": 0.25, "COG": 53.1, "NrSV": 20, "MeanCorrAge": 1.5,
        "HAccuracy": 0.06, "VAccuracy": 0.1,
    }  # fmt: skip
    return block("PVTGeodetic", seconds, revision=revision, **(fields | changes))


def attitude(seconds: float = NOON, **changes: float) -> bytes:
    fields = {"Error": 0, "Mode": 4, "Heading": 60.0, "Pitch": 2.0, "Roll": -1.0} | dict.fromkeys(
        ("PitchDot", "RollDot", "HeadingDot"), NO_NUMBER
    )
    return block("AttEuler", seconds, **(fields | changes))


def position_covariance(seconds: float = NOON, north: float = 4e-4, east: float = 9e-4, **changes: float) -> bytes:
    return block("PosCovGeodetic", seconds, Type=4, Cov_latlat=north, Cov_lonlon=east, **changes)


def velocity_covariance(seconds: float = NOON, north: float = 16e-4, east: float = 9e-4, **changes: float) -> bytes:
    return block("VelCovGeodetic", seconds, Type=4, Cov_VnVn=north, Cov_VeVe=east, **changes)


def attitude_covariance(seconds: float = NOON, heading: float = 0.04, **changes: float) -> bytes:
    return block("AttCovEuler", seconds, Cov_HeadHead=heading, **changes)


def one(*blocks: bytes) -> Fix:
    (fix,) = sbf.Decoder().feed(b"".join(blocks), 0.0)
    return fix


@settings(deadline=None, max_examples=40)
@given(fix=FIXES)
def test_blocks_as_pysbf2_reads_them(fix: Fix) -> None:
    read = {message.identity: message for _raw, message in SBFReader(io.BytesIO(Encoder().encode(fix)))}
    assert list(read) == ["PVTGeodetic", "PosCovGeodetic", "VelCovGeodetic", "AttEuler", "AttCovEuler"]
    position, pointing = read["PVTGeodetic"], read["AttEuler"]
    assert (position.Latitude, position.Longitude) == (fix.latitude, fix.longitude)
    assert (position.Vn, position.Ve) == pytest.approx((fix.velocity_north, fix.velocity_east), rel=1e-6)
    modes = {FixQuality.SINGLE: 1, FixQuality.DIFFERENTIAL: 2, FixQuality.RTK_FIXED: 4, FixQuality.RTK_FLOAT: 5}
    assert position.Type == modes[fix.quality]
    assert position.WNc == fix.time // WEEK
    assert abs(wrap_angle(math.radians(90.0 - pointing.Heading) - fix.heading)) < 1e-6
    sigma = math.sqrt(read["PosCovGeodetic"].Cov_latlat)
    assert sigma == pytest.approx(fix.position_sigma)
    assert 2.0 * math.hypot(sigma, sigma) <= position.HAccuracy <= 2.0 * math.hypot(sigma, sigma) + 0.01


@settings(deadline=None, max_examples=40)
@given(
    latitude=st.floats(-1.5, 1.5),
    longitude=st.floats(-3.1, 3.1),
    heading=st.floats(0.0, 359.875, width=32),
    speeds=st.tuples(*[st.floats(-60.0, 60.0, width=32)] * 3),
    milliseconds=st.integers(1_000_000_000_000, 1_640_000_000_000),
)
def test_blocks_that_pysbf2_wrote(latitude, longitude, heading, speeds, milliseconds) -> None:
    seconds, (north, east, up) = 1e-3 * milliseconds, speeds
    place = {"Latitude": latitude, "Longitude": longitude, "Vn": north, "Ve": east, "Vu": up}
    fix = one(
        pvt(seconds, **place),
        position_covariance(seconds),
        velocity_covariance(seconds),
        attitude_covariance(seconds),
        attitude(seconds, Heading=heading),
    )
    assert fix.time == pytest.approx(seconds, abs=1e-4)
    assert (fix.latitude, fix.longitude, fix.altitude) == (latitude, longitude, 233.0)
    assert (fix.velocity_north, fix.velocity_east, fix.velocity_down) == (north, east, -up)
    assert abs(wrap_angle(fix.heading - math.radians(90.0 - heading))) < 1e-9
    assert (fix.pitch, fix.roll) == pytest.approx((math.radians(2.0), math.radians(-1.0)))
    assert (fix.position_sigma, fix.velocity_sigma) == pytest.approx((0.03, 0.04))
    assert fix.heading_sigma == pytest.approx(math.radians(0.2))
    assert fix.differential_age == pytest.approx(1.5)
    assert (fix.locked, fix.quality) == (True, FixQuality.RTK_FIXED)


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_line_makes_no_wrong_fix_and_costs_no_whole_one(seed: int) -> None:
    hold_in_noise(sbf.Decoder, Encoder().encode, seed)


def test_what_was_cut_short_delays_no_whole_message_after_it() -> None:
    hold_without_delay(sbf.Decoder, Encoder().encode)


def test_the_blocks_of_one_time_belong_together_in_either_order() -> None:
    decoder = sbf.Decoder()
    assert decoder.feed(attitude(NOON) + pvt(NOON + 0.1), 0.1) == []
    (fix,) = decoder.feed(pvt(NOON), 0.1)
    assert fix.time == NOON
    (fix,) = decoder.feed(attitude(NOON + 0.1), 0.12)
    assert fix.time == NOON + 0.1


def test_the_week_turns() -> None:
    turn = 2400.0 * WEEK
    decoder, times = sbf.Decoder(), [turn + 0.1 * k for k in range(-5, 5)]
    fixes = fed(decoder, [(t - turn, pvt(t) + attitude(t)) for t in times])
    assert [fix.time for fix in fixes] == pytest.approx(times, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"TOW": 0xFFFFFFFF}, Outcome.NO_TIME),
        ({"WNc": 0xFFFF}, Outcome.NO_TIME),
        ({"TOW": 1000 * WEEK}, Outcome.MALFORMED),
        ({"Error": 3}, Outcome.NO_POSITION),
        ({"Type": 0}, Outcome.NO_POSITION),
        ({"Latitude": NO_NUMBER}, Outcome.NO_POSITION),
        ({"Longitude": math.nan}, Outcome.NO_POSITION),
        ({"Latitude": math.inf}, Outcome.NO_POSITION),
    ],
)
def test_what_is_no_fix(changes: dict[str, float], outcome: Outcome) -> None:
    decoder = sbf.Decoder()
    assert decoder.feed(pvt(**changes) + attitude(), 0.0) == []
    assert decoder.counts[outcome] == 1


@pytest.mark.parametrize(
    ("mode", "quality"),
    [
        (1, FixQuality.SINGLE),
        (2, FixQuality.DIFFERENTIAL),
        (3, FixQuality.UNKNOWN),
        (4, FixQuality.RTK_FIXED),
        (5, FixQuality.RTK_FLOAT),
        (6, FixQuality.DIFFERENTIAL),
        (7, FixQuality.UNKNOWN),
        (8, FixQuality.UNKNOWN),
        (10, FixQuality.PPP),
    ],
)
def test_modes(mode: int, quality: FixQuality) -> None:
    """Of a moving base (7, 8) the place on the earth is as good as that base's, whatever that is."""
    assert one(pvt(Type=mode), attitude()).quality is quality


def test_an_alarm_of_the_integrity_monitor_is_no_lock() -> None:
    assert one(pvt(RAIMIntegrity=1), attitude()).locked
    fix = one(pvt(RAIMIntegrity=2), attitude())
    assert "status_not_locked" in TrustGate(SBF, NOON).step(0.0, fix).reasons


@pytest.mark.parametrize(
    "changes", [{"Mode": 0}, {"Mode": 1}, {"Mode": 3}, {"Error": 1}, {"Error": 128}, {"Heading": NO_NUMBER}]
)
def test_an_attitude_that_is_not_fixed_or_not_valid_gives_no_heading(changes: dict[str, float]) -> None:
    fix = one(pvt(), attitude(**changes))
    assert math.isnan(fix.heading)
    assert "heading_invalid" in TrustGate(SBF, NOON).step(0.0, fix).reasons


def test_two_antennas_give_no_roll() -> None:
    fix = one(pvt(), attitude(Mode=2, Roll=0.0))
    assert fix.pitch == pytest.approx(math.radians(2.0))
    assert math.isnan(fix.roll)


def test_a_yaw_rate_that_the_receiver_gives_counts() -> None:
    assert one(pvt(), attitude(HeadingDot=10.0)).yaw_rate == pytest.approx(-math.radians(10.0))
    assert math.isnan(one(pvt(), attitude()).yaw_rate), "the first fix has no difference"


@pytest.mark.parametrize("revision", [0, 1, 2])
def test_what_accuracies_there_are(revision: int) -> None:
    """PVTGeodetic has its own from revision 2 on: twice the root mean square of the distance."""
    fix = one(pvt(revision=revision), attitude())
    assert fix.position_sigma == pytest.approx(0.03 if revision == 2 else math.nan, nan_ok=True)
    assert math.isnan(fix.velocity_sigma)
    assert math.isnan(fix.heading_sigma)
    assert math.isnan(one(position_covariance(north=-1.0), pvt(revision=0), attitude()).position_sigma)
    assert math.isnan(one(velocity_covariance(Error=1), pvt(), attitude()).velocity_sigma)


def test_accuracies_may_come_once_a_second_and_grow_old() -> None:
    decoder, rows = sbf.Decoder(), []
    for k in range(40):
        seconds = NOON + 0.1 * k
        rest = velocity_covariance(seconds) + attitude_covariance(seconds) if k in (0, 5) else b""
        rows.append((0.1 * k, rest + pvt(seconds) + attitude(seconds)))
    known = [math.isfinite(fix.velocity_sigma + fix.heading_sigma) for fix in fed(decoder, rows)]
    assert known == [True] * 31 + [False] * 9


def test_an_accuracy_of_the_same_time_counts_more_than_an_older_one() -> None:
    decoder = sbf.Decoder()
    (fix,) = decoder.feed(position_covariance() + pvt() + attitude(), 0.0)
    assert fix.position_sigma == pytest.approx(0.03)
    (fix,) = decoder.feed(pvt(NOON + 0.1, HAccuracy=0.8) + attitude(NOON + 0.1), 0.1)
    assert fix.position_sigma == pytest.approx(0.4)
    (fix,) = decoder.feed(pvt(NOON + 0.2, HAccuracy=655.35) + attitude(NOON + 0.2), 0.2)
    assert fix.position_sigma == pytest.approx(0.03), "the only one that is known"


def test_missing_corrections_and_velocities_are_not_known() -> None:
    fix = one(pvt(MeanCorrAge=655.35, Vn=NO_NUMBER), attitude())
    assert math.isnan(fix.differential_age)
    assert math.isnan(fix.velocity_north)
    assert "not_finite" in TrustGate(SBF, NOON).step(0.0, fix).reasons


def test_a_drive_is_trusted() -> None:
    gate = TrustGate(SBF, EPOCH)
    judged = [gate.step(fix.time_received, fix) for fix in fed(sbf.Decoder(), sent(Encoder().encode, 50))]
    assert [one.trusted for one in judged] == [False] + [True] * 49
    assert "not_finite" in judged[0].reasons
