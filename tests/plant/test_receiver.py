"""What the receiver sends, decoded by the decoder and placed by the placement, is the truth within its noise."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from tests import vehicles
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.plant.noise import wander, white
from vve_sumo.plant.receiver import ReceiverParameters, SimulatedReceiver
from vve_sumo.pose.ncom import Decoder
from vve_sumo.values import Fix, FixQuality, Point, Pose
from vve_sumo.vehicle.model import IDEAL

# Central meridian two degrees away, so that convergence (1.3 deg) matters.
LOT = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-81 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m", (170_000.0, 1000.0))
EPOCH = 1_447_000_050.0  # ten seconds before a GPS minute ends
MOUNTING = Mounting(forward=1.1, left=-0.4, heading_misalignment=math.radians(0.2))


def truth(time: float) -> Pose:
    """A bend at 8 m/s, 25 m in radius."""
    heading = 2.9 + 0.32 * time
    return Pose(
        time=time,
        point=Point.REAR_AXLE,
        x=25.0 * math.sin(heading),
        y=-25.0 * math.cos(heading),
        heading=math.remainder(heading, math.tau),
        speed=8.0,
        lateral_speed=0.0,
        yaw_rate=0.32,
        acceleration=0.0,
        grade=0.03,
    )


def record(parameters: ReceiverParameters, seconds: float, seed: int = 3) -> list[tuple[float, bytes]]:
    receiver = SimulatedReceiver(parameters, LOT, EPOCH, np.random.SeedSequence(seed))
    packets = []
    for number in range(1, round(seconds * 100) + 1):
        receiver.measure(truth(number / 100), 0.0)
        packets += receiver.arrived(number / 100)
    return packets


def decode(packets: list[tuple[float, bytes]]) -> list[Fix]:
    decoder = Decoder()
    return [fix for arrival, data in packets for fix in decoder.feed(data, arrival)]


def test_without_noise_the_decoded_pose_is_the_truth() -> None:
    """To the wire's resolution: 1e-6 rad, 1e-4 m/s, 1e-5 rad/s; over a minute's end."""
    fixes = decode(record(ReceiverParameters(MOUNTING, delay=0.0, noise=0.0), 20.0))
    placement = Placement(LOT, Alignment(), MOUNTING, EPOCH)
    assert len(fixes) == 2000
    for number, fix in enumerate(fixes, start=1):
        pose, expected = placement.place(fix), truth(number / 100)
        assert fix.time == EPOCH + number / 100
        assert math.hypot(pose.x - expected.x, pose.y - expected.y) < 1e-5
        assert math.remainder(pose.heading - expected.heading, math.tau) == pytest.approx(0.0, abs=2e-6)
        assert pose.speed == pytest.approx(8.0, abs=2e-4)
        assert pose.lateral_speed == pytest.approx(0.0, abs=2e-4)
        assert pose.yaw_rate == pytest.approx(0.32, abs=1e-5)
        assert pose.acceleration == pytest.approx(0.0, abs=2e-4)
        assert pose.grade == pytest.approx(0.03, abs=1e-6)


def test_an_undeclared_misalignment_turns_the_heading_and_moves_the_axle_by_the_lever_arm() -> None:
    extra = math.radians(0.5)
    mounted = replace(MOUNTING, heading_misalignment=MOUNTING.heading_misalignment + extra)
    fixes = decode(record(ReceiverParameters(mounted, delay=0.0, noise=0.0), 1.0))
    placement = Placement(LOT, Alignment(), MOUNTING, EPOCH)
    for number, fix in enumerate(fixes, start=1):
        pose, expected = placement.place(fix), truth(number / 100)
        assert math.remainder(pose.heading - expected.heading, math.tau) == pytest.approx(extra, abs=2e-6)
        shift = math.hypot(pose.x - expected.x, pose.y - expected.y)
        assert shift == pytest.approx(2.0 * math.sin(0.5 * extra) * math.hypot(1.1, 0.4), abs=1e-5)


def test_noise_has_the_declared_size() -> None:
    parameters = ReceiverParameters(MOUNTING, position_wander=0.0)
    noisy = decode(record(parameters, 40.0))
    exact = decode(record(replace(parameters, noise=0.0), 40.0))
    pairs = list(zip(noisy, exact, strict=True))
    north = np.array([(a.latitude - b.latitude) * 6_356_000.0 for a, b in pairs])
    east = np.array([(a.longitude - b.longitude) * 6_387_000.0 * math.cos(b.latitude) for a, b in pairs])
    heading = np.array([math.remainder(a.heading - b.heading, math.tau) for a, b in pairs])
    speed = np.array([a.velocity_east - b.velocity_east for a, b in pairs])
    yaw_rate = np.array([a.yaw_rate - b.yaw_rate for a, b in pairs])
    for error, sigma in (
        (north, 0.01),
        (east, 0.01),
        (heading, parameters.heading),
        (speed, parameters.velocity),
        (yaw_rate, parameters.yaw_rate),
    ):
        assert np.std(error) == pytest.approx(sigma, rel=0.06)
        assert abs(np.mean(error)) < 5.0 * sigma / math.sqrt(len(error))
    assert abs(np.corrcoef(north, east)[0, 1]) < 0.08


def test_a_hidden_delay_dates_what_was_measured_later_than_it_was() -> None:
    parameters = ReceiverParameters(MOUNTING, noise=0.0)
    reported, hidden = record(parameters, 4.0), record(replace(parameters, hidden_delay=0.1), 4.0)
    arrivals = [(late - early) for (early, _), (late, _) in zip(reported, hidden, strict=False)]
    assert arrivals == pytest.approx([0.1] * len(arrivals))
    for honest, dated_late in zip(decode(reported), decode(hidden), strict=False):
        assert dated_late.time - honest.time == pytest.approx(0.1, abs=1e-6)
        assert (dated_late.latitude, dated_late.longitude) == (honest.latitude, honest.longitude)


def test_a_factor_on_the_noise_makes_each_error_as_many_times_as_large() -> None:
    parameters = ReceiverParameters(MOUNTING)
    exact, once, thrice = (decode(record(replace(parameters, noise=factor), 5.0)) for factor in (0.0, 1.0, 3.0))
    for none, one, three in zip(exact, once, thrice, strict=True):
        assert three.latitude - none.latitude == pytest.approx(3.0 * (one.latitude - none.latitude), abs=1e-15)
        error = math.remainder(one.heading - none.heading, math.tau)
        assert math.remainder(three.heading - none.heading, math.tau) == pytest.approx(3.0 * error, abs=5e-6)


def test_status_channels_say_rtk_fixed_and_fresh() -> None:
    fix = decode(record(ReceiverParameters(MOUNTING), 1.0))[-1]
    assert (fix.locked, fix.quality) == (True, FixQuality.RTK_FIXED)
    assert fix.position_sigma == pytest.approx(math.hypot(0.01, 0.01), abs=6e-4)
    assert fix.velocity_sigma == pytest.approx(0.025)
    assert fix.heading_sigma == pytest.approx(math.radians(0.08), abs=6e-6)
    assert fix.differential_age == pytest.approx(1.0)


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.045])
def test_bytes_arrive_the_delay_after_their_epoch(delay: float) -> None:
    packets = record(ReceiverParameters(MOUNTING, delay=delay), 2.0)
    assert len(packets) == 200 - math.ceil(delay * 100)
    fixes = decode(packets)
    assert [fix.time_received - (fix.time - EPOCH) for fix in fixes] == pytest.approx([delay] * len(fixes), abs=1e-6)


def test_a_fault_can_be_put_between_measuring_and_sending() -> None:
    def every_other_lost(fix: Fix) -> Fix | None:
        return replace(fix, locked=False) if round(fix.time * 100) % 2 else None

    receiver = SimulatedReceiver(ReceiverParameters(MOUNTING), LOT, EPOCH, np.random.SeedSequence(1), every_other_lost)
    for number in range(1, 101):
        receiver.measure(truth(number / 100), 0.0)
    fixes = decode(receiver.arrived(2.0))
    assert len(fixes) == 50
    assert not any(fix.locked for fix in fixes)


def test_wandering_noise_has_its_size_and_its_memory() -> None:
    wandering = wander(sigma=2.0, time=0.5, period=0.01, seeds=np.random.SeedSequence(11))
    values = np.array(list(islice(wandering, 400_000)))
    assert np.std(values) == pytest.approx(2.0, rel=0.03)
    lag = 50  # one correlation time
    assert np.corrcoef(values[:-lag], values[lag:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.04)


def test_white_noise_is_what_numpy_draws_whatever_the_blocks() -> None:
    ours = sorted(islice(white(np.random.SeedSequence(5)), 1024))
    theirs = np.random.Generator(np.random.PCG64(np.random.SeedSequence(5))).standard_normal(1024)
    assert ours == sorted(theirs.tolist())


@pytest.mark.thorough
def test_a_float_position_lies_off_by_what_was_drawn_and_the_packets_say_that_it_is_one() -> None:
    often = replace(IDEAL, receiver_float_every=5.0, receiver_float_time=5.0, receiver_float_sigma=0.3)
    parameters = ReceiverParameters(MOUNTING)
    fixed, spells = (decode(record(one, 120.0)) for one in (parameters, replace(parameters, imperfections=often)))
    norths = [(fix.latitude - exact.latitude) * 6_371_000.0 for exact, fix in zip(fixed, spells, strict=True)]
    floats = [abs(north) > 1e-9 for north in norths]
    assert 0.2 < np.mean(floats) < 0.8
    assert 0.1 < np.std([north for north in norths if north]) < 0.6
    # The status channel that holds the quality comes every 2 s at most.
    for number in range(200, len(spells)):
        lately = floats[number - 200 : number + 1]
        said = spells[number].quality
        if all(lately):
            assert said is FixQuality.RTK_FLOAT
            assert spells[number].position_sigma == pytest.approx(0.3, abs=1e-3)
        elif not any(lately):
            assert said is FixQuality.RTK_FIXED


@pytest.mark.parametrize("rate", [10.0, 20.0, 30.0, 64.0, 100.0, 250.0])
def test_it_sends_as_many_fixes_a_second_as_it_is_set_to_and_evenly(rate: float) -> None:
    fixes = decode(record(ReceiverParameters(MOUNTING, rate=rate, delay=0.0, noise=0.0), 20.0))
    expected = min(rate, 100.0)
    assert len(fixes) == pytest.approx(20.0 * expected, abs=1)
    assert np.abs(np.diff([fix.time for fix in fixes]) - 1.0 / expected).max() < 0.0101  # the time between measurements
    assert fixes[-1].time - EPOCH == pytest.approx(20.0, abs=1.0 / expected)


def test_at_the_highest_rate_no_byte_is_another() -> None:
    assert record(ReceiverParameters(MOUNTING, rate=100.0), 5.0) == record(ReceiverParameters(MOUNTING), 5.0)


def test_the_slow_error_of_a_slow_receiver_lasts_as_long() -> None:
    """After its correlation time the correlation is exp(-1), whatever the rate (its standard error here is 0.09)."""
    slow = ReceiverParameters(MOUNTING, rate=10.0, position_white=0.0, position_wander=1.0, wander_time=1.0)
    exact = replace(slow, noise=0.0)
    pairs = zip(decode(record(slow, 200.0)), decode(record(exact, 200.0)), strict=True)
    errors = np.array([one.latitude - other.latitude for one, other in pairs])
    after_a_second = np.corrcoef(errors[:-10], errors[10:])[0, 1]
    assert after_a_second == pytest.approx(math.exp(-1.0), abs=0.2)


def test_bursts_change_when_fixes_arrive_and_nothing_of_what_they_say() -> None:
    parameters = ReceiverParameters(MOUNTING)
    held = replace(parameters, imperfections=vehicles.FUSION.measured)
    even, burst = record(parameters, 60.0), record(held, 60.0)
    assert [packet for _, packet in burst] == [packet for _, packet in even][: len(burst)]
    waits = [late - soon for (soon, _), (late, _) in zip(even, burst, strict=False)]
    assert min(waits) >= 0.0
    assert max(waits) <= 0.0481
    assert np.diff([time for time, _ in burst]).max() > 0.045
