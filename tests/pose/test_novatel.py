"""NovAtel logs: written and read by NovAtel's own EDIE, streams as bad as lines make them, and which values count."""

from __future__ import annotations

import math

import novatel_edie as edie
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from novatel_edie import oem

from tests.pose.stream_bench import FIXES, fed, hold_in_noise, hold_without_delay, sent
from tests.pose.test_trust import EPOCH
from vve_sumo.frames import wrap_angle
from vve_sumo.pose import novatel
from vve_sumo.pose.novatel_encoder import Encoder
from vve_sumo.pose.stream import Outcome
from vve_sumo.pose.trust import NOVATEL, TrustGate
from vve_sumo.values import Fix, FixQuality

WEEK = 604_800
NOON = 2400 * WEEK + 3 * 86_400 + 43_200.0


def line(name: str, seconds: float, fields: list[object], *, time_status: str = "FINESTEERING") -> bytes:
    """An ASCII log, with the checksum that EDIE computes."""
    week, second = divmod(round(1e3 * seconds), 1000 * WEEK)
    head = f"{name}A,COM1,0,50.0,{time_status},{week},{second / 1000:.3f},02000020,46eb,32768"
    body = f"{head};{','.join(map(str, fields))}".encode()
    return b"#%b*%08x\r\n" % (body, edie.calculate_crc(body))


def inspvax(seconds: float = NOON, **changes: object) -> bytes:
    of: dict[str, object] = {
        "status": "INS_SOLUTION_GOOD", "kind": "INS_RTKFIXED", "lat": 40.0, "lon": -83.0, "height": 233.0,
        "undulation": -33.0, "north": 3.0, "east": 4.0, "up": 0.25, "roll": -1.0, "pitch": 2.0, "azimuth": 60.0,
        "lat_sigma": 0.02, "lon_sigma": 0.03, "height_sigma": 0.05, "north_sigma": 0.04, "east_sigma": 0.03,
        "up_sigma": 0.05, "roll_sigma": 0.1, "pitch_sigma": 0.1, "azimuth_sigma": 0.2, "extended": "00000003",
        "since": 0,
    }  # fmt: skip
    return line("INSPVAX", seconds, list((of | changes).values()))


def bestpos(seconds: float = NOON, **changes: object) -> bytes:
    of: dict[str, object] = {
        "status": "SOL_COMPUTED", "kind": "INS_RTKFIXED", "lat": 40.0, "lon": -83.0, "height": 233.0,
        "undulation": -33.0, "datum": "WGS84", "lat_sigma": 0.02, "lon_sigma": 0.03, "height_sigma": 0.05,
        "station": '"0001"', "age": 1.5, "solution_age": 0.0, "tracked": 20, "used": 20, "l1": 20, "multi": 20,
        "reserved": "00", "extended": "06", "galileo": "33", "gps": "33",
    }  # fmt: skip
    return line("BESTPOS", seconds, list((of | changes).values()))


def binary(*lines: bytes) -> bytes:
    """ASCII logs as binary ones, by EDIE."""
    parser = oem.Parser()
    parser.write(b"".join(lines))
    return b"".join(bytes(message.to_binary().message) for message in parser)


def one(data: bytes) -> Fix:
    (fix,) = novatel.Decoder().feed(data, 0.0)
    return fix


@settings(deadline=None, max_examples=40)
@given(fix=FIXES)
def test_logs_as_edie_reads_them(fix: Fix) -> None:
    parser = oem.Parser()
    parser.write(Encoder().encode(fix))
    best, ins = parser
    assert (type(best).__name__[:7], type(ins).__name__[:7]) == ("BESTPOS", "INSPVAX")
    for log in (best, ins):
        assert math.radians(log.latitude) == pytest.approx(fix.latitude, abs=1e-15)
        assert math.radians(log.longitude) == pytest.approx(fix.longitude, abs=1e-15)
        seconds = log.header.week * WEEK + log.header.milliseconds / 1e3
        assert seconds == pytest.approx(fix.time, abs=6e-4)
    assert (ins.north_vel, ins.east_vel) == (fix.velocity_north, fix.velocity_east)
    kinds = {FixQuality.SINGLE: "INS_PSRSP", FixQuality.DIFFERENTIAL: "INS_PSRDIFF"}
    kinds |= {FixQuality.RTK_FLOAT: "INS_RTKFLOAT", FixQuality.RTK_FIXED: "INS_RTKFIXED"}
    assert ins.position_type.name == kinds[fix.quality]
    assert ins.ins_solution_status.name == "INS_SOLUTION_GOOD"
    assert abs(wrap_angle(math.radians(90.0 - ins.azimuth) - fix.heading)) < 1e-12
    assert best.diff_age == pytest.approx(fix.differential_age)


