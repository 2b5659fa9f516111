"""Old reports among fresh ones, against the recordings of a real car, the simulated one and what wheels can do."""

from __future__ import annotations

import csv
import math
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plant.faulty_ride import Ride, lively
from tests.vehicle.car import FUSION, PERIOD, Rig
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.report_consistency import SPEED_SPIKE, STEERING_SPIKE, YAW_RATE_SPIKE, ReportConsistency
from vve_sumo.vehicle.reports import CarReports

CODE = ["reports_inconsistent"]
LOGS = ("car_50km", "car_60km", "collision_assist_activated", "lkast_activated")
AGE = 0.4  #: of the old reports [s]

#: rear axle's speed [m/s], yaw rate [rad/s], angle of the steering wheel [rad]
Reported = tuple[float, float, float]


def recorded(folder: Path, log: str) -> list[tuple[float, Reported]]:
    """What a real Ford Fusion reported, with the times."""
    file = folder / "drives" / "ford_fusion" / f"tidy_{log}.csv"
    with file.open() as lines:
        rows = [{name: float(text or "nan") for name, text in row.items()} for row in csv.DictReader(lines)]
    return [
        (
            row["t"],
            (
                0.5 * (row["wheel_rl_radps"] + row["wheel_rr_radps"]) * FUSION.wheel_radius,
                row["yaw_rate_radps"],
                math.radians(row["steer_wheel_deg"]),
            ),
        )
        for row in rows
    ]


def said(reports: Iterable[tuple[float, Reported]]) -> list[float]:
    """Times at which the reports are called inconsistent."""
    consistency, found = ReportConsistency(), []
    for now, (speed, yaw_rate, angle) in reports:
        consistency.speed.step(now, speed)
        consistency.yaw_rate.step(now, yaw_rate)
        consistency.wheel_angle.step(now, angle)
        if consistency.faults(now) == CODE:
            found.append(now)
    return found


def mixed(reports: Sequence[tuple[float, Reported]], every: int) -> list[tuple[float, Reported]]:
    """The same, where the one of `AGE` before follows every so manieth."""
    sent, back = [], round(AGE / 0.01)
    for number, (now, values) in enumerate(reports):
        sent.append((now, values))
        if number % every == 0 and number >= back:
            sent.append((now, reports[number - back][1]))
    return sent


@pytest.mark.parametrize("log", LOGS)
def test_a_real_cars_reports_are_consistent(shared_data: Path, log: str) -> None:
    """At 50 and 60 km/h, with lane keeping at work, and braking with 5.9 m/s2."""
    reports = recorded(shared_data, log)
    assert len(reports) > 400
    assert said(reports) == []
    assert said(reports[::2]) == [], "nor at half the rate"


def greatest_spike(values: Sequence[float]) -> float:
    """By how much a value lies off both its neighbours, on the same side, at most."""
    triples = zip(values, values[1:], values[2:], strict=False)
    return max((min(abs(b - a), abs(b - c)) for a, b, c in triples if (b - a) * (b - c) > 0.0), default=0.0)


def test_a_real_cars_reports_lie_off_their_neighbours_by_a_fifth_of_the_bounds_at_most(shared_data: Path) -> None:
    spikes = [
        [greatest_spike([one[kind] for _, one in reports[::step]]) for kind in range(3)]
        for reports in (recorded(shared_data, log) for log in LOGS)
        for step in (1, 2)
    ]
    speed, yaw_rate, angle = (max(of_one) for of_one in zip(*spikes, strict=True))
    assert speed == pytest.approx(0.065, abs=5e-4)
    assert speed < 0.2 * SPEED_SPIKE
    assert yaw_rate == pytest.approx(0.0022, abs=5e-5)
    assert yaw_rate < 0.2 * YAW_RATE_SPIKE
    assert math.degrees(angle) == pytest.approx(0.3, abs=0.005)
    assert angle < 0.2 * STEERING_SPIKE


@pytest.mark.parametrize("every", [1, 2, 5])
def test_old_ones_among_them_are_found_while_the_car_brakes(shared_data: Path, every: int) -> None:
    reports = recorded(shared_data, "collision_assist_activated")
    slows = next(now for (now, one), (_, later) in zip(reports, reports[40:], strict=False) if later[0] < one[0] - 1.0)
    found = said(mixed(reports, every))
    assert found
    assert found[0] < slows + AGE + 0.5


