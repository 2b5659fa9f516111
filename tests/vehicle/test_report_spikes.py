"""Reports that jump to and fro: how far, how often, and within which time, by hand."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest

from vve_sumo.vehicle.report_consistency import ReportConsistency

STEP = 2.0**-6  # between two reports [s], exact
CODE = ["reports_inconsistent"]
FAR = [1.0, 0.0]  # to one side and back: a spike of any measurement
BOUNDS = [("speed", 0.35), ("yaw_rate", 0.05), ("wheel_angle", 0.07)]  # m/s, rad/s, rad


def after(values: Iterable[float], measurement: str = "speed") -> list[str]:
    """What is said after these reports, one every `STEP` from 0 on."""
    consistency, now = ReportConsistency(), 0.0
    for number, value in enumerate(values):
        now = STEP * number
        getattr(consistency, measurement).step(now, value)
    return consistency.faults(now)


def resting(values: Iterable[float]) -> list[float]:
    """Each value with a rest after it, of which nothing is off both neighbours."""
    return [value for pair in values for value in (pair, pair)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("measurement", "bound"), BOUNDS)
def test_a_spike_is_more_than_a_car_can_do(measurement: str, bound: float, sign: float) -> None:
    """Off both its neighbours, four times; what is off by just the bound is none."""
    assert after([0.9 * bound, 0.0] * 20, measurement) == []
    assert after([sign * bound, 0.0] * 20, measurement) == []
    assert after([sign * bound, -sign, -sign, 0.0, 0.0] * 20, measurement) == [], "nor where it goes back by more"
    assert after([0.0, *[sign * 1.001 * bound, 0.0, 0.0] * 4], measurement) == CODE


def test_three_spikes_are_forgiven_and_the_fourth_is_not() -> None:
    assert after([*FAR, 0.0] * 3) == []
    assert after([*FAR, 0.0] * 4) == CODE


def test_to_and_fro_each_report_is_a_spike_of_the_one_before() -> None:
    assert after([1.0, 0.0, 1.0, 0.0]) == [], "three: of the first, the second and the third"
    assert after([1.0, 0.0, 1.0, 0.0, 1.0]) == CODE


def test_a_jump_is_no_spike_without_its_way_back() -> None:
    assert after(range(100)) == [], "ever upwards"
    assert after(range(0, -100, -1)) == []
    assert after(resting([1.0, 0.0] * 20)) == [], "stays where it has jumped to"
    assert after(resting([-1.0, 0.0] * 20)) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_before_its_first_report_a_car_stands(sign: float) -> None:
    """A first report that is off is a spike where the next says zero."""
    assert after([sign, 0.0, 0.0, *[*FAR, 0.0] * 3]) == CODE
    assert after([sign, sign, sign, *[sign + 1.0, sign, sign] * 3]) == []


def test_the_four_lie_within_half_a_second() -> None:
    """32 reports from the first to the last; nothing is said any more a report later."""
    spikes = [*FAR, 0.0] * 3  # found with the second, fifth and eighth report
    last = [0.0] * (32 - 9) + FAR
    assert after([*spikes, *last]) == CODE
    assert after([*spikes, *last, 0.0]) == []
    assert after([*spikes, 0.0, *last]) == []


def test_the_newest_four_count() -> None:
    assert after([*FAR, *[0.0] * 60, *[*FAR, 0.0] * 4]) == CODE, "though a fifth was a second ago"


def test_spikes_of_several_measurements_do_not_add_up() -> None:
    consistency = ReportConsistency()
    for number, value in enumerate([*FAR, 0.0] * 3):
        for spikes in (consistency.speed, consistency.yaw_rate, consistency.wheel_angle):
            spikes.step(STEP * number, value)
        assert consistency.faults(STEP * number) == []


def test_what_is_no_number_is_no_jump() -> None:
    assert after([1.0, math.nan, 0.0, math.nan] * 20) == []
    assert after([1.0, 1.0, math.nan, 0.0, 0.0] * 20) == []