@settings(deadline=None, max_examples=40)
@given(
    latitude=st.floats(-89.0, 89.0),
    longitude=st.floats(-180.0, 180.0),
    azimuth=st.floats(0.0, 359.9),
    speeds=st.tuples(*[st.floats(-60.0, 60.0)] * 3),
    milliseconds=st.integers(1_000_000_000_000, 1_640_000_000_000),
    as_binary=st.booleans(),
)
def test_logs_that_edie_wrote(latitude, longitude, azimuth, speeds, milliseconds, as_binary) -> None:
    """Binary and ASCII, which has eleven decimals of a degree."""
    seconds, texts = 1e-3 * milliseconds, [f"{number:.4f}" for number in speeds]
    changes = dict(zip(("north", "east", "up"), texts, strict=True))
    place = {"lat": f"{latitude:.11f}", "lon": f"{longitude:.11f}", "azimuth": f"{azimuth:.9f}"}
    lines = bestpos(seconds), inspvax(seconds, **changes, **place)
    fix = one(binary(*lines) if as_binary else b"".join(lines))
    # EDIE cuts a millisecond off where the seconds of an ASCII log are a little less than they say.
    assert fix.time == pytest.approx(seconds, abs=1.1e-3 if as_binary else 1e-4)
    assert (fix.latitude, fix.longitude) == pytest.approx((math.radians(latitude), math.radians(longitude)), abs=1e-12)
    assert (fix.velocity_north, fix.velocity_east, -fix.velocity_down) == pytest.approx(speeds, abs=6e-5)
    assert abs(wrap_angle(fix.heading - math.radians(90.0 - azimuth))) < 1e-10
    assert fix.altitude == 233.0
    assert (fix.pitch, fix.roll) == pytest.approx((math.radians(2.0), math.radians(-1.0)))
    assert (fix.position_sigma, fix.velocity_sigma) == pytest.approx((0.03, 0.04))
    assert fix.heading_sigma == pytest.approx(math.radians(0.2))
    assert fix.differential_age == pytest.approx(1.5)
    assert (fix.locked, fix.quality) == (True, FixQuality.RTK_FIXED)


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_line_makes_no_wrong_fix_and_costs_no_whole_one(seed: int) -> None:
    hold_in_noise(novatel.Decoder, Encoder().encode, seed)


def test_what_was_cut_short_delays_no_whole_message_after_it() -> None:
    hold_without_delay(novatel.Decoder, Encoder().encode)


@pytest.mark.parametrize("seed", range(5))
def test_neither_does_one_of_ascii_logs(seed: int) -> None:
    def encode(fix: Fix) -> bytes:
        parser = oem.Parser()
        parser.write(Encoder().encode(fix))
        return b"".join(bytes(message.to_ascii().message) for message in parser)

    hold_in_noise(novatel.Decoder, encode, seed)


def test_the_week_turns() -> None:
    turn = 2400.0 * WEEK
    times = [turn + 0.1 * k for k in range(-5, 5)]
    fixes = fed(novatel.Decoder(), [(t - turn, inspvax(t)) for t in times])
    assert [fix.time for fix in fixes] == pytest.approx(times, abs=1e-4)


STATUSES = [
    "INS_INACTIVE", "INS_ALIGNING", "INS_HIGH_VARIANCE", "INS_SOLUTION_FREE", "INS_ALIGNMENT_COMPLETE",
    "DETERMINING_ORIENTATION", "WAITING_INITIALPOS", "WAITING_AZIMUTH", "INITIALIZING_BIASES", "MOTION_DETECT",
    "WAITING_ALIGNMENTORIENTATION",
]  # fmt: skip


@pytest.mark.parametrize("status", STATUSES)
@pytest.mark.parametrize("form", [binary, bytes])
def test_only_a_good_solution_of_the_ins_is_locked(status: str, form) -> None:
    fix = one(form(inspvax(status=status)))
    assert "status_not_locked" in TrustGate(NOVATEL, NOON).step(0.0, fix).reasons
    assert one(form(inspvax())).locked


@pytest.mark.parametrize(
    ("kind", "quality"),
    [
        ("INS_SBAS", FixQuality.DIFFERENTIAL),
        ("INS_PSRSP", FixQuality.SINGLE),
        ("INS_PSRDIFF", FixQuality.DIFFERENTIAL),
        ("INS_RTKFLOAT", FixQuality.RTK_FLOAT),
        ("INS_RTKFIXED", FixQuality.RTK_FIXED),
        ("INS_PPP", FixQuality.PPP),
        ("INS_PPP_CONVERGING", FixQuality.PPP),
        ("PROPAGATED", FixQuality.UNKNOWN),
    ],
)
@pytest.mark.parametrize("form", [binary, bytes])
def test_types_of_position(kind: str, quality: FixQuality, form) -> None:
    assert one(form(inspvax(kind=kind))).quality is quality


