"""Drives of several egos: each a record of its own, each a body to the others, whatever their order in the file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.complaints import message
from tests.drive.street import REPOSITORY, altered, drive_once, recorded
from tests.isolated import isolated
from vve_sumo.analysis.load import load
from vve_sumo.analysis.run import Run
from vve_sumo.drive.replay import read_car_frames, read_pipeline_inputs, recorded_scenario, replay
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.drive.verify import alterations
from vve_sumo.record.layout import ego_folder, further_egos

SPEED = 8.0
#: rear axles at the start, s on the path [m]
PLACES = {"ego": 100.0, "near": 70.0, "last": 45.0}
#: on another street, out of everybody's reach
AWAY = {"id": "away", "path": "linden_loop", "initial_s_m": 400.0, "radar": {"ideal": True}}


def started(name: str) -> dict[str, Any]:
    return {"id": name, "initial_s_m": PLACES[name]}


def changes(*egos: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {
        "road.demand": [],
        "obstacles": [],
        "criteria": {},
        "duration_s": 3.0,
        "ego.speed_mps": SPEED,
        "ego.initial_speed_mps": SPEED,
        "ego.initial_s_m": PLACES["ego"],
        "egos": list(egos),
        **more,
    }


@pytest.fixture(scope="module")
def string(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of three egos behind each other."""
    return recorded(tmp_path_factory, changes(started("near"), started("last")), tmp_path_factory.mktemp("egos") / "r")


