"""The ESR that is told by its host, and the stop frame; status frames read by an independent description."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cantools.database
import numpy as np
import pytest

from tests.vehicles import FUSION
from vve_sumo.values import Actors, Detections, Frame, Point, Pose
from vve_sumo.wire import datagrams, esr
from vve_sumo.wire.outputs import KINDS, Context, OfOtherSensor
from vve_sumo.wire.sample import Sample, SampleContent, no_fix
from vve_sumo.wire.sample_codec import decode_sample, encode_sample

CONTEXT = Context(FUSION.vehicle, "")
SPEED = 9.0
POSE = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, SPEED, 0.0, 0.1, 0.0, 0.0)
SCAN = Detections(0.0, np.array([30.0]), np.array([0.1]), np.array([-SPEED]), np.array([0], np.int8))
NOBODY = Actors.none(0.0)


def sample(time: float, *, valid: bool = True) -> Sample:
    measured = SampleContent(no_fix(time, time), replace(POSE, time=time), SCAN, 0.02, NOBODY)
    return Sample(round(time / 0.02), 1.4e9 + time, time, measured if valid else None)


def test_a_wire_of_another_sensor_carries_that_one_s_scan_and_is_invalid_without_one() -> None:
    """The project's own datagram, read back: the target of the sensor named, its age, and none of the other's."""
    now, other = sample(10.0), replace(SCAN, time=9.95, range=np.array([12.5]))
    assert now.measured is not None
    now = replace(now, measured=replace(now.measured, others={"noisy": other}))
    for sensor, ranges, made in (("noisy", [12.5], now.time - 0.05), ("absent", [], 0.0)):
        (data,) = OfOtherSensor(KINDS["radar"].make(CONTEXT), sensor).step(
            decode_sample(encode_sample(now, actors=False))
        )
        assert isinstance(data, bytes)
        read = datagrams.decode_radar(data)
        assert read is not None
        assert read.valid == bool(ranges)
        assert [target.range for target in read.targets] == ranges
        assert read.measured == pytest.approx(made, abs=1e-6)


class Bus:
    """What a host sends, until somebody takes it."""

    def __init__(self) -> None:
        self.waiting: list[Frame] = []

    def take(self) -> list[Frame]:
        waiting, self.waiting = self.waiting, []
        return waiting


@pytest.fixture(scope="module")
def database(shared_data: Path) -> cantools.database.Database:
    found = cantools.database.load_file(shared_data / "dbc" / "ESR.dbc", strict=False)
    assert isinstance(found, cantools.database.Database)
    return found


def status(database: cantools.database.Database, frames: dict[int, Frame]) -> dict[str, float]:
    read: dict[str, float] = {}
    for number in (0x4E0, 0x4E1):
        read |= database.decode_message(number, frames[number].data, decode_choices=False)  # type: ignore[arg-type]
    return {name.removeprefix("CAN_TX_"): value for name, value in read.items()}


def test_a_radar_that_is_told_repeats_its_host_and_without_it_reports_an_error(
    database: cantools.database.Database,
) -> None:
    bus = Bus()
    output = KINDS["esr"].make(replace(CONTEXT, receive=bus.take))
    seen: dict[float, tuple[dict[str, float], int]] = {}
    for tick in range(60):
        now = tick * 0.02
        if 0.2 <= now < 0.6:
            bus.waiting += esr.encode_host(esr.HostMotion(7.5, math.radians(5.0)))
        if frames := {frame.id: frame for frame in output.step(sample(now))}:
            tracks = sum(any(frames[0x500 + number].data) for number in range(64))
            seen[round(now, 2)] = status(database, frames), tracks
    before = [found for now, found in seen.items() if now < 0.2]
    reported = [found for now, found in seen.items() if 0.25 <= now <= 0.6]
    after = [found for now, found in seen.items() if now > 0.72]
    assert min(len(before), len(reported), len(after)) >= 3
    for read, tracks in reported:
        assert (read["COMM_ERROR"], read["XCVR_OPERATIONAL"], tracks) == (0, 1, 1)
        assert read["VEHICLE_SPEED_CALC"] == pytest.approx(7.5)
        assert read["YAW_RATE_CALC"] == pytest.approx(5.0)
    for read, tracks in before + after:
        assert (read["COMM_ERROR"], read["INTERNAL_ERROR"], read["XCVR_OPERATIONAL"], tracks) == (1, 0, 0, 0)


def test_a_radar_radiates_only_by_order_and_a_reader_takes_that_for_invalid() -> None:
    bus = Bus()
    output = KINDS["esr"].make(replace(CONTEXT, receive=bus.take))
    bus.waiting.append(esr.encode_host(esr.HostMotion(7.5, 0.0))[0])
    (cycle,) = esr.Decoder().feed(output.step(sample(0.0)))  # type: ignore[arg-type]
    assert (cycle.host_known, cycle.radiating, cycle.valid, cycle.tracks) == (True, False, False, ())


def test_oncoming_is_judged_by_the_speed_that_the_host_says() -> None:
    """The object closes in at 9 m/s: it stands to a car of 9 m/s, and comes towards one that says it stands."""
    for speed, oncoming in ((SPEED, False), (0.0, True)):
        bus = Bus()
        output = KINDS["esr"].make(replace(CONTEXT, receive=bus.take))
        bus.waiting += esr.encode_host(esr.HostMotion(speed, 0.0))
        (cycle,) = esr.Decoder().feed(output.step(sample(0.0)))  # type: ignore[arg-type]
        assert [track.oncoming for track in cycle.tracks] == [oncoming]


def test_a_radar_that_nobody_has_to_tell_knows_the_drives_motion(database: cantools.database.Database) -> None:
    frames = {frame.id: frame for frame in KINDS["esr"].make(CONTEXT).step(sample(0.0))}  # type: ignore[union-attr]
    read = status(database, frames)
    assert (read["COMM_ERROR"], read["VEHICLE_SPEED_CALC"]) == (0, pytest.approx(SPEED))


def test_a_stop_frame_is_sent_from_the_first_invalid_tick_after_a_valid_one() -> None:
    output = KINDS["stop"].make(replace(CONTEXT, stop_id=0x3F1))
    valid = [False, False, True, True, False, False, True, False]
    sent = [list(output.step(sample(0.02 * tick, valid=said))) for tick, said in enumerate(valid)]
    stop = [Frame(0x3F1, b"\x01")]
    assert sent == [[], [], [], [], stop, stop, [], stop]
