"""Computes how much latency a scenario's steering bears: the gain design's margins, which cover the preview law only.

A controller says itself that it steers by that law; of any other nothing is known.

The design is a file among the controllers, found by the workspace. It imports python-control, which takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.controller import module
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError

#: attribute of a controller that steers by the preview law: the `PreviewTuning` of that law
TUNING_ATTRIBUTE: Final = "preview_tuning"
#: what the design takes of it
DESIGN_FIELDS: Final = ("look_ahead_time", "look_ahead_least", "derivative_time")


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


def steering_margins(resolved: ResolvedScenario, working: Path) -> SteeringMargins:
    """Return the margins of a scenario's preview steering over the design's speed range.

    Raises ConfigError for tuning that the controller refuses, and where it does not declare that it steers by the
    preview law: then nothing is known of its steering's margin.
    """
    return _margins(resolved, working)


def margins_at_speed(resolved: ResolvedScenario, working: Path) -> SteeringMargins:
    """Return the margins at the scenario's own speed; raises ConfigError as `steering_margins` does."""
    return _margins(resolved, working, [resolved.scenario.ego.speed_mps])


def _margins(resolved: ResolvedScenario, working: Path, *speeds: Sequence[float]) -> SteeringMargins:
    name = resolved.scenario.controller.name
    declared = getattr(resolved.controller(working), TUNING_ATTRIBUTE, None)
    if declared is None:
        raise ConfigError(
            f"controller {name}{_of_law(resolved)}: nothing is known of the margin of its steering: the gain design "
            f"knows the preview law alone, and the controller does not declare it by an attribute {TUNING_ATTRIBUTE}"
        )
    design: Any = module("design", workspace.controller_folders(working))
    try:
        stated = {field: float(getattr(declared, field)) for field in DESIGN_FIELDS}
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"controller {name}: {TUNING_ATTRIBUTE}: expected a PreviewTuning: {error}") from None
    return SteeringMargins(design, design.margins(resolved.vehicle, replace(design.DEFAULT, **stated), *speeds))


def _of_law(resolved: ResolvedScenario) -> str:
    law = resolved.scenario.controller.tuning.get("steering")
    return "" if law is None else f" with the steering law {law!r}"
