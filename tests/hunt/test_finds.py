"""A gateway from which one of its guards is taken away breaks an invariant, and the hunt's judges say which."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.hunt.course import course
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.hunt.episode import Action, Episode, EpisodePhase
from vve_sumo.hunt.judging import Tolerances
from vve_sumo.hunt.runner import run_alone
from vve_sumo.vehicle.limits import Limiter
from vve_sumo.vehicle.reports import CarReports
from vve_sumo.vehicle.response import ResponseMonitor

_MADE = Pipeline.__init__


def without_speed_margin(self: Pipeline, **arguments: Any) -> None:
    _MADE(self, **arguments | {"speed_margin": math.inf})


def broken(*actions: Action, phase: EpisodePhase = EpisodePhase.DRIVING) -> tuple[str, ...]:
    return run_alone(course(), Episode(phase, 1.0, actions), Tolerances()).broken


def test_a_foot_that_only_the_motion_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    actions = Action("brake_report_frozen", 0.0, 14.0), Action("brake_override", 0.5, 4.0, 0.30)
    assert broken(*actions) == ()
    # Neither a frozen report nor a slowing car means anything.
    monkeypatch.setattr(ResponseMonitor, "step", lambda self, *arguments, **named: [])
    assert "foot_closes_throttle" in broken(*actions)


@pytest.mark.thorough
def test_a_brain_that_asks_for_ever_more(monkeypatch: pytest.MonkeyPatch) -> None:
    action = Action("brain_full_throttle", 0.0, 12.0)
    assert broken(action) == ()
    monkeypatch.setattr(Limiter, "within_speed", lambda self, acceleration, speed: acceleration)
    monkeypatch.setattr(Limiter, "too_fast", lambda self, speed: False)
    # The drive's own guard of the desired speed goes too.
    monkeypatch.setattr(Pipeline, "__init__", without_speed_margin)
    assert "speed_limit" in broken(action)


def test_a_gentle_foot(monkeypatch: pytest.MonkeyPatch) -> None:
    action = Action("driver_touch", 0.0, 8.0, 0.215)
    assert broken(action) == ()
    monkeypatch.setattr(CarReports, "driver", lambda self: [])
    monkeypatch.setattr(ResponseMonitor, "step", lambda self, *arguments, **named: [])
    assert "foot_closes_throttle" in broken(action)


def test_an_override_that_nobody_made(monkeypatch: pytest.MonkeyPatch) -> None:
    action = Action("override_false", 0.0, 0.06, 2.0)
    assert broken(action) == ()
    monkeypatch.setattr(CarReports, "confirmed", lambda self, override: True)
    assert "told_control" in broken(action)
