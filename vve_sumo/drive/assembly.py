"""Builds the Pipeline from a resolved scenario and its source of poses; nothing else builds one.

Every shell and every replay runs the pipeline that is built here. Neither a receiver nor SUMO is started.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo.controller import Controller, Guarded
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.pipeline import FallbackRule, Pipeline
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.shared_prefix import Variants
from vve_sumo.frames import Alignment, MapFrame, Placement
from vve_sumo.lot.fallback import fallback_path
from vve_sumo.lot.geofence import Geofence
from vve_sumo.pose.dating import FixDater
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.receivers.port import FixDecoder
from vve_sumo.pose.trust import TrustGate, TrustProfile
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import PORT, STANDARD, SensorSettings
from vve_sumo.values import EGO

#: Consumers of random numbers whose streams keep the numbers that they had before streams had names.
_NUMBERED: Final = {"vehicle": 0, STANDARD: 1}
#: First number in the key of any other stream. The bytes of its name follow, so that no two names share a stream.
_NAMED_STREAM: Final = 2


def seed_of(seed: int, consumer: str, ego: str = EGO) -> np.random.SeedSequence:
    """Derive a consumer's seed sequence from the scenario's seed; adding a consumer never shifts another's stream.

    Each further `ego` has streams of its own, which its id decides.
    """
    if ego != EGO:
        consumer = f"ego {ego} {consumer}"
    number = _NUMBERED.get(consumer)
    key = (_NAMED_STREAM, *consumer.encode()) if number is None else (number,)
    return np.random.SeedSequence(seed, spawn_key=key)


@dataclass(frozen=True, slots=True)
class LotAlignment:
    """How the lot lies on the virtual road, and which GNSS time is drive time 0."""

    projection: str  #: PROJ string of the lot's map
    alignment: Alignment
    epoch: float  #: GNSS second of drive time 0

    def frame(self) -> MapFrame:
        """Return the lot's map."""
        return MapFrame(self.projection)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON, for the record."""
        alignment = self.alignment
        return {
            "epoch_gnss_s": self.epoch,
            "lot_projection": self.projection,
            "lot_to_road": {"rotation_rad": alignment.rotation, "x_m": alignment.x, "y_m": alignment.y},
        }

    @classmethod
    def from_dict(cls, scenario_content: Mapping[str, Any]) -> LotAlignment:
        """Return the alignment that `to_dict` wrote."""
        turned = scenario_content["lot_to_road"]
        alignment = Alignment(turned["rotation_rad"], turned["x_m"], turned["y_m"])
        return cls(scenario_content["lot_projection"], alignment, scenario_content["epoch_gnss_s"])


@dataclass(frozen=True, slots=True)
class PoseInput:
    """The source of a drive's poses, and what judges, dates and places them."""

    decoder: FixDecoder
    profile: TrustProfile
    placement: Placement
    epoch: float  #: GNSS second of drive time 0
    dater: FixDater | None = None  #: maps the receiver's times to drive time; None where both clocks are the same
    geofence: Geofence | None = None  #: None where the car may stop anywhere


def sensors_of(resolved: ResolvedScenario) -> dict[str, GuardedSensor]:
    """Return the scenario's sensors by name, each with its own random number generator; raises ConfigError."""

    wanted = resolved.sensors()
    street = resolved.street()

    def made(name: str, settings: SensorSettings) -> GuardedSensor:
        consumer = name if name == STANDARD else f"sensor {name}"
        seeds = seed_of(resolved.scenario.seed, consumer, resolved.ego_id)
        return GuardedSensor(name, settings, resolved.vehicle, np.random.default_rng(seeds), street)

    return {name: PORT.make(name, made, name, settings) for name, settings in wanted.items()}


def build_pipeline(
    resolved: ResolvedScenario,
    pose: PoseInput,
    working: Path,
    brain: ExternalController | None = None,
    fallback: FallbackRule = fallback_path,
    around: Callable[[Controller], Controller] | None = None,
    variants: Variants | None = None,
) -> Pipeline:
    """Return a scenario's pipeline; raises ConfigError as `ResolvedScenario.controller` does.

    With a `brain`, samples go out to it; where it decides, the scenario's controller is not made. `fallback` gives
    the fallback path, see `Pipeline`; `around` returns what is asked in place of the scenario's controller. With
    `variants` the controllers of all of them answer.
    """

    def guarded(scenario: ResolvedScenario) -> Guarded:
        own = partial(scenario.controller, working)
        controller = own() if brain is None else brain.select_controller(own)
        return Guarded(controller if around is None else around(controller))

    return Pipeline(
        decoder=pose.decoder,
        gate=TrustGate(pose.profile, pose.epoch),
        placement=pose.placement,
        predictor=Predictor(),
        sensors=sensors_of(resolved),
        controller=guarded(resolved) if variants is None else variants.controller(guarded),
        vehicle=resolved.vehicle,
        path=resolved.path,
        desired_speed=resolved.scenario.ego.speed_mps,
        deviation_limit=resolved.scenario.ego.deviation_limit_m,
        speed_margin=resolved.scenario.ego.speed_margin_mps,
        dater=pose.dater,
        epoch=pose.epoch,
        geofence=pose.geofence,
        wires=None if brain is None else brain.publisher,
        fallback=fallback,
    )
