"""A steering margin is spoken of only where the controller steers by the law that the gain design knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.drive.street import REPOSITORY, altered
from vve_sumo.drive.steering_margins import margins_at_speed, steering_margins
from vve_sumo.errors import ConfigError

LONGITUDINAL = """
from vve_sumo.values import ControlCommand

class Brakes:
    def step(self, observation):
        return ControlCommand(0.0, -1.0)

def make(vehicle, tuning):
    return Brakes()
"""
DECLARES = """
from types import SimpleNamespace

class Declares:
    preview_tuning = SimpleNamespace({0})

    def step(self, observation):
        raise NotImplementedError

def make(vehicle, tuning):
    return Declares()
"""


def controlled(name: str, **tuning: Any) -> Any:
    return altered({"controller": {"name": name, "tuning": tuning}})


@pytest.mark.parametrize("name", ["follow_and_stop", "brake_at", "calibration_run"])
def test_the_shipped_ones_steer_by_the_preview_law(name: str) -> None:
    assert steering_margins(controlled(name), REPOSITORY).delay == pytest.approx(0.381, abs=0.001)


def test_a_longer_look_ahead_is_the_one_that_is_judged() -> None:
    usual, longer = controlled("follow_and_stop"), controlled("follow_and_stop", look_ahead_time_s=1.2)
    assert margins_at_speed(longer, REPOSITORY).delay > 1.2 * margins_at_speed(usual, REPOSITORY).delay


@pytest.mark.parametrize("law", ["stanley", "lqr", "pure_pursuit"])
def test_of_another_law_nothing_is_known(law: str) -> None:
    for margins in (steering_margins, margins_at_speed):
        with pytest.raises(ConfigError, match=f"with the steering law '{law}': nothing is known"):
            margins(controlled("follow_and_stop", steering=law), REPOSITORY)


def test_of_a_controller_that_does_not_steer_nothing_is_known(tmp_path: Path) -> None:
    (tmp_path / "brakes.py").write_text(LONGITUDINAL, encoding="utf-8")
    with pytest.raises(ConfigError, match="nothing is known of the margin of its steering"):
        steering_margins(controlled(f"{tmp_path}/brakes.py:make"), REPOSITORY)


def test_one_of_your_own_may_declare_the_law_and_then_its_tuning_counts(tmp_path: Path) -> None:
    for file, said in (("usual", "0.8"), ("longer", "1.2")):
        text = DECLARES.format(f"look_ahead_time={said}, look_ahead_least=4.0, derivative_time=0.2")
        (tmp_path / f"{file}.py").write_text(text, encoding="utf-8")
    mine = margins_at_speed(controlled(f"{tmp_path}/longer.py:make"), REPOSITORY).delay
    assert mine == margins_at_speed(controlled("follow_and_stop", look_ahead_time_s=1.2), REPOSITORY).delay
    usual = margins_at_speed(controlled(f"{tmp_path}/usual.py:make"), REPOSITORY).delay
    assert usual == margins_at_speed(controlled("brake_at"), REPOSITORY).delay
    (tmp_path / "wrong.py").write_text(DECLARES.format("look_ahead_time='far'"), encoding="utf-8")
    with pytest.raises(ConfigError, match="preview_tuning: expected a PreviewTuning or a GainSchedule"):
        margins_at_speed(controlled(f"{tmp_path}/wrong.py:make"), REPOSITORY)
