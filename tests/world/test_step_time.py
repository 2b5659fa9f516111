"""Traffic held within what a tick has room for: the budget on numbers, SUMO on a clock that counts vehicles."""

from __future__ import annotations

import math
from pathlib import Path

import libsumo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, demand, grid, pose, trips
from vve_sumo.values import EGO
from vve_sumo.world.obstacles import LaneSpot, Obstacle
from vve_sumo.world.step_time import (
    LIMIT,
    PROTECTED_RADIUS,
    RANK,
    SETTLING_STEPS,
    WINDOW,
    StepTimeJudge,
    TrafficMeasure,
)
from vve_sumo.world.world import World

QUICK, SLOW = 0.5 * LIMIT, 2.0 * LIMIT


def fed(budget: StepTimeJudge, took: float, steps: int) -> list[TrafficMeasure]:
    """What is said to so many equal steps."""
    return [budget.step(took) for _ in range(steps)]


def test_quick_steps_fit_once_enough_of_them_were_measured():
    budget = StepTimeJudge()
    assert set(fed(budget, QUICK, SETTLING_STEPS - 1)) == {TrafficMeasure.NOTHING}
    assert not budget.summary.fits
    budget.step(QUICK)
    assert budget.summary.fits
    assert not budget.closed


def test_two_hiccups_are_the_machines_and_three_the_traffics():
    budget = StepTimeJudge()
    fed(budget, QUICK, WINDOW)
    said = []
    for _ in range(RANK - 1):
        said += [budget.step(1.0), *fed(budget, QUICK, 40)]
    assert set(said) == {TrafficMeasure.NOTHING}
    assert budget.step(1.0) is TrafficMeasure.REFUSE


@pytest.mark.parametrize("took", [SLOW, math.nan, math.inf, -1.0])
def test_the_street_is_closed_first_and_thinned_where_that_is_not_enough(took):
    budget = StepTimeJudge()
    said = fed(budget, took, 2 * SETTLING_STEPS + RANK)
    assert said.index(TrafficMeasure.REFUSE) == RANK - 1
    assert [i for i, one in enumerate(said) if one is TrafficMeasure.THIN] == [
        RANK - 1 + SETTLING_STEPS,
        RANK - 1 + 2 * SETTLING_STEPS,
    ]
    assert budget.closed
    assert not budget.summary.fits
    assert budget.summary.refusals == 1


def test_twice_the_limit_takes_half_of_the_traffic():
    budget = StepTimeJudge()
    fed(budget, SLOW, RANK)
    assert budget.share == pytest.approx(0.5)


def test_the_street_opens_when_there_is_room_and_each_time_later():
    budget = StepTimeJudge()
    waits = []
    for _ in range(3):
        fed(budget, SLOW, RANK)
        assert budget.closed
        said = fed(budget, QUICK, 10 * WINDOW)
        waits.append(said.index(TrafficMeasure.ADMIT) + 1)
        assert said.count(TrafficMeasure.ADMIT) == 1
    assert waits == [WINDOW, 2 * WINDOW, 4 * WINDOW]


def test_where_it_is_just_enough_the_street_stays_closed():
    budget = StepTimeJudge()
    fed(budget, SLOW, RANK)
    assert TrafficMeasure.ADMIT not in fed(budget, 0.9 * LIMIT, 20 * WINDOW)
    assert budget.summary.fits


@settings(deadline=None)
@given(st.lists(st.sampled_from([0.0, QUICK, LIMIT, SLOW, math.nan]), max_size=800))
def test_measures_come_in_order_and_with_time_between(times):
    budget, last, closed = StepTimeJudge(), -math.inf, False
    for i, took in enumerate(times):
        measure = budget.step(took)
        if measure is TrafficMeasure.NOTHING:
            continue
        assert closed == (measure is not TrafficMeasure.REFUSE)
        assert i - last >= (RANK if measure is TrafficMeasure.REFUSE else SETTLING_STEPS)
        closed, last = measure is not TrafficMeasure.ADMIT, i
        assert budget.closed == closed


class Scale:
    """A clock on which a step takes so long for each vehicle on the virtual road."""

    def __init__(self, each: float) -> None:
        self.each, self.calls, self.now = each, 0, 0.0

    def __call__(self) -> float:
        self.calls += 1
        if self.calls % 2 == 0:
            self.now += self.each * libsumo.vehicle.getIDCount()
        return self.now


