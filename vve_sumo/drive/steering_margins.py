"""Computes how much latency a scenario's steering bears: the gain design's margins, which cover the preview law only.

A controller says itself that it steers by that law; of any other nothing is known.

The design is a file among the controllers, found by the workspace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo import workspace
from vve_sumo.controller import module
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.pose.predict import Tuning as PredictorTuning
from vve_sumo.timing import PERIOD
from vve_sumo.values import Vehicle

#: attribute of a controller that steers by the preview law: the `PreviewTuning` of that law
TUNING_ATTRIBUTE: Final = "preview_tuning"
#: what the design takes of it
DESIGN_FIELDS: Final = ("look_ahead_time", "look_ahead_least", "derivative_time")
#: attributes beside it: time constant and washout time [s] of an observer that bears delay, None for none; share of the
#: steering trim. A controller without them has no observer, and the trim of the design.
OBSERVER_ATTRIBUTE: Final = "delay_observer"
TRIM_ATTRIBUTE: Final = "trim_share"
#: delay that the tick itself adds in lockstep [ticks]: a command is on the bus at once, and is held until the next one,
#: which delays it by half a tick on average
HELD_TICKS: Final = 0.5


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


def predicted_margin(
    resolved: ResolvedScenario, working: Path, speed: float, mass_factor: float, observer: float
) -> float:
    """Return the delay beyond the declared steering's that makes the loop unstable at a speed [m/s], in seconds.

    What the tick itself delays in lockstep is taken off. The car is `mass_factor` times as heavy as declared.
    `observer` is the time constant of the one that bears delay [s], 0 for none, in place of the scenario's. Raises
    ConfigError as `steering_margins` does.
    """
    key = "cdob_time_constant_s"
    control = resolved.scenario.controller
    tuned = control.model_copy(update={"tuning": {**control.tuning, key: observer}})
    altered = replace(resolved, scenario=resolved.scenario.model_copy(update={"controller": tuned}))
    vehicle = resolved.vehicle
    heavy = replace(vehicle, mass=mass_factor * vehicle.mass, yaw_inertia=mass_factor * vehicle.yaw_inertia)
    return _margins(altered, working, [speed], true=heavy).delay - HELD_TICKS * PERIOD


def _margins(
    resolved: ResolvedScenario, working: Path, *speeds: Sequence[float], true: Vehicle | None = None
) -> SteeringMargins:
    steering = declared_steering(resolved, working)
    design: Any = module("design", workspace.controller_folders(working))
    observer = None if steering.observer is None else design.DelayObserver(*steering.observer)
    known = {"observer": observer, "true": true, "yaw_rate_lag": PredictorTuning().rates}
    if steering.trim_share is not None:
        known["trim_share"] = steering.trim_share
    return SteeringMargins(design, design.margins(resolved.vehicle, steering.gains, *speeds, **known))


class DeclaredSteering(NamedTuple):
    """What a controller declares of its preview steering."""

    gains: Any  #: over speed: a PreviewTuning or another object with `at(vehicle, speed)`
    observer: tuple[float, float] | None  #: time constant and washout time of one that bears delay [s]; None for none
    trim_share: float | None  #: of the steering trim; None where the controller does not say


def declared_steering(resolved: ResolvedScenario, working: Path) -> DeclaredSteering:
    """Return what a scenario's controller declares of its preview steering; raises ConfigError where it does not."""
    name = resolved.scenario.controller.name
    controller = resolved.controller(working)
    declared = getattr(controller, TUNING_ATTRIBUTE, None)
    if declared is None:
        raise ConfigError(
            f"controller {name}{_of_law(resolved)}: nothing is known of the margin of its steering: the gain design "
            f"knows the preview law alone, and the controller does not declare it by an attribute {TUNING_ATTRIBUTE}"
        )
    observer, trim_share = getattr(controller, OBSERVER_ATTRIBUTE, None), getattr(controller, TRIM_ATTRIBUTE, None)
    try:
        gains = _gains(declared, workspace.controller_folders(working))
        around = None if observer is None else (float(observer[0]), float(observer[1]))
        return DeclaredSteering(gains, around, None if trim_share is None else float(trim_share))
    except (AttributeError, TypeError, ValueError, IndexError) as error:
        raise ConfigError(
            f"controller {name}: {TUNING_ATTRIBUTE}: expected a PreviewTuning or a GainSchedule: {error}"
        ) from None


def _gains(declared: Any, folders: Sequence[Path]) -> Any:
    """Return gains over speed in the workspace's own types: a PreviewTuning by its fields, or a table by its rows."""
    if (rows := getattr(declared, "rows", None)) is not None:
        return module("gain_schedule", folders).GainSchedule([(speed, *gains) for speed, gains in rows])
    stated = {field: float(getattr(declared, field)) for field in DESIGN_FIELDS}
    return module("preview", folders).PreviewTuning(**stated)


def _of_law(resolved: ResolvedScenario) -> str:
    law = resolved.scenario.controller.tuning.get("steering")
    return "" if law is None else f" with the steering law {law!r}"
