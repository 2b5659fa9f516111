"""ESR frames against an independent description of them: comma.ai's DBC file, read by cantools."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.values import Frame
from vve_sumo.wire import esr

NUMBERS = st.integers(0, esr.TRACKS - 1)
TRACKS = st.builds(
    esr.Track,
    number=NUMBERS,
    range=st.floats(0.1, 204.7),
    angle=st.floats(math.radians(-51.1), math.radians(51.1)),
    range_rate=st.floats(-81.9, 81.9),
    range_acceleration=st.floats(-25.5, 25.5),
    lateral_rate=st.floats(-7.9, 7.7),
    width=st.floats(0.0, 7.5),
    status=st.sampled_from(list(esr.TrackStatus)[1:]),
    mode=st.sampled_from(list(esr.Mode)),
    oncoming=st.booleans(),
)
CYCLES = st.builds(
    esr.Cycle,
    scan_index=st.integers(0, esr.SCANS - 1),
    time_stamp=st.floats(0.0, 1e6),
    host=st.builds(esr.HostMotion, speed=st.floats(0.0, 60.0), yaw_rate=st.floats(-2.0, 2.0)),
    tracks=st.lists(TRACKS, max_size=20, unique_by=lambda track: track.number),
)


@pytest.fixture(scope="module")
def database(shared_data: Path) -> cantools.database.Database:
    database = cantools.database.load_file(shared_data / "dbc" / "ESR.dbc", strict=False)
    assert isinstance(database, cantools.database.Database)
    return database


def _decoded(database: cantools.database.Database, frame: Frame) -> dict[str, float]:
    found = database.decode_message(frame.id, frame.data, decode_choices=False)
    assert isinstance(found, dict)
    return {name.removeprefix("CAN_TX_").removeprefix("CAN_RX_"): float(value) for name, value in found.items()}


@given(cycle=CYCLES)
def test_tracks_as_an_independent_description_reads_them(
    database: cantools.database.Database, cycle: esr.Cycle
) -> None:
    frames = {frame.id: frame for frame in esr.encode(cycle)}
    for track in cycle.tracks:
        read = _decoded(database, frames[esr.FIRST_TRACK + track.number])
        assert read["TRACK_RANGE"] == pytest.approx(track.range, abs=0.05 + 1e-9)
        assert read["TRACK_ANGLE"] == pytest.approx(-math.degrees(track.angle), abs=0.05 + 1e-9)
        assert read["TRACK_RANGE_RATE"] == pytest.approx(track.range_rate, abs=0.005 + 1e-9)
        assert read["TRACK_RANGE_ACCEL"] == pytest.approx(track.range_acceleration, abs=0.025 + 1e-9)
        assert read["TRACK_LAT_RATE"] == pytest.approx(track.lateral_rate, abs=0.125 + 1e-9)
        assert read["TRACK_WIDTH"] == pytest.approx(track.width, abs=0.25 + 1e-9)
        assert read["TRACK_STATUS"] == track.status
        assert read["TRACK_MED_RANGE_MODE"] == track.mode
        assert read["TRACK_ONCOMING"] == track.oncoming
        assert read["TRACK_ROLLING_COUNT"] == cycle.scan_index % 2


@given(cycle=CYCLES)
def test_status_frames_as_an_independent_description_reads_them(
    database: cantools.database.Database, cycle: esr.Cycle
) -> None:
    frames = {frame.id: frame for frame in esr.encode(cycle)}
    first, second = (_decoded(database, frames[number]) for number in (esr.STATUS_1, esr.STATUS_2))
    assert first["SCAN_INDEX"] == cycle.scan_index
    assert first["ROLLING_COUNT_1"] == second["ROLLING_COUNT_2"] == cycle.scan_index % 4
    assert first["VEHICLE_SPEED_CALC"] == pytest.approx(cycle.host.speed, abs=0.032)
    assert first["YAW_RATE_CALC"] == pytest.approx(math.degrees(cycle.host.yaw_rate), abs=0.032)
    assert first["COMM_ERROR"] == second["INTERNAL_ERROR"] == 0.0
    assert second["MAXIMUM_TRACKS_ACK"] == esr.TRACKS
    off = (first["DSP_TIMESTAMP"] - 1000.0 * cycle.time_stamp + 128.0) % 256.0 - 128.0
    assert abs(off) <= 1.0 + 1e-6


@given(motion=st.builds(esr.HostMotion, speed=st.floats(-60.0, 60.0), yaw_rate=st.floats(-2.0, 2.0)))
def test_host_frames_as_an_independent_description_reads_them(
    database: cantools.database.Database, motion: esr.HostMotion
) -> None:
    motions, orders = (_decoded(database, frame) for frame in esr.encode_host(motion))
    assert motions["VEHICLE_SPEED"] == pytest.approx(abs(motion.speed), abs=0.032)
    assert motions["VEHICLE_SPEED_DIRECTION"] == (motion.speed < 0.0)
    assert motions["YAW_RATE"] == pytest.approx(math.degrees(motion.yaw_rate), abs=0.032)
    assert motions["YAW_RATE_VALIDITY"] == orders["RADAR_CMD_RADIATE"] == orders["VEHICLE_SPEED_VALIDITY"] == 1.0


@given(cycle=CYCLES)
def test_decoder_is_the_inverse(cycle: esr.Cycle) -> None:
    (back,) = esr.Decoder().feed(esr.encode(cycle))
    assert back.valid
    assert back.scan_index == cycle.scan_index
    assert [track.number for track in back.tracks] == sorted(
        track.number for track in cycle.tracks if track.range >= 0.05
    )
    assert (back.time_stamp - cycle.time_stamp + 0.128) % 0.256 - 0.128 == pytest.approx(0.0, abs=0.001 + 1e-9)
    assert esr.encode(replace(back, time_stamp=cycle.time_stamp)) == esr.encode(cycle)


def test_an_invalid_cycle_shows_no_track_and_two_errors(database: cantools.database.Database) -> None:
    cycle = esr.Cycle(7, 0.0, esr.HostMotion(5.0, 0.0), (esr.Track(0, 20.0, 0.0, -5.0),), valid=False)
    frames = esr.encode(cycle)
    assert all(not any(frame.data) for frame in frames if frame.id >= esr.FIRST_TRACK and frame.id != esr.TRACK_SENSOR)
    assert _decoded(database, frames[0])["COMM_ERROR"] == _decoded(database, frames[1])["INTERNAL_ERROR"] == 1.0
    (back,) = esr.Decoder().feed(frames)
    assert not back.valid
    assert not back.tracks


@given(left=st.integers(0, 68))
def test_a_cycle_with_a_frame_missing_is_none(left: int) -> None:
    frames = esr.encode(esr.Cycle(7, 0.0, esr.HostMotion(5.0, 0.0), ()))
    needed = {esr.STATUS_1, esr.STATUS_2, *range(esr.FIRST_TRACK, esr.LAST_TRACK + 1)}
    cycles = esr.Decoder().feed(frame for n, frame in enumerate(frames) if n != left)
    assert len(cycles) == (frames[left].id not in needed)


def test_values_beyond_a_signal_saturate() -> None:
    track = esr.Track(3, 500.0, -1.2, -200.0, width=90.0)
    (cycle,) = esr.Decoder().feed(esr.encode(esr.Cycle(0, 0.0, esr.HostMotion(500.0, 0.0), (track,))))
    (back,) = cycle.tracks
    assert [back.range, back.range_rate, back.width] == pytest.approx([204.7, -81.92, 7.5])
    assert math.degrees(back.angle) == pytest.approx(-51.1)
    assert cycle.host.speed == pytest.approx(127.9375)


def test_no_number_is_sent_for_what_is_none() -> None:
    for none in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=f"finite numbers only, got {none}"):
            esr.encode(esr.Cycle(0, 0.0, esr.HostMotion(1.0, 0.0), (esr.Track(0, none, 0.0, 0.0),)))
    with pytest.raises(ValueError, match="number 64"):
        esr.encode(esr.Cycle(0, 0.0, esr.HostMotion(1.0, 0.0), (esr.Track(64, 10.0, 0.0, 0.0),)))


@given(motion=st.builds(esr.HostMotion, speed=st.floats(-60.0, 60.0), yaw_rate=st.floats(-2.0, 2.0)))
def test_host_motion_comes_back(motion: esr.HostMotion) -> None:
    back = esr.decode_host(esr.encode_host(motion)[0])
    assert back is not None
    assert back.speed == pytest.approx(motion.speed, abs=0.032)
    assert back.yaw_rate == pytest.approx(motion.yaw_rate, abs=math.radians(0.032))
