"""The meeting with an obstacle or actor laid into a small lot: room to get to speed, room to stop; and its drive."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests import isolated
from tests.commissioning.test_align import on_the_lot
from tests.conftest import REPOSITORY
from vve_sumo.cli import dispatch
from vve_sumo.commissioning import align
from vve_sumo.commissioning.align_around import EventInLot, EventSite, write_scenario
from vve_sumo.commissioning.event_stretch import event_stretch, main_event
from vve_sumo.commissioning.lot_fits import lot_fits
from vve_sumo.drive.no_brake_preview import preview_without_braking
from vve_sumo.drive.run import resolve_by_name, run
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning

YARD = (REPOSITORY / "rigs" / "small_lot.toml").read_text(encoding="utf-8")
#: scenario and event of each variant for the small lot
VARIANTS = {
    "small_lot_parked_car": "parked_car",
    "small_lot_cut_in": "cutter",
    "small_lot_pedestrian": "pedestrian",
    "small_lot_lead_braking": "lead",
}
LEAST_SPEED = 25.0 / 3.6


def yard(folder: Path, *changes: tuple[str, str]) -> Path:
    """The small lot's rig, without the alignments that it has."""
    text = YARD[: YARD.index("[alignments.")]
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    file = folder / "yard.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_stretch_of_an_obstacle_by_hand() -> None:
    """At 11.176 m/s: 42 m at 1.5 m/s2 up and as much down, 1.5 s at speed, 5 m of gap, 3.8 m from axle to bumper."""
    resolved = resolve_by_name("parked_car", REPOSITORY)
    stretch = event_stretch(resolved, "parked_car")
    speed, bumper = 11.176, resolved.vehicle.wheelbase + resolved.vehicle.front_overhang
    brakes = 639.0 - 2.3 - 5.0 - speed**2 / 3.0
    assert stretch.meeting == pytest.approx(brakes)
    assert stretch.begin == pytest.approx(brakes - bumper - 1.5 * speed - speed**2 / 3.0)
    assert 639.0 + 2.3 <= stretch.end <= 645.0
    assert stretch.contact
    assert stretch.at_speed


def test_whoever_hides_another_is_on_the_stretch() -> None:
    resolved = resolve_by_name("occluded_pedestrian", REPOSITORY)
    stretch = event_stretch(resolved, "child")
    assert main_event(resolved) == "child"
    assert all(stretch.begin < one.at_m < stretch.end for one in resolved.scenario.obstacles)


def test_a_motion_that_counts_from_the_start_needs_the_whole_approach() -> None:
    resolved = resolve_by_name("pedestrian_400_walking_along", REPOSITORY)
    assert event_stretch(resolved, "walker").begin == 0.0


def aligned(scenario: str, event: str, rig: Path, speed: float) -> tuple[EventSite, EventInLot]:
    site = EventSite(scenario, str(rig), REPOSITORY)
    found = site.tried(event, speed)
    assert found is not None
    return site, found


def in_the_yard(found: EventInLot, rig: Path) -> None:
    """By other means: the axle's way, and straight on for as long as the watchdog's 2.5 m/s2 takes, is in the lot."""
    loaded, path = rigs.load(rig), found.site.resolved.path
    alignment = found.result.alignment
    turn, shift = complex(math.cos(alignment.rotation), math.sin(alignment.rotation)), complex(alignment.x, alignment.y)
    points = [complex(*path.at(s)[:2]) for s in np.linspace(0.0, path.length, 80)]
    last, ahead = path.at(path.length), path.at(path.length).heading
    stop = found.speed * 0.4 + found.speed**2 / (2.0 * 2.5) + 3.8
    points.append(complex(last.x + stop * math.cos(ahead), last.y + stop * math.sin(ahead)))
    back = [(place - shift) / turn for place in points]
    origin = loaded.lot.outline[0]
    corners = [on_the_lot(*corner, origin) for corner in loaded.lot.outline]
    lot = shapely.Polygon([(p.real, p.imag) for p in corners]).buffer(-loaded.lot.margin_m - 0.9)
    assert lot.contains(shapely.LineString([(p.real, p.imag) for p in back]))


