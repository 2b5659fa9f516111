"""What an agent observes, what it is asked for and what it is paid, against numbers worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests import vehicles
from tests.bridges.law import PLACE
from vve_sumo.bridges.agent_link import AgentAction, LinkClosedError
from vve_sumo.bridges.agent_process import AgentController
from vve_sumo.bridges.agent_reward import MET_ALL, reward_of_end, reward_of_progress
from vve_sumo.bridges.observed_numbers import FARTHEST, FEATURES, HIGH, LOW, ObservationEncoder
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.schema import Criteria
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN
from vve_sumo.values import ControlCommand, Detections, Observation, Point, Pose

CAR = vehicles.FUSION.vehicle
BUMPER = CAR.rear_axle_to_bumper
STRAIGHT = ReferencePath.from_points([0.0, 500.0], [0.0, 0.0])
HEADING = 0.1


def observation(scan: Detections = BEFORE_FIRST_SCAN, **other: float) -> Observation:
    """An observation of a car that is 1 m left of a straight path and turned by HEADING."""
    pose = Pose(2.0, Point.REAR_AXLE, 100.0, 1.0, HEADING, 12.0, 0.0, 0.02, -1.5, 0.0)
    return replace(Observation(100, 2.0, pose, STRAIGHT, 13.0, {"radar": scan}, 0.03), **other)


def scan_of(*places: tuple[float, float, float]) -> Detections:
    """A scan, 0.1 s before the observation, of places in the map as they are then, with their range rates."""
    front = 100.0 + BUMPER * math.cos(HEADING), 1.0 + BUMPER * math.sin(HEADING)
    ranges = [math.hypot(x - front[0], y - front[1]) - 0.1 * rate for x, y, rate in places]
    angles = [math.atan2(y - front[1], x - front[0]) - HEADING for x, y, _rate in places]
    rates = [rate for _x, _y, rate in places]
    return Detections(1.9, np.array(ranges), np.array(angles), np.array(rates), np.zeros(len(places), np.int8))


def test_the_car_and_its_place_are_observed_as_they_are() -> None:
    seen = ObservationEncoder(CAR).encode(observation())
    expected = [12.0, -1.5, 0.02, 1.0, HEADING, 0.03, 13.0, 400.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    assert seen[: len(expected)] == pytest.approx(expected, abs=1e-4)
    assert seen[len(expected) :].tolist() == [FARTHEST, 0.0, 0.0] * 4
    assert len(seen) == len(FEATURES)


def test_detections_lie_along_the_path_the_nearest_first() -> None:
    far, near, beside, behind = (180.0, -2.0, -12.0), (150.0, 0.5, -5.0), (160.0, 7.5, -12.0), (90.0, 0.0, 0.0)
    seen = ObservationEncoder(CAR).encode(observation(scan_of(far, near, beside, behind)))
    first = PLACE["ahead_1_m"]
    expected = [50.0 - BUMPER, 0.5, -5.0, 80.0 - BUMPER, -2.0, -12.0, FARTHEST, 0.0, 0.0, FARTHEST, 0.0, 0.0]
    assert seen[first:] == pytest.approx(expected, abs=1e-3)
    assert seen[PLACE["scan_age_s"]] == pytest.approx(0.1)


def test_every_number_stays_within_its_bounds() -> None:
    wild = observation(scan_of((101.0, 1.0, 500.0)), steering=math.nan)
    pose = replace(wild.pose, speed=300.0, acceleration=-99.0, yaw_rate=9.0, y=400.0)
    seen = ObservationEncoder(CAR).encode(replace(wild, pose=pose))
    assert seen.dtype == np.float32
    assert ((seen >= LOW) & (seen <= HIGH)).all()
    assert seen[PLACE["steering_rad"]] == 0.0


class Script:
    """A link whose agent says one action after the other, and is gone then."""

    def __init__(self, *actions: AgentAction) -> None:
        self.actions, self.observed = list(actions), 0

    def send_observation(self, observation: object) -> None:
        self.observed += 1

    def receive_action(self) -> AgentAction:
        if not self.actions:
            raise LinkClosedError
        return self.actions.pop(0)


class Own:
    """The scenario's controller."""

    def step(self, observation: Observation) -> ControlCommand:
        return ControlCommand(0.2, 0.7, note="own")


def controller(script: Script, *, agent_steers: bool = False) -> AgentController:
    return AgentController(
        Own(), script, ObservationEncoder(CAR), ticks_per_action=3, agent_steers=agent_steers, comfort_deceleration=3.5
    )


def test_an_action_holds_for_its_ticks_and_asks_for_emergency_braking_where_it_is_that_hard() -> None:
    script = Script(AgentAction(-3.5, 0.1), AgentAction(-3.6, 0.1))
    mine = controller(script)
    commands = [mine.step(observation()) for _ in range(6)]
    assert [command.acceleration for command in commands] == [-3.5] * 3 + [-3.6] * 3
    assert [command.emergency for command in commands] == [False] * 3 + [True] * 3
    assert {command.steering for command in commands} == {0.2}
    assert script.observed == 2
    with pytest.raises(KeyboardInterrupt):
        mine.step(observation())


def test_an_agent_that_steers_does_so() -> None:
    assert controller(Script(AgentAction(1.0, 0.1)), agent_steers=True).step(observation()).steering == 0.1


def test_before_the_drive_begins_the_scenarios_controller_drives() -> None:
    script = Script()
    assert controller(script, agent_steers=True).step(observation(time=-0.02)) == ControlCommand(0.2, 0.7, note="own")
    assert script.observed == 0


def test_what_is_no_number_is_no_action() -> None:
    command = controller(Script(AgentAction(math.nan, 0.0))).step(observation())
    assert math.isnan(command.acceleration)  # which the guard around every controller refuses


CRITERIA = Criteria.model_validate({"outcome": "stopped", "collision": False, "stop_gap_m": {"min": 4.0, "max": 5.0}})


@pytest.mark.parametrize(
    ("figures", "score"),
    [
        ({"outcome": "stopped", "collision": False, "stop_gap_m": 4.5, "passed": True}, 1.0),
        ({"outcome": "stopped", "collision": False, "stop_gap_m": 10.0, "passed": False}, 0.5 * 1 / 2),
        ({"outcome": "stopped", "collision": False, "stop_gap_m": 2.0, "passed": False}, 0.5 * 2 / 3),
        ({"outcome": "timeout", "collision": False, "stop_gap_m": None, "passed": False}, 0.0),
    ],
)
def test_the_end_is_paid_by_how_well_it_meets_the_criteria(figures: dict[str, object], score: float) -> None:
    assert reward_of_end(CRITERIA, figures) == pytest.approx(MET_ALL * score)


def test_a_contact_costs_more_than_driving_on_into_it_gains() -> None:
    """A car that could stop 30 m before and drives on at the desired speed gains the time of the way, 30 m / 8 m/s."""
    halted = reward_of_end(CRITERIA, {"outcome": "stopped", "collision": False, "stop_gap_m": 30.0, "passed": False})
    touched = [
        reward_of_end(CRITERIA, {"outcome": "contact", "collision": True, "passed": False, "impact_speed_mps": speed})
        for speed in (0.0, 0.4, 8.0, math.nan, None)
    ]
    assert touched == [-5.0, -5.4, -13.0, -5.0, -5.0]
    assert all(cost + reward_of_progress(30.0, 8.0) < halted for cost in touched)


def test_progress_is_paid_by_the_time_that_it_takes_at_the_desired_speed() -> None:
    assert reward_of_progress(6.0, 12.0) == 0.5
