"""An episode that is forked off a nominal drive is the very one that is driven alone; it is the same each time."""

from __future__ import annotations

import pytest

from tests.hunt.course import course
from vve_sumo.hunt.episode import Action, Episode, EpisodePhase
from vve_sumo.hunt.judging import Tolerances
from vve_sumo.hunt.runner import EpisodeResult, run_alone, run_many
from vve_sumo.plant.injected_faults import Shape

EPISODES = (
    Episode(EpisodePhase.ARMING, 0.0, (Action("bus_silent", 0.0, 0.3), Action("key_stop", 0.5, 1.0))),
    Episode(EpisodePhase.HELD, 0.2, (Action("pose_garbage", 0.0, 1.0), Action("driver_touch", 0.4, 0.3, 0.2))),
    Episode(
        EpisodePhase.DRIVING,
        0.3,
        (Action("brakes_weak", 0.0, 2.0, 0.2, Shape.RAMP), Action("brain_flapping", 0.1, 2.0)),
    ),
    Episode(
        EpisodePhase.DRIVING,
        0.3,
        (Action("wheel_speeds_frozen", 0.0, 2.0, shape=Shape.FLAPPING, period=0.1), Action("key_stop", 0.3, 1.0)),
    ),
)


@pytest.mark.thorough
def test_forked_and_driven_alone_are_the_same() -> None:
    forked = {str(one.episode): one for one in run_many(course(), EPISODES, Tolerances(), workers=3)}
    assert len(forked) == len(EPISODES)
    for episode in EPISODES:
        alone = run_alone(course(), episode, Tolerances())
        assert forked[str(episode)].to_dict() == alone.to_dict()


def test_what_comes_of_an_episode_survives_json() -> None:
    result = run_alone(course(), EPISODES[1], Tolerances())
    assert EpisodeResult.from_dict(result.to_dict()).to_dict() == result.to_dict()


def test_an_exception_in_the_program_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_arguments: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("vve_sumo.vehicle.arming_machine.ArmingMachine.apply", fails)
    (result,) = run_many(course(), EPISODES[:1], Tolerances())
    assert result.broken == ("exception",)
    assert "RuntimeError: a bug" in result.failure


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("phase", [EpisodePhase.ARMING, EpisodePhase.ENGAGING, EpisodePhase.HELD, EpisodePhase.DRIVING])
def test_a_nominal_drive_breaks_nothing(phase: EpisodePhase) -> None:
    result = run_alone(course(), Episode(phase, 0.5, ()), Tolerances())
    assert result.broken == ()
    assert result.margin > 0.5
