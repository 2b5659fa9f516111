"""The gateway under pairs of faults, driver's actions, brain's behaviours: a sample, and all of them behind `slow`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.hunt.course import course
from vve_sumo.hunt import draw
from vve_sumo.hunt.episode import Action, Episode, EpisodePhase
from vve_sumo.hunt.findings import read_row
from vve_sumo.hunt.judging import Tolerances
from vve_sumo.hunt.known_limits import known
from vve_sumo.hunt.run import PAIR_PHASES
from vve_sumo.hunt.runner import EpisodeResult, run_alone, run_many
from vve_sumo.hunt.search import Search

FOUND = sorted((Path(__file__).parent / "found").glob("*.json"))
SAMPLE = 8


def surprises(results: Sequence[EpisodeResult]) -> list[str]:
    """Return a line for every violation that no known limit explains."""
    return [
        f"{result.episode}: {invariant}: {[one.text for one in result.violations]} {result.failure}"
        for result in results
        for invariant in result.broken
        if not known(invariant, result.episode)
    ]


def test_a_sample_of_the_pairs_breaks_nothing() -> None:
    episodes = [episode for _name, episode in draw.pairs(PAIR_PHASES, 1)[:SAMPLE]]
    results = list(run_many(course(), episodes, Tolerances(), workers=2))
    assert len(results) == SAMPLE
    assert surprises(results) == []


@pytest.mark.slow
@pytest.mark.parametrize("phase", list(EpisodePhase))
def test_no_pair_breaks_anything(phase: EpisodePhase) -> None:
    episodes = [episode for _name, episode in draw.pairs((phase,), 1)]
    results = list(run_many(course(), episodes, Tolerances(), workers=2))
    assert len(results) == len(episodes)
    assert surprises(results) == []


@pytest.mark.slow
def test_a_guided_search_breaks_nothing() -> None:
    search, found = Search(1), []
    for _ in range(10):
        episodes = search.batch()
        came = {str(one.episode.to_dict()): one for one in run_many(course(), episodes, Tolerances(), workers=2)}
        results = [came[str(one.to_dict())] for one in episodes]
        found += surprises(results)
        search.learn(results)
    assert found == []


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("file", FOUND, ids=lambda file: file.stem)
def test_what_was_found_once_is_not_found_again(file: Path) -> None:
    invariant, episode = read_row(file)
    result = run_alone(course(), episode, Tolerances())
    assert invariant not in result.broken, json.dumps(result.to_dict(), indent=1)
    assert not result.failure


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    "actions",
    [
        # A frozen brake report hides a driver who brakes the car to rest, hard or gently, and lifts the foot again.
        (Action("brake_report_frozen", 0.0, 14.0), Action("brake_override", 0.5, 5.0, 0.30)),
        (Action("brake_report_frozen", 0.0, 14.0), Action("brake_override", 0.5, 6.0, 0.26)),
        # A gentle foot on a healthy car, until rest.
        (Action("driver_touch", 0.0, 8.0, 0.215),),
        # A brain that asks for full throttle for ever.
        (Action("brain_full_throttle", 0.0, 12.0),),
        # A module that says that the driver took over, with nobody there.
        (Action("override_false", 0.0, 0.06, 1.0),),
        (Action("override_false", 0.0, 0.06, 2.0),),
    ],
    ids=str,
)
def test_a_driver_and_a_limit_are_kept_to(actions: tuple[Action, ...]) -> None:
    result = run_alone(course(), Episode(EpisodePhase.DRIVING, 1.0, actions), Tolerances())
    assert result.broken == (), result.violations