@pytest.mark.parametrize("time_status", ["UNKNOWN", "APPROXIMATE", "COARSE", "COARSESTEERING", "FREEWHEELING"])
@pytest.mark.parametrize("form", [binary, bytes])
def test_a_coarse_time_is_none(time_status: str, form) -> None:
    good = inspvax()
    body = good[1 : good.index(b"*")].replace(b"FINESTEERING", time_status.encode())
    decoder = novatel.Decoder()
    assert decoder.feed(form(b"#%b*%08x\r\n" % (body, edie.calculate_crc(body))), 0.0) == []
    assert decoder.counts[Outcome.NO_TIME] == 1


@pytest.mark.parametrize(
    ("week", "seconds"),
    [
        ("2400", "inf"),
        ("2400", "1e400"),
        ("2400", "nan"),
        ("2400", "-1"),
        ("2400", "604800"),
        ("-5", "1"),
        ("9" * 99, "1"),
    ],
)
def test_a_time_that_is_none_is_malformed(week: str, seconds: str) -> None:
    """With a right checksum, as of a receiver gone wrong or of somebody who sends one's own."""
    good = inspvax()
    *head, _week, _seconds, status, reserved, version = good[1 : good.index(b";")].split(b",")
    body = b",".join([*head, week.encode(), seconds.encode(), status, reserved, version])
    body += good[good.index(b";") : good.index(b"*")]
    decoder = novatel.Decoder()
    assert decoder.feed(b"#%b*%08x\r\n" % (body, edie.calculate_crc(body)), 0.0) == []
    assert decoder.counts[Outcome.MALFORMED] == 1


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"kind": "NONE"}, Outcome.NO_POSITION),
        ({"lat": "nan"}, Outcome.NO_POSITION),
        ({"lat": 90.5}, Outcome.NO_POSITION),
        ({"lon": "inf"}, Outcome.NO_POSITION),
        ({"lat": ""}, Outcome.MALFORMED),
        ({"lat": "1,2"}, Outcome.MALFORMED),
        ({"since": "x"}, Outcome.MALFORMED),
    ],
)
def test_what_is_no_fix(changes: dict[str, object], outcome: Outcome) -> None:
    decoder = novatel.Decoder()
    assert decoder.feed(inspvax(**changes), 0.0) == []
    assert decoder.counts[outcome] == 1


@pytest.mark.parametrize("form", [binary, bytes])
def test_the_age_of_the_corrections_grows_from_bestpos_to_bestpos(form) -> None:
    decoder, ages = novatel.Decoder(), []
    for k in range(40):
        seconds = NOON + 0.1 * k
        best = bestpos(seconds, age=1.0 + 0.1 * k) if k in (0, 5) else b""
        ages += [fix.differential_age for fix in decoder.feed(form(best + inspvax(seconds)), 0.1 * k)]
    assert ages[:31] == pytest.approx([1.0 + 0.1 * k for k in range(31)], abs=1e-6)
    assert all(math.isnan(age) for age in ages[31:]), "BESTPOS came too long ago"
    old = one(form(bestpos(age=1.0, solution_age=20.0) + inspvax()))
    assert "corrections_old" in TrustGate(NOVATEL, NOON).step(0.0, old).reasons
    none = one(form(bestpos(status="INSUFFICIENT_OBS", kind="NONE") + inspvax()))
    assert math.isnan(none.differential_age)


def test_logs_of_a_second_antenna_and_answers_to_commands_are_not_read() -> None:
    log = bytearray(Encoder().encode(one(binary(inspvax())))[-158:])
    for kind in (0x01, 0x80):
        log[6] = kind
        log[-4:] = edie.calculate_crc(bytes(log[:-4])).to_bytes(4, "little")
        decoder = novatel.Decoder()
        assert decoder.feed(bytes(log), 0.0) == []
        assert decoder.counts[Outcome.OTHER] == 1


def test_a_drive_is_trusted() -> None:
    gate = TrustGate(NOVATEL, EPOCH)
    judged = [gate.step(fix.time_received, fix) for fix in fed(novatel.Decoder(), sent(Encoder().encode, 50))]
    assert [one.trusted for one in judged] == [False] + [True] * 49
    assert "not_finite" in judged[0].reasons