def heard(frames: Iterable[tuple[float, Frame]], wire: DataspeedDbw1) -> list[float]:
    """Times at which a car's frames, taken in step by step, are called inconsistent."""
    reports, waiting, found = CarReports(FUSION.wheel_radius, wire), deque(frames), []
    for step in range(round(waiting[-1][0] / PERIOD) + 2):
        now, taken = step * PERIOD, []
        while waiting and waiting[0][0] <= now:
            taken.append(waiting.popleft()[1])
        reports.take(now, taken)
        if reports.consistency.faults(now):
            found.append(now)
    return found


@pytest.mark.parametrize("old", [True, False])
def test_a_simulated_cars_reports_are_consistent(old: bool) -> None:
    """It pulls away, brakes and swings its steering; then the same with a report of 0.4 s before after every second."""
    ride = Ride(seconds=8.0, course=lively)
    wire = DataspeedDbw1(ride.variant)
    assert heard(ride.frames, wire) == []
    sent, kept = [], dict[int, deque[tuple[float, Frame]]]()
    for number, (now, frame) in enumerate(ride.frames):
        before = kept.setdefault(frame.id, deque())
        before.append((now, frame))
        sent.append((now, frame))
        while before[0][0] < now - AGE:
            before.popleft()
        if old and number % 2 == 0 and now > 2.0:
            sent.append((now, before[0][1]))
    assert bool(heard(sent, wire)) is old


@given(st.floats(5.0, 20.0), st.floats(0.0, 0.01), st.floats(0.02, 0.2))
def test_wheels_that_lock_or_swing_under_an_anti_lock_brake_are_consistent(speed: float, phase: float, falls: float):
    """Locked within 20 ms to 0.2 s and rolling again as fast, twice a second; swinging by 1 m/s at 8 Hz."""

    def locking(time: float) -> float:
        there = (time + phase) % 0.5
        return speed * min(max(abs(there - 0.25) / falls, 0.0), 1.0)

    times = [0.01 * k for k in range(300)]
    assert said([(now, (locking(now), 0.0, 0.0)) for now in times]) == []
    swings = [(now, (speed + math.sin(math.tau * 8.0 * (now + phase)), 0.0, 0.0)) for now in times]
    assert said(swings) == []


def test_a_damaged_report_now_and_then_is_none_and_no_number_is_no_jump() -> None:
    reports = [(0.01 * k, (0.0 if k % 20 == 0 else 8.0, math.nan if k % 3 == 0 else 0.1, 0.0)) for k in range(300)]
    assert said(reports) == []
    often = [(0.01 * k, (0.0 if k % 10 == 0 else 8.0, 0.1, 0.0)) for k in range(100)]
    found = said(often)
    assert found[0] == pytest.approx(0.41), "the fourth within half a second, found with the report after it"
    assert said([*often, *[(1.0 + 0.01 * k, (8.0, 0.1, 0.0)) for k in range(100)]])[-1] < 1.5


class Mixing(Rig):
    """A rig whose car's reports of `AGE` before come after every fresh one, on the wires of these numbers."""

    def __init__(self, *numbers: int) -> None:
        super().__init__()
        self.numbers, self.on = numbers, False
        self.sent: deque[list[Frame]] = deque(maxlen=round(AGE / PERIOD) + 1)

    def old(self) -> tuple[Frame, ...]:
        """Reports of `AGE` before."""
        self.sent.append(self.car.reports())
        return tuple(frame for frame in self.sent[0] if frame.id in self.numbers) if self.on else ()


@pytest.mark.parametrize("number", [layout.WHEEL_SPEEDS, layout.STEERING_REPORT, layout.YAW_RATE])
def test_old_reports_among_fresh_ones_stop_the_car(number: int) -> None:
    """At 5 m/s, gaining speed in a bend; the newest report of a step is old, but what counts is every one."""
    rig = Mixing(number)
    rig.cruise(5.0)
    for tick in range(50):
        assert rig.step(1.0, 0.05 * math.sin(tick / 12.0), extra=rig.old()).state is ArmingState.ENGAGED
    rig.on = True
    statuses = [rig.step(1.5, 0.1 * math.sin(tick / 6.0), extra=rig.old()) for tick in range(60)]
    stopping = next(one for one in statuses if one.state is not ArmingState.ENGAGED)
    assert stopping.state is ArmingState.STOPPING
    assert stopping.reasons[0] in ("reports_inconsistent", "steering_mismatch", "yaw_rate_mismatch")
    assert "reports_inconsistent" in statuses[-1].reasons