def drive_hashes(changes: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the hashes of every part of every ego's record; called through `isolated`."""
    from vve_sumo.drive import run as drives

    done = drives.run(altered(changes), Path("never"), REPOSITORY, keep_record=False)
    both = {"ego": done} | done.others
    return {ego: one.summary["record_parts_sha256"] for ego, one in both.items()}


def test_every_ego_has_a_whole_record(string: Path) -> None:
    assert further_egos(string) == ("last", "near")
    runs = load(string).egos
    assert list(runs) == ["ego", "last", "near"]
    for ego, run in runs.items():
        assert isinstance(run, Run)
        assert run.ego == ego
        assert run.arrow("ticks").num_rows == 150
        assert alterations(run.folder) == []
        assert run.summary is not None
        assert run.summary["passed"] is True
    assert set(load(string).summary["egos"]) == {"last", "near"}
    assert "no ego 'nobody', expected 'ego' or 'last' or 'near'" in message(lambda: ego_folder(string, "nobody"))


def test_each_sees_the_others_where_they_are(string: Path) -> None:
    """The bodies in an ego's table of actors are the other cars, by the truth of the others' own tables."""
    runs = load(string).egos
    for run in runs.values():
        actors = run.actors
        assert set(actors["actor"]) == set(runs) - {run.ego}
        for name, other in runs.items():
            if name == run.ego:
                continue
            seen, true = actors[actors["actor"] == name], other.ticks
            rows = np.searchsorted(true["tick"], seen["tick"])
            ahead = other.vehicle.rear_axle_to_bumper - 0.5 * other.vehicle.length
            heading = true["true_heading_rad"].to_numpy()
            x = true["true_x_m"].to_numpy() + ahead * np.cos(heading)
            y = true["true_y_m"].to_numpy() + ahead * np.sin(heading)
            whole = rows < len(true)  # the last snapshot is that of a tick that was not driven
            rows, seen = rows[whole], seen[whole]
            assert len(seen) >= 149
            # SUMO has them where their receivers say that they are: RTK-GNSS knows it to centimetres.
            assert np.hypot(seen["x_m"] - x[rows], seen["y_m"] - y[rows]).max() < 0.1
            assert np.abs(seen["speed_mps"] - true["true_speed_mps"].to_numpy()[rows]).max() < 0.3


def test_gaps_count_the_other_egos(string: Path) -> None:
    runs = load(string).egos
    for ego, ahead in (("near", "ego"), ("last", "near")):
        run = runs[ego]
        lead = run.lead
        assert set(lead.actor[1:]) == {ahead}
        gap = PLACES[ahead] - PLACES[ego] - run.vehicle.length
        assert lead.gap[1] == pytest.approx(gap, abs=0.5)  # a rolling start is true to some decimetres
        assert run.summary is not None
        assert run.summary["min_gap_m"] == pytest.approx(np.nanmin(lead.gap), abs=1e-9)
    assert set(runs["ego"].lead.actor) == {""}


def test_radars_see_the_other_egos(string: Path) -> None:
    for ego, ahead in (("near", "ego"), ("last", "near")):
        assert ahead in set(load(string).egos[ego].detections["actor"])


@pytest.mark.parametrize("ego", ["ego", "near"])
def test_each_record_replays_bit_for_bit(string: Path, ego: str) -> None:
    folder = ego_folder(string, ego)
    resolved = recorded_scenario(folder, REPOSITORY)
    assert resolved.ego_id == ego
    frames = read_car_frames(folder, DEFAULT_EPOCH)
    assert replay(resolved, read_pipeline_inputs(folder), frames, REPOSITORY) is None


def test_neither_the_order_in_the_file_nor_another_run_changes_a_byte(string: Path) -> None:
    again = isolated(drive_hashes, changes(started("last"), started("near")))
    for ego, run in load(string).egos.items():
        assert run.summary is not None
        assert again[ego] == run.summary["record_parts_sha256"]


@pytest.mark.thorough
def test_an_ego_out_of_reach_changes_nothing_of_another() -> None:
    """Random numbers, fixes, frames and actors are those of the car alone."""
    both, alone = isolated(drive_hashes, changes(AWAY)), isolated(drive_hashes, changes())
    assert both["ego"] | alone["ego"] == both["ego"] | {"scenario.json": alone["ego"]["scenario.json"]}
    assert both["away"]["pose.bin"] != both["ego"]["pose.bin"]


@pytest.mark.thorough
def test_a_contact_of_egos_is_one_of_both(tmp_path: Path) -> None:
    """One who looks at nothing drives into one who creeps: both touched somebody, and the drive fails for both."""
    blind = {"emergency": False, "comfort": False}
    rams = {"id": "rams", "initial_s_m": 80.0, "controller": {"name": "follow_and_stop", "tuning": blind}}
    slow = {"ego.speed_mps": 1.5, "ego.initial_speed_mps": 1.5}
    drive = changes(rams | {"speed_mps": 9.0, "initial_speed_mps": 9.0}, duration_s=20.0) | slow
    summary = isolated(drive_once, drive, str(tmp_path / "r"))
    assert summary["outcome"] == "contact"
    assert summary["egos"]["rams"]["outcome"] == "contact"
    assert summary["passed"] is False
    runs = load(tmp_path / "r").egos
    assert {ego: set(filter(None, run.ticks["contacts"])) for ego, run in runs.items()} == {
        "ego": {"rams"}, "rams": {"ego"}
    }  # fmt: skip
    assert runs["rams"].summary is not None
    assert runs["rams"].summary["impact_speed_mps"] > 5.0
    assert any(line.startswith("ego rams: collision is True") for line in summary["failed"])
    assert [alterations(run.folder) for run in runs.values()] == [[], []]


@pytest.mark.thorough
def test_one_who_has_come_to_an_end_stays_on_the_road_and_its_record_ends(tmp_path: Path) -> None:
    """The drive of the first is over after some metres; the other drives on behind it and is the one that times out."""
    drive = changes(started("near"), end_trigger={"ego_at_m": PLACES["ego"] + 8.0})
    drive["egos"][0]["end_trigger"] = {}
    summary = isolated(drive_once, drive, str(tmp_path / "r"))
    assert (summary["outcome"], summary["egos"]["near"]["outcome"]) == ("completed", "timeout")
    runs = load(tmp_path / "r").egos
    bumper = runs["ego"].vehicle.rear_axle_to_bumper
    expected = (8.0 - bumper) / SPEED
    assert runs["ego"].time[-1] == pytest.approx(expected, abs=0.1)
    assert runs["near"].time[-1] == pytest.approx(3.0 - 0.02)
    seen = runs["near"].actors
    still = seen[(seen["actor"] == "ego") & (seen["tick"] == 149)]
    begun = seen[(seen["actor"] == "ego") & (seen["tick"] == 20)]
    gone = math.hypot(*(float(still[axis].iloc[0] - begun[axis].iloc[0]) for axis in ("x_m", "y_m")))
    assert gone == pytest.approx(SPEED * 129 * 0.02, rel=0.05)
    assert [alterations(run.folder) for run in runs.values()] == [[], []]


@pytest.mark.parametrize(
    ("egos", "words"),
    [
        ([{"id": "same"}], ["egos.same", "starts where ego does"]),
        ([{"id": "a", "initial_s_m": 50.0}, {"id": "b", "initial_s_m": 52.0}], ["egos.b", "starts where a does"]),
        ([{"id": "a", "path": "nowhere"}], ["egos.a.path", "nowhere"]),
        ([{"id": "a", "vehicle": "cart", "initial_s_m": 50.0}], ["egos.a.vehicle", "cart"]),
    ],
)
def test_egos_that_cannot_be_are_refused(egos: list[dict[str, Any]], words: list[str]) -> None:
    said = message(lambda: altered(changes(*egos)))
    assert "\n" not in said
    for word in words:
        assert word in said


def test_a_rolling_start_that_cannot_be_names_the_ego() -> None:
    from vve_sumo.drive.rolling_start import RollingStart

    resolved = altered(changes({"id": "a", "initial_s_m": 1e5}))
    assert "egos.a.initial_s_m: 100000 lies beyond" in message(lambda: RollingStart.of(resolved.others[0]))


#: what only the rig of [ego] may have, as a rig states it
ALONE = {
    "outputs": '[[outputs]]\nkind = "ncom"\nudp = "127.0.0.1:5001"',
    "people": '[[people]]\nid = "anna"\nsource = "simulated"\nleast_distance_m = 50.0\n'
    "latitude_deg = 40.01\nlongitude_deg = -83.018\nheading_deg = 90.0",
    "v2x": '[v2x]\nlisten = "127.0.0.1:4716"',
}


@pytest.mark.thorough
def test_playbacks_and_wrong_rigs_of_live_drives_are_refused_in_one_line(tmp_path: Path) -> None:
    from vve_sumo.drive.run import run
    from vve_sumo.live import session

    def planned(egos: str, further: dict[str, str]) -> str:
        (tmp_path / "two.toml").write_text(f"{text}\n[[egos]]\n{egos}\n", encoding="utf-8")
        file, asked = str(tmp_path / "two.toml"), {"out": tmp_path / "live", "seed": None, "controller": None}
        return message(
            lambda: session.plan(file, "simulated", REPOSITORY, shadow=False, further=further, **asked)  # type: ignore[arg-type]
        )

    resolved = altered({"road.demand": [], "egos": [{"id": "away", "path": "linden_loop"}]})
    said = message(lambda: run(resolved, tmp_path / "r", REPOSITORY, pose=tmp_path / "p.csv"))
    assert "egos: a recorded drive has the poses of one car; take [[egos]] out" in said
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    away, external = 'id = "away"\npath = "linden_loop"', str(REPOSITORY / "rigs" / "foreign.toml")
    second = (REPOSITORY / "rigs" / "simulated_second.toml").read_text(encoding="utf-8")
    for key, stated in ALONE.items():
        (tmp_path / f"{key}.toml").write_text(f"{second}\n{stated}\n", encoding="utf-8")
    for egos, further, why in (
        (away, {"third": "simulated"}, "--rig third=…: expected the id of one of the scenario's [[egos]]"),
        (away, {"away": "simulated"}, "simulated.toml is given for 2 cars; expected a rig of its own for each"),
        (away, {"away": external}, "foreign.toml: brain.kind: only the rig of [ego] may have it"),
        *(
            (away, {"away": str(tmp_path / f"{key}.toml")}, f"{key}.toml: {key}: only the rig of [ego] may have it")
            for key in ALONE
        ),
        (f"{away}\ninitial_speed_mps = 5.0", {}, "egos.away.initial_speed_mps: a drive with a rig starts from rest"),
    ):
        said = planned(egos, further)
        assert why in said
        assert "\n" not in said
    assert not (tmp_path / "live").exists()