def drive(scenario: Path, rig: Path, folder: Path) -> dict:
    """Drive in lockstep with the rig's car."""
    resolved = resolve_by_name(str(scenario), REPOSITORY, rig=str(rig))
    return run(resolved, folder, REPOSITORY).summary


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("scenario", VARIANTS)
def test_a_variant_is_laid_into_the_small_lot_and_driven(scenario: str, tmp_path: Path) -> None:
    event, rig = VARIANTS[scenario], yard(tmp_path)
    own = resolve_by_name(scenario, REPOSITORY)
    speed = own.scenario.ego.speed_mps
    assert speed >= LEAST_SPEED
    assert main_event(own) == event
    site, found = aligned(scenario, event, rig, speed)
    in_the_yard(found, rig)
    written = tmp_path / "mine.toml"
    write_scenario(found, site.resolved, written)
    align.store(found.site, found.result, align.datetime.date(2026, 5, 1), "mine")
    chosen = meaning.with_alignment_for(rigs.load(rig), "mine")
    mine = resolve_by_name(str(written), REPOSITORY)
    kept = meaning.alignment_of(chosen, "linden")
    assert meaning.geofence_of(chosen, kept).along(mine.path, speed, mine.corridor) is None
    assert chosen.car_start.latitude_deg == pytest.approx(mine.scenario.ego.lot.latitude_deg)
    # Met at the same place of the street as in the whole scenario.
    whole, part = preview_without_braking(own).contact, preview_without_braking(mine).contact
    assert whole.id == part.id == event
    assert math.dist((whole.ego.x, whole.ego.y), (part.ego.x, part.ego.y)) < 1.0
    summary = isolated.isolated(drive, written, rig, tmp_path / "record")
    assert summary["passed"], summary
    assert not summary["collision"]
    assert summary["max_speed_mps"] == pytest.approx(speed, abs=0.5)


@pytest.mark.parametrize("scenario", VARIANTS)
def test_the_shipped_alignments_keep_the_whole_path_in_the_lot(scenario: str) -> None:
    rig = meaning.with_alignment_for(rigs.load(REPOSITORY / "rigs" / "small_lot.toml"), scenario)
    resolved = resolve_by_name(scenario, REPOSITORY)
    alignment = meaning.alignment_of(rig, "linden")
    geofence = meaning.geofence_of(rig, Alignment())
    assert geofence.aligned(alignment).along(resolved.path, resolved.scenario.ego.speed_mps) is None
    begin, start = resolved.path.at(0.0), rig.car_start
    x, y = meaning.frame_of(rig).to_map(math.radians(start.latitude_deg), math.radians(start.longitude_deg))
    there = alignment.inverse().apply(align.pose_at_rest(begin.x, begin.y, begin.heading))
    assert (x, y) == pytest.approx((there.x, there.y), abs=1e-3)


@pytest.mark.thorough
def test_the_fastest_that_fits_does_and_faster_does_not(tmp_path: Path) -> None:
    site = EventSite("small_lot_parked_car", str(yard(tmp_path, ("-83.0168409", "-83.0176000"))), REPOSITORY)
    said: list[str] = []
    fastest = site.fastest("parked_car", 9.0, said.append)
    assert fastest is not None
    assert 5.0 < fastest.speed < 9.0
    assert site.tried("parked_car", fastest.speed + 0.3) is None
    assert said[0] == "searching at 9.00 m/s"


@pytest.mark.thorough
def test_the_command_writes_scenario_path_and_alignment(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    rig = yard(tmp_path, ("speed_mps = 10.0", "speed_mps = 7.5"))
    around = ["align", "small_lot_parked_car", "--rig", str(rig), "--around", "parked_car"]
    assert dispatch.main([*around, "--speed", "27 km/h", "--write-scenario", "mine.toml", "--write"]) == 0
    said = capsys.readouterr().out
    assert "fastest that fits: 7.50 m/s (27.0 km/h)" in said
    assert "stored in" in said
    assert tomllib.loads((tmp_path / "mine.toml").read_text())["ego"]["speed_mps"] == pytest.approx(7.5)
    assert "cut by vve-sumo align --around" in (tmp_path / "mine.csv").read_text()
    assert set(rigs.load(rig).alignments) == {"mine"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--around", "parked_kar"], "no obstacle and no actor 'parked_kar', did you mean 'parked_car'"),
        (["--around", "parked_car", "--write"], "expected --write-scenario"),
        (["--around", "parked_car", "--write-shortened-path", "a.csv"], "expected --fit"),
        (["--around", "parked_car", "--speed", "40 m/s"], "more than limits.speed_mps"),
        (["--fit", "--write-scenario", "a.toml"], "expected --around"),
    ],
)
def test_what_is_no_event_is_refused(options: list[str], words: str, tmp_path: Path, capsys) -> None:
    rig = yard(tmp_path)
    before = rig.read_text(encoding="utf-8")
    assert dispatch.main(["align", "small_lot_parked_car", "--rig", str(rig), *options]) == 2
    assert words in capsys.readouterr().err
    assert rig.read_text(encoding="utf-8") == before