def _crowded(folder: str, each: float, steps: int) -> dict[str, object]:
    root = Path(folder)
    network = grid(root, size=8, length=150.0)
    cars = trips(root, network, 400, 0.25)
    box = Obstacle("box", LaneSpot("A0B0_0", 60.0))
    far = Obstacle("far", LaneSpot("G7H7_0", 60.0))
    gone: list[float] = []
    counts = []
    with World(
        network,
        demand=[cars],
        seed=3,
        period=PERIOD,
        egos=ALONE,
        obstacles=[box, far],
        warm_up=60.0,
        clock=Scale(each),
    ) as world:
        places: dict[str, tuple[float, float]] = {}
        lanes, arriving = 0, set()
        for k in range(steps):
            # Across a lane line, so that there are ghosts.
            assert world.step({EGO: pose(k * PERIOD, 20.0, -3.2, 0.0, 0.0)})[EGO].faults == ()
            lanes = max(lanes, len(world.proxy_lanes(EGO)))
            here = {name: libsumo.vehicle.getPosition(name) for name in libsumo.vehicle.getIDList()}
            # SUMO lists those taken off among the arrived; who arrives was on the last edge of its route.
            gone += [math.dist(places[name], (20.0, -3.2)) for name in places.keys() - here.keys() - arriving]
            places = here
            vehicle = libsumo.vehicle
            arriving = {name for name in here if vehicle.getRouteIndex(name) == len(vehicle.getRoute(name)) - 1}
            counts.append(len(here))
        assert world.step_time_budget is not None
        kept = [name for name in here if name.startswith(("ego", "obstacle_stand_in"))]
        return {
            "summary": world.step_time_budget.summary,
            "fits": world.step_time_budget.fits,
            "gone": gone,
            "counts": counts,
            "kept": sorted(kept),
            "ghosts": lanes,
        }


@pytest.mark.thorough
def test_far_traffic_is_taken_off_until_the_steps_fit(tmp_path):
    found = isolated(_crowded, str(tmp_path), 0.0002, 900)
    summary, counts = found["summary"], found["counts"]
    assert counts[0] > 100
    assert counts[0] * 0.0002 > LIMIT
    assert found["fits"]
    assert counts[-1] * 0.0002 <= LIMIT
    assert counts[-1] > 0.5 * LIMIT / 0.0002  # no more than needed
    assert summary["removed"] > 0
    assert summary["before_s"] > LIMIT >= summary["now_s"]
    assert min(found["gone"]) > PROTECTED_RADIUS - 1.0
    assert len(found["gone"]) > 0.5 * summary["removed"]
    assert "ego" in found["kept"]
    assert found["ghosts"] > 0
    assert sum(name.startswith("ego_ghost") for name in found["kept"]) == found["ghosts"]
    assert sum(name.startswith("obstacle") for name in found["kept"]) == 2


@pytest.mark.slow
def test_while_the_street_is_closed_who_departs_far_away_is_turned_away(tmp_path):
    found = isolated(_crowded, str(tmp_path), 0.0002, 500)
    assert found["summary"]["refusals"] == 1
    assert found["summary"]["refused"] > 5


@pytest.mark.slow
def test_where_the_steps_fit_nobody_is_touched(tmp_path):
    found = isolated(_crowded, str(tmp_path), 0.00001, 400)
    assert found["fits"]
    assert found["gone"] == []
    assert (found["summary"]["refusals"], found["summary"]["removed"], found["summary"]["refused"]) == (0, 0, 0)
    assert found["summary"]["before_s"] is None


def _action_phases(folder: str, clock: bool) -> list[int]:
    root = Path(folder)
    network = grid(root)
    body = '<vType id="calm" actionStepLength="0.2"/>' + "".join(
        f'<vehicle id="v{i}" type="calm" depart="0" departPos="{20 + 10 * i}" departLane="{lane}">'
        f'<route edges="{edge} {onward}"/></vehicle>'
        for i, (edge, onward, lane) in enumerate(
            (e, o, lane) for e, o in (("B0C0", "C0D0"), ("B1C1", "C1D1"), ("B2C2", "C2D2")) for lane in (0, 1)
        )
    )
    with World(
        network,
        demand=[demand(root, body)],
        seed=3,
        period=PERIOD,
        egos=ALONE,
        warm_up=1.0,
        clock=Scale(0.0) if clock else None,
    ) as world:
        for k in range(30):
            world.step({EGO: pose(k * PERIOD, 20.0, -1.6, 0.0, 0.0)})
        names = [name for name in libsumo.vehicle.getIDList() if name.startswith("v")]
        return sorted(round(libsumo.vehicle.getLastActionTime(name) / PERIOD) % 10 for name in names)


@pytest.mark.thorough
def test_drivers_act_by_turns(tmp_path):
    phases = isolated(_action_phases, str(tmp_path), True)
    assert len(phases) == len(set(phases)) == 6
    assert len(set(isolated(_action_phases, str(tmp_path), False))) == 1
