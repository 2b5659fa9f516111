"""What is drawn is valid and repeats by its seed; a hunt that was cut off goes on; shrinking keeps what fails."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.hunt import draw
from vve_sumo.hunt.brains import BEHAVIOURS
from vve_sumo.hunt.episode import DRIVER, FAULTS, Action, Episode, EpisodePhase, RoadConditions
from vve_sumo.hunt.findings import Findings, HuntFinding, faults_text, read_row
from vve_sumo.hunt.journal import EPISODES, QUERY, HuntJournal
from vve_sumo.hunt.known_limits import known
from vve_sumo.hunt.run import Hunt, HuntQuery
from vve_sumo.hunt.runner import EpisodeResult
from vve_sumo.hunt.search import BATCH, BLIND, Search
from vve_sumo.hunt.shrink import shrunk
from vve_sumo.plant.injected_faults import Shape
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.resolve import faults_of


def result_of(episode: Episode, margin: float = 1.0, broken: Sequence[str] = ()) -> EpisodeResult:
    violations = tuple((name, 1.0, "text") for name in broken)
    return EpisodeResult.from_dict(
        EpisodeResult(episode, (), {"speed_limit": margin}, "", (), 1.0).to_dict() | {"violations": violations}
    )


def test_every_draw_and_every_neighbour_survives_json() -> None:
    random = Random(1)
    for _ in range(500):
        episode = draw.episode(random, RoadConditions(friction=0.5), 2)
        for _ in range(4):
            assert 1 <= len(episode.actions) <= draw.MAX_ACTIONS
            assert episode.actions[0].after == 0.0
            assert str(Episode.from_dict(json.loads(json.dumps(episode.to_dict())))) == str(episode)
            episode = draw.mutated(episode, random)


def test_the_pairs_are_all_pairs_once_in_every_phase() -> None:
    named = draw.pairs((EpisodePhase.DRIVING, EpisodePhase.BEND), 1)
    assert named != draw.pairs((EpisodePhase.DRIVING, EpisodePhase.BEND), 2)
    assert [name for name, _ in named] == [name for name, _ in draw.pairs((EpisodePhase.DRIVING, EpisodePhase.BEND), 1)]
    assert len({name for name, _ in named}) == len(named)
    driven = {(episode.phase, frozenset(action.kind for action in episode.actions)) for _, episode in named}
    for phase in (EpisodePhase.DRIVING, EpisodePhase.BEND):
        for at, fault in enumerate(FAULTS):
            for other in (*FAULTS[at + 1 :], *DRIVER, *BEHAVIOURS):
                assert (phase, frozenset({fault, other})) in driven


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("kind", "other", "numbers"),
    [
        ("dbw_dropout", "steering_report_frozen", {1.0, 2.0, 3.0}),
        ("override_false", "pose_lost", {1.0, 2.0, 3.0, 4.0}),
        ("gear_lever", "brain_nan", {1.0, 2.0, 3.0, 4.0}),
        ("gear_lever", "bus_silent", {1.0, 2.0, 3.0, 4.0}),
    ],
)
def test_pairs_try_every_module_and_gear(kind: str, other: str, numbers: set[float]) -> None:
    actions = [
        {one.kind: one.value for one in episode.actions} for _, episode in draw.pairs((EpisodePhase.DRIVING,), 1)
    ]
    tried = [one[kind] for one in actions if one.keys() == {kind, other}]
    assert set(tried) == numbers
    assert len(tried) == len(numbers)
    assert all(len(one) == 2 for one in actions)  # no kind with itself


@pytest.mark.parametrize(
    ("module", "after", "expected"),
    [(3.0, 1.0, True), (math.nan, 1.0, True), (2.0, 1.0, False), (1.0, 1.0, False), (3.0, 4.0, False)],
)
def test_a_frozen_report_hides_its_own_module_and_while_it_is_frozen(
    module: float, after: float, expected: bool
) -> None:
    frozen, off = Action("steering_report_frozen", 0.0, 4.0), Action("dbw_dropout", after, 2.0, module)
    episode = Episode(EpisodePhase.DRIVING, 1.0, (frozen, off))
    assert known("told_driving", episode) is expected
    assert not known("inside_lot", episode)


def test_a_search_repeats_and_turns_to_what_came_close() -> None:
    searches = Search(5), Search(5)
    for number in range(BLIND + 1):
        batches = [search.batch() for search in searches]
        assert list(map(str, batches[0])) == list(map(str, batches[1]))
        assert len(batches[0]) == BATCH
        if number == BLIND:
            near = sum("brakes_drag" in str(episode) for episode in batches[0])
            assert near > 0.2 * BATCH
            return
        close = Episode(EpisodePhase.BEND, 1.0, (Action("brakes_drag", 0.0, 3.0, 700.0),))
        for search, batch in zip(searches, batches, strict=True):
            search.learn([result_of(close, 0.1), *(result_of(episode) for episode in batch)])


def test_shrinking_drops_what_the_violation_does_not_need() -> None:
    needed = Action("brake_report_frozen", 0.0, 4.0)
    actions = (needed, Action("pose_late", 0.3, 2.0, 0.123, Shape.FLAPPING, 0.1), Action("key_go", 1.0, 1.0))
    episode = Episode(EpisodePhase.DRIVING, 3.32, actions, RoadConditions(friction=0.5), 2)

    def run_all(episodes: Sequence[Episode]) -> list[EpisodeResult]:
        def breaks(one: Episode) -> bool:
            return any(action.kind == needed.kind and action.duration >= 1.0 for action in one.actions)

        return [result_of(one, broken=["speed_limit"] * breaks(one)) for one in episodes]

    simplest = shrunk(run_all([episode])[0], "speed_limit", run_all).episode
    assert simplest == Episode(EpisodePhase.DRIVING, 3.0, (Action(needed.kind, 0.0, 1.0),))


def test_a_finding_explains_the_same_with_more_on_top(tmp_path: Path) -> None:
    findings = Findings(tmp_path)
    short = result_of(Episode(EpisodePhase.DRIVING, 3.0, (Action("pose_late", 0.0, 1.0),)), broken=["speed_limit"])
    findings.keep(HuntFinding("speed_limit", short), "")
    more = Episode(EpisodePhase.BEND, 0.0, (Action("pose_late", 0.0, 2.0), Action("brain_nan", 1.0, 1.0)))
    assert list(findings.new(result_of(more, broken=["speed_limit"]))) == []
    assert list(findings.new(result_of(more, broken=["told_driving"]))) == ["told_driving"]


def test_what_is_found_is_a_row_and_a_rig_that_loads(tmp_path: Path) -> None:
    shape = Action("brake_override", 0.5, 4.0, 0.26, Shape.FLAPPING, 0.3)
    episode = Episode(EpisodePhase.DRIVING, 3.0, (Action("brake_report_frozen", 0.0, 4.0), shape))
    data = result_of(episode, broken=["told_driving"]).to_dict() | {"onset_s": 9.0, "moved_s": 4.0}
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    file = Findings(tmp_path).keep(HuntFinding("told_driving", EpisodeResult.from_dict(data)), text)
    assert read_row(file)[0] == "told_driving"
    assert str(read_row(file)[1]) == str(episode)
    faults = faults_of(load_rig(file.with_suffix(".rig.toml"), REPOSITORY))
    assert [(one.kind, one.at, one.duration) for one in faults] == [
        ("brake_report_frozen", 5.0, 4.0),
        ("brake_override", 5.5, 4.0),
    ]
    assert faults[1].period == 0.3


def test_keys_and_brains_are_left_out_of_a_rig_and_said_so() -> None:
    episode = Episode(EpisodePhase.HELD, 0.0, (Action("key_stop", 0.0, 1.0),))
    assert faults_text(result_of(episode)) == ""


def query(folder: Path, episodes: int, *, resume: bool = False) -> HuntQuery:
    return HuntQuery(
        "simulated", "parked_car", folder, pairs=True, phases=(EpisodePhase.ARMING,), episodes=episodes, resume=resume
    )


def hunted(folder: Path, episodes: int, *, resume: bool = False) -> dict[str, EpisodeResult]:
    hunt = Hunt(query(folder, episodes, resume=resume), REPOSITORY, lambda progress: None)
    hunt.run()
    return hunt.journal.results


@pytest.mark.thorough
def test_a_hunt_that_was_cut_off_goes_on_to_the_same_end(tmp_path: Path) -> None:
    whole = hunted(tmp_path / "whole", 4)
    hunted(tmp_path / "cut", 2)
    with (tmp_path / "cut" / EPISODES).open("a", encoding="utf-8") as file:
        file.write('{"name": "half of a li')
    again = hunted(tmp_path / "cut", 4, resume=True)
    assert {name: result.to_dict() for name, result in again.items()} == {
        name: result.to_dict() for name, result in whole.items()
    }
    assert len(whole) == 4
    lines = (tmp_path / "cut" / EPISODES).read_text(encoding="utf-8").splitlines()
    assert sum(line.endswith("}") for line in lines) == 4


@pytest.mark.parametrize(
    "damage",
    [
        {"onset_s": ...},
        {"margins": ...},
        {"margins": [0.5]},
        {"failure": None},
        {"reasons": None},
        {"violations": [["speed_limit", 1.0]]},
        {"violations": [3]},
        {"episode": {}},
        {"phase": "nix"},
        {"actions": ["brake_override"]},
        {"actions": [{"kind": "nix", "after_s": 0.0, "for_s": 1.0}]},
        {"actions": [{"kind": "key_stop", "after_s": "0", "for_s": 1.0}]},
        {"road": {"slope": 1.0}},
    ],
    ids=str,
)
def test_a_damaged_episode_is_one_line_with_file_and_line(tmp_path: Path, damage: dict[str, object]) -> None:
    episode = Episode(EpisodePhase.HELD, 0.0, (Action("key_stop", 0.0, 1.0),))
    whole = {"name": "one"} | result_of(episode).to_dict()
    within = damage.keys() & whole["episode"].keys()
    changed = whole | ({"episode": whole["episode"] | damage} if within else damage)
    damaged = {key: value for key, value in changed.items() if value is not ...}
    HuntJournal(tmp_path, {"rig": "simulated"}, resume=False).close()
    before = "".join(json.dumps(line) + "\n" for line in (whole, damaged | {"name": "two"}))
    (tmp_path / EPISODES).write_text(before, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        HuntJournal(tmp_path, {"rig": "simulated"}, resume=True)
    assert str(caught.value).startswith(f"{tmp_path / EPISODES}: line 2 is no finished episode")
    assert "\n" not in str(caught.value)
    assert (tmp_path / EPISODES).read_text(encoding="utf-8") == before


def test_a_folder_of_another_hunt_is_refused(tmp_path: Path) -> None:
    HuntJournal(tmp_path / "one", {"rig": "simulated", "seed": 1}, resume=False).close()
    with pytest.raises(ConfigError, match="not empty; take it up with --resume"):
        HuntJournal(tmp_path / "one", {"seed": 1}, resume=False)
    with pytest.raises(ConfigError, match="has seed 1, not 2"):
        HuntJournal(tmp_path / "one", {"rig": "simulated", "seed": 2}, resume=True)


def test_episodes_of_other_code_are_in_no_one_hunt(tmp_path: Path) -> None:
    HuntJournal(tmp_path, {"rig": "simulated"}, resume=False).close()
    HuntJournal(tmp_path, {"rig": "simulated"}, resume=True).close()
    asked = json.loads((tmp_path / QUERY).read_text(encoding="utf-8"))
    asked["versions"]["code"] = "0" * 64
    (tmp_path / QUERY).write_text(json.dumps(asked), encoding="utf-8")
    with pytest.raises(ConfigError, match=f"mixed versions: its rows are of code {'0' * 64}, got "):
        HuntJournal(tmp_path, {"rig": "simulated"}, resume=True)