def test_a_shipped_rig_stays_and_no_scenario_is_written(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    options = ["--around", "parked_car", "--write-scenario", "mine.toml", "--write"]
    assert dispatch.main(["align", "small_lot_parked_car", "--rig", "small_lot", *options]) == 2
    assert "ships with the package" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_car_that_is_never_caught_up_is_no_meeting(tmp_path: Path) -> None:
    """At 5 m/s nobody comes up to who cuts in at 5.1 m/s."""
    text = (REPOSITORY / "scenarios" / "small_lot_cut_in.toml").read_text(encoding="utf-8")
    file = tmp_path / "slow.toml"
    file.write_text(text.replace("min = 6.0", "min = 3.0"), encoding="utf-8")
    site = EventSite(str(file), str(yard(tmp_path)), REPOSITORY)
    assert "never touches it" in site.obstacle_to("cutter", 5.0)
    assert site.obstacle_to("cutter", 8.333) == ""
    assert site.steps(8.333) == pytest.approx([8.333, 7.333, 6.333, 5.333, 4.333, 3.333, 3.0])
    lot, never = site.why_none("cutter", 8.333).split("; ")
    assert lot == "at 8.33 m/s: no place was found in the lot"
    assert never.startswith("at 7.33 to 3.00 m/s: an ego that keeps that speed never touches it, ")


def test_a_scenario_is_not_written_over_another(tmp_path: Path) -> None:
    site, found = aligned("small_lot_parked_car", "parked_car", yard(tmp_path), 7.0)
    for name in ("no.csv", "no/where.toml", "a b.toml"):
        with pytest.raises(ConfigError, match="--write-scenario"):
            write_scenario(found, site.resolved, tmp_path / name)
    assert [one.name for one in tmp_path.iterdir()] == ["yard.toml"]


def test_another_speed_goes_to_whoever_the_scenario_says() -> None:
    lead = resolve_by_name("small_lot_lead_braking", REPOSITORY, speed=7.0).scenario
    assert (lead.ego.speed_mps, lead.actors[0].speed_mps) == (7.0, 7.0)
    with pytest.raises(ConfigError, match="declares max 9"):
        resolve_by_name("small_lot_lead_braking", REPOSITORY, speed=20.0)


@pytest.mark.thorough
def test_the_list_says_what_fits(tmp_path: Path) -> None:
    rows = list(lot_fits(str(yard(tmp_path)), REPOSITORY, ["small_lot_cut_in", "leap_loop", "calibration"]))
    fits, loop, empty = rows
    assert (fits.event, fits.why_not) == ("cutter", "")
    assert fits.speed_mps == pytest.approx(8.333)
    assert fits.end_m - fits.begin_m == pytest.approx(82.5, abs=1.0)
    assert fits.clearance_m > 5.0
    assert loop.speed_mps is None
    assert empty.why_not == "no obstacle and no actor is met"
    assert json.dumps([one.to_dict() for one in rows])
    assert all(len(one.cells()) == 7 for one in rows)


@pytest.mark.thorough
def test_the_list_says_the_scenarios_own_speed_and_who_is_left_out(tmp_path: Path) -> None:
    """A rig that allows 7 m/s, and a second parked car beside the road, 439 m before the one that is met."""
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    file = tmp_path / "two.toml"
    file.write_text(text + '\n[[obstacles]]\nid = "far_car"\nat_m = 200.0\noffset_m = 6.0\n', encoding="utf-8")
    (one,) = lot_fits(str(yard(tmp_path, ("speed_mps = 10.0", "speed_mps = 7.0"))), REPOSITORY, [str(file)])
    assert (one.event, one.why_not) == ("parked_car", "")
    assert (one.own_speed_mps, one.speed_mps) == (11.176, 7.0)
    assert one.left_out == ("far_car, at 200 m of the path",)


def test_a_rig_that_is_missing_is_refused_at_once() -> None:
    with pytest.raises(ConfigError, match="no rig named 'nowhere'"):
        next(lot_fits("nowhere", REPOSITORY))
