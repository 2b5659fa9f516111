"""What an ego that never brakes would meet, against closed forms and brute force; the picture that shows it."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated

SPEED = 11.176
TICK = 0.02
#: from the rear axle to the front bumper, and a parked car's length [m]
BUMPER, PARKED = 3.84, 4.6


def _foreseen(name: str, changes: dict[str, Any]) -> Any:
    from vve_sumo.drive.no_brake_preview import preview_without_braking
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse
    from vve_sumo.scenario.overrides import apply_overrides

    file = REPOSITORY / "scenarios" / f"{name}.toml"
    table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), changes)
    return preview_without_braking(resolve_scenario(name, parse(table, file), file, REPOSITORY))


@pytest.mark.parametrize(("gap", "deceleration"), [(22.0, 4.0), (10.0, 2.0), (15.0, 8.0)])
def test_a_braking_lead_is_met_when_the_closed_form_says(gap: float, deceleration: float) -> None:
    changes = {"actors.lead.ahead_m": gap, "actors.lead.events.0.acceleration_mps2": deceleration}
    seen = isolated(_foreseen, "lead_braking", changes)
    (_enters, brakes) = seen.events
    # The lead loses v t - a (t - T/2)^2 / 2 - a T^2 / 24 until it stands, all its way v^2 / 2a + v T / 2 - a T^2 / 24
    # afterwards; T is the time in which its deceleration builds up.
    build_up = 0.5

    def lost(time: float) -> float:
        if time < build_up:
            return deceleration * time**3 / (6.0 * build_up)
        stands = SPEED / deceleration + build_up / 2.0
        until = min(time, stands)
        return deceleration * ((until - build_up / 2.0) ** 2 / 2.0 + build_up**2 / 24.0) + SPEED * (time - until)

    times = np.arange(0.0, 12.0, 0.001)
    contact = float(times[np.argmax([lost(float(time)) >= gap for time in times])])
    assert seen.contact.id == "lead"
    assert seen.contact.time - brakes.time == pytest.approx(contact, abs=2.0 * TICK)


def test_a_rolling_start_begins_at_its_place_with_its_speed() -> None:
    """A parked car 79 m ahead, on a straight street, at a constant speed."""
    seen = isolated(_foreseen, "parked_car", {"ego.initial_s_m": 560.0, "ego.initial_speed_mps": SPEED})
    parked = seen.samples[0]
    assert (parked.time, parked.speed) == (0.0, SPEED)
    assert parked.s == pytest.approx(560.0 + BUMPER, abs=0.02)
    assert seen.contact.id == "parked_car"
    assert seen.contact.time == pytest.approx((639.0 - PARKED / 2.0 - 560.0 - BUMPER) / SPEED, abs=2.0 * TICK)


@pytest.mark.parametrize(("arrival", "walking", "met"), [(3.6, 1.389, True), (5.5, 1.389, False), (3.6, 0.8, False)])
def test_a_pedestrian_is_met_where_the_strip_and_the_time_agree(arrival: float, walking: float, met: bool) -> None:
    """At the ego's arrival the pedestrian is at -5 m + walking * time; half widths: car 0.93 m, pedestrian 0.3 m."""
    parameters = {"arrival": arrival, "walking_speed": walking, "end_trigger.ego_at_m": 155.0}
    seen = isolated(_foreseen, "pedestrian_750_crossing", parameters)
    begins, ends = (walking * time - 5.0 for time in (arrival - 0.4, arrival + (4.9 + 0.3) / SPEED))
    assert (begins <= 0.93 + 0.3 and ends >= -0.93 - 0.3) == met
    assert (seen.contact is not None) == met
    (sets_out,) = seen.events
    assert sets_out.s == pytest.approx(145.0 - arrival * SPEED, abs=SPEED * TICK)


def test_the_ego_slows_down_for_bends_and_for_nobody() -> None:
    seen = isolated(_foreseen, "rush_hour", {})
    fastest = max(moment.speed for moment in seen.samples)
    assert fastest == pytest.approx(SPEED)
    assert seen.contact is None
    speeds = np.array([moment.speed for moment in seen.samples])
    ways = np.array([moment.s for moment in seen.samples])
    # 2 m/s2 on the tightest curve of 9.2 m.
    assert speeds[(ways > 150.0) & (ways < 180.0)].min() == pytest.approx(math.sqrt(2.0 * 9.2), rel=0.05)


def _drawn(name: str, file: str) -> None:
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.plotting.scenario import draw

    draw(resolve_by_name(name, REPOSITORY), Path(file))


@pytest.mark.thorough
def test_the_picture_shows_ego_actor_obstacle_and_contact(tmp_path: Path) -> None:
    import matplotlib.image as image

    from vve_sumo.plotting.page import ACTOR, ALARM, EGO, OBSTACLE

    file = tmp_path / "cut_out.png"
    isolated(_drawn, "cut_out", str(file))
    assert file.stat().st_size < 60_000
    pixels = image.imread(file)[..., :3]
    assert pixels.shape[:2] == (960, 1560)
    street = pixels[125:490, 30:1530]
    for colour in (EGO, ACTOR, OBSTACLE, ALARM):
        wanted = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)]) / 255.0
        assert (np.abs(street - wanted).max(axis=-1) < 0.04).sum() > 100, colour
