"""Computes how much latency a scenario's steering bears: the gain design's margins, which cover the preview law only.

The design is a file among the controllers, found by the workspace. It imports python-control, which takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

from vve_sumo import workspace
from vve_sumo.controller import module, sources
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError


@dataclass(frozen=True, slots=True)
class SteeringMargins:
    """The margins of a steering loop, one row per speed."""

    design: Any  #: the module `design` of the controllers
    rows: Sequence[Any]  #: of the design, each with its `delay_margin` [s] and the rest

    @property
    def table(self) -> str:
        """The rows as a text table."""
        return str(self.design.table(self.rows))

    @property
    def delay(self) -> float:
        """Dead time that the loop bears at every speed [s]: the smallest delay margin."""
        return float(min(row.delay_margin for row in self.rows))

    def check(self, latency: float) -> None:
        """Raise ConfigError, naming the worst speed, where `latency` [s] makes the loop unstable."""
        self.design.check(self.rows, latency)


def steering_margins(resolved: ResolvedScenario, working: FilePath) -> SteeringMargins:
    """Return the margins of a scenario's preview steering over the design's speed range.

    Raises ConfigError for tuning that the controller refuses, and for another steering law.
    """
    resolved.controller(working)
    return _margins(resolved, working)


def margins_at_speed(resolved: ResolvedScenario, working: FilePath) -> SteeringMargins:
    """Return the margins at the scenario's own speed.

    Raises ConfigError also where the scenario's controller does not steer by the preview law.
    """
    name = resolved.scenario.controller.name
    resolved.controller(working)
    if "preview" not in sources(name, workspace.controller_folders(working)):
        raise ConfigError(f"the design knows the preview steering, which {name} does not use")
    return _margins(resolved, working, [resolved.scenario.ego.speed_mps])


def _margins(resolved: ResolvedScenario, working: FilePath, *speeds: Sequence[float]) -> SteeringMargins:
    tuning = resolved.scenario.controller.tuning
    if tuning.get("steering", "preview") != "preview":
        raise ConfigError(f"{resolved.name}: the design knows the preview steering, got {tuning['steering']!r}")
    design: Any = module("design", workspace.controller_folders(working))
    keys = {"look_ahead_time": "look_ahead_time_s", "look_ahead_least": "look_ahead_least_m"}
    stated = {field: float(tuning[key]) for field, key in keys.items() if key in tuning}
    return SteeringMargins(design, design.margins(resolved.vehicle, replace(design.DEFAULT, **stated), *speeds))
