"""Alignments by the scenario's name: each drive has its own, and one about another place is refused."""

from __future__ import annotations

import datetime
import tomllib
from pathlib import Path

import pytest

from tests.live.command_line import own_rig
from vve_sumo.errors import ConfigError
from vve_sumo.rig import edit
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning

ORIGIN = [40.004325, -83.024514]  #: first corner of the simulated rig's lot
TURNED = {
    "kind": "stored",
    "network": "linden",
    "date": datetime.date(2026, 5, 1),
    "origin": ORIGIN,
    "rotation_deg": 12.0,
    "x_m": 5.0,
    "y_m": -7.0,
    "residual_m": 0.0,
}
STANDS = [40.0045, -83.0160, 92.5]


def put(rig: Path, name: str, **changes) -> None:
    values = {(f"alignments.{name}", key): value for key, value in (TURNED | changes).items()}
    edit.put(rig, values, emptied=(f"alignments.{name}",))


def test_each_scenario_has_its_own_and_others_have_the_rigs(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    before = rig.read_text(encoding="utf-8")
    put(rig, "east")
    put(rig, "west-2", rotation_deg=100.0, start=STANDS)
    assert rig.read_text(encoding="utf-8").startswith(before.rstrip()), "comments and all else stay"
    loaded = rigs.load(rig)
    assert meaning.alignment_of(meaning.with_alignment_for(loaded, "parked_car"), "linden") is None
    east = meaning.with_alignment_for(loaded, "east")
    assert meaning.alignment_of(east, "linden").x == 5.0
    assert east.car_start == loaded.car_start
    west = meaning.with_alignment_for(loaded, "west-2")
    assert meaning.alignment_of(west, "linden").rotation == pytest.approx(1.7453, abs=1e-4)
    assert [west.car_start.latitude_deg, west.car_start.longitude_deg, west.car_start.heading_deg] == STANDS
    assert west.car_start.steering_wheel_bias_deg == 2.0
    with pytest.raises(ConfigError, match="made for 'linden'"):
        meaning.alignment_of(east, "campus")
    # Stored anew, it keeps nothing of the one before.
    put(rig, "west-2")
    assert "start" not in tomllib.loads(rig.read_text(encoding="utf-8"))["alignments"]["west-2"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"origin": [40.0044, -83.0240]}, r"alignments\.mine\.origin: expected \[40\.004325, -83\.024514\]"),
        ({"start": [40.0400, -83.0160, 0.0]}, r"alignments\.mine\.start: car_start: the car does not stand inside"),
        ({"start": [40.0045, -83.0160, 400.0]}, "start"),
        ({"kind": "nowhere"}, "kind"),
    ],
)
def test_what_is_none_is_refused_and_not_written(changes: dict, words: str, tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    before = rig.read_text(encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        put(rig, "mine", **changes)
    assert rig.read_text(encoding="utf-8") == before


def test_a_day_to_come_is_refused(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    put(rig, "mine", date=datetime.date(2999, 1, 1))
    with pytest.raises(ConfigError, match=r"alignments\.mine\.date"):
        rigs.load(rig)


def test_a_record_of_a_drive_holds_the_one_that_was_driven(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    put(rig, "east", start=STANDS)
    put(rig, "west")
    chosen = meaning.with_alignment_for(rigs.load(rig), "east")
    again = rigs.parse_json(chosen.model_dump(mode="json", exclude_unset=True), rig)
    assert again.alignments == {}
    assert meaning.alignment_of(again, "linden") == meaning.alignment_of(chosen, "linden")
    assert meaning.frame_of(again).projection == meaning.frame_of(rigs.load(rig)).projection
