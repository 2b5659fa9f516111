"""When injected faults are on, and how their strength goes over time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plant.faulty_ride import AT, PARAMETERS, Ride, fault, lively
from tests.plant.test_car import EPOCH, LOT, START
from vve_sumo.plant.car import Car
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.fault_injector import FaultInjector
from vve_sumo.plant.injected_faults import KINDS, NEUTRAL, VALUES, Due, FaultClock, InjectedFault, Shape
from vve_sumo.values import Fix
from vve_sumo.vehicle.interface import DEFAULT


def same_outside(ride: Ride, plain: Ride) -> None:
    """Before the fault, what the car says is untouched."""
    before = ride.began + AT - 0.02
    for name in ("packets", "frames"):
        ours, theirs = ([item for item in getattr(each, name) if item[0] < before] for each in (ride, plain))
        assert ours == theirs
        assert ours


def test_a_ride_without_faults_moves_and_is_trusted(plain):
    assert 1.0 < plain.began < 2.0
    assert plain.car.truth().speed > 3.0
    assert not [time for time, _ in plain.packets if not 0.01 < time <= 5.0]
    assert plain.untrusted() == set()


@pytest.fixture(scope="module")
def livelier() -> Ride:
    return Ride(course=lively)


#: What must happen besides, so that a kind shows.
NEEDED = {
    "brake_driver_bits_zero": (fault("driver_touch"),),
    "throttle_driver_bits_zero": (InjectedFault("throttle_override", AT, 0.05),),
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_before_its_time_a_fault_does_nothing_and_a_ride_is_repeatable(kind, livelier):
    needed = NEEDED.get(kind, ())
    plain = Ride(*needed, course=lively) if needed else livelier
    ride, again = (Ride(fault(kind), *needed, course=lively) for _ in range(2))
    same_outside(ride, plain)
    assert (ride.packets, ride.frames) == (again.packets, again.frames)
    changed = (ride.packets, ride.frames, ride.enabled) != (plain.packets, plain.frames, plain.enabled)
    assert changed, "every kind does something"


@pytest.mark.thorough(witnesses=14)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_car_that_never_moves_has_no_faults(kind):
    faults = [InjectedFault(kind, 0.0, 1e9)]
    seeds = np.random.SeedSequence
    car = FaultInjectedCar(PARAMETERS, START, LOT, EPOCH, seeds(1), faults, seeds(0))
    same = Car(PARAMETERS, START, LOT, EPOCH, seeds(1))
    for step in range(100):
        until = (step + 1) / 200
        assert car.step(until, []) == same.step(until, [])


@given(st.sampled_from(sorted(NEUTRAL)), st.floats(0.0, 1.0), st.floats(0.1, 20.0), st.floats(0.0, 5.0))
def test_a_ramp_grows_evenly_from_what_does_nothing_to_its_value(kind, share, duration, at):
    _usual, least, most = VALUES[kind]
    value = least + share * (most - least)
    due = Due([InjectedFault(kind, at, duration, value, Shape.RAMP, clock=FaultClock.DRIVE)])
    began, half = due.share(kind, at), due.share(kind, at + duration / 2.0)
    assert began is not None
    assert half is not None
    assert began.value == pytest.approx(NEUTRAL[kind])
    assert half.value == pytest.approx((NEUTRAL[kind] + value) / 2.0, rel=1e-6, abs=1e-9)
    assert half.total == pytest.approx((0.75 * NEUTRAL[kind] + 0.25 * value) * duration / 2.0, rel=1e-6, abs=1e-6)
    assert due.share(kind, at + duration + 1e-6) is None


@given(st.floats(0.02, 2.0), st.floats(0.0, 10.0), st.floats(0.1, 20.0))
def test_a_flapping_fault_is_on_and_off_in_turn_and_begins_on(period, since, duration):
    due = Due(
        [InjectedFault("pose_rtk_lost", 1.0, duration, shape=Shape.FLAPPING, period=period, clock=FaultClock.DRIVE)]
    )
    turn = since / period
    if abs(turn - round(turn)) < 1e-6 or abs(since - duration) < 1e-6:
        return
    share = due.share("pose_rtk_lost", 1.0 + since)
    assert (share is not None) == (since < duration and math.floor(turn) % 2 == 0)
    if share is not None:
        assert share.since == pytest.approx(since - math.floor(turn) * period, abs=1e-6)


def test_times_count_from_the_start_of_the_drive_or_from_the_first_motion():
    faults = [InjectedFault("pose_lost", 1.0, 1.0, clock=FaultClock.DRIVE), InjectedFault("bus_silent", 1.0, 1.0)]
    due = Due(faults)
    assert [due.value(kind, 1.5) is None for kind in ("pose_lost", "bus_silent")] == [False, True]
    due.moves(3.0, 2.0)
    assert [due.value(kind, 4.5) is None for kind in ("pose_lost", "bus_silent")] == [True, False]


def test_a_fix_passes_unchanged_where_nothing_is_due(plain):
    untouched: Callable[[Fix], Fix | None] = FaultInjector([], np.random.SeedSequence(0), DEFAULT).on_fix
    assert all(untouched(fix) is fix for fix in plain.fixes)
