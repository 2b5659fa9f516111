"""What is excused as a limit of what a gateway can know, and what is not."""

from __future__ import annotations

import pytest

from vve_sumo.hunt.episode import Action, Episode, EpisodePhase
from vve_sumo.hunt.known_limits import known


def episode(*actions: Action, phase: EpisodePhase = EpisodePhase.DRIVING) -> Episode:
    return Episode(phase, 1.0, actions)


FROZEN = Action("steering_report_frozen", 0.0, 4.0)


@pytest.mark.parametrize(
    ("other", "excused"),
    [
        (Action("dbw_dropout", 1.0, 4.0, 3.0), True),
        (Action("steering_override", 1.0, 4.0, 5.0), True),
        (Action("dbw_dropout", 1.0, 4.0, 1.0), False),
        (Action("dbw_dropout", 5.0, 4.0, 3.0), False),
        (Action("brake_override", 1.0, 4.0, 0.3), False),
    ],
    ids=["steering off", "steering taken over", "brakes off", "off later", "a foot"],
)
def test_a_frozen_report_excuses_its_own_module_while_it_is_frozen(other: Action, excused: bool) -> None:
    assert known("told_driving", episode(FROZEN, other)) is excused
    assert not known("told_driving", episode(other))
    assert not known("inside_lot", episode(FROZEN, other))


def test_a_foot_that_a_frozen_report_hides_is_excused_of_a_car_that_stands_alone() -> None:
    actions = (Action("brake_report_frozen", 0.0, 0.85), Action("brake_override", 0.02, 0.18, 0.221))
    for phase in EpisodePhase:
        assert known("told_driving", episode(*actions, phase=phase)) is (phase is EpisodePhase.AT_REST)
