"""Limits of what a gateway can know by its reports, each with its argument; a hunt counts them, and reports none."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.hunt.episode import Action, Episode, EpisodePhase
from vve_sumo.plant.injected_faults import VALUES

#: kind of fault that switches a module off
DROPOUT: Final = "dbw_dropout"


class Limit(NamedTuple):
    """A violation that no gateway can prevent by its reports: a frozen report hides that its module is off."""

    invariant: str
    frozen: str  #: kind of fault that freezes the module's report
    module: int  #: value of the `DROPOUT` of the same module
    why: str
    override: str = ""  #: kind of the driver's action that takes the module over, where that is no better seen
    at_rest_only: bool = False  #: whether it is no better seen in a car that stands alone

    @property
    def kinds(self) -> frozenset[str]:
        """Return the kinds of which the timeline has to hold the frozen report, and at the same time one other."""
        return frozenset({self.frozen, DROPOUT, self.override} - {""})

    def explains(self, episode: Episode) -> bool:
        """Whether the report is frozen while its own module is off."""
        frozen = [one for one in episode.actions if one.kind == self.frozen]
        off = [one for one in episode.actions if one.kind == DROPOUT and _module(one) == self.module]
        if not self.at_rest_only or episode.phase is EpisodePhase.AT_REST:
            off += [one for one in episode.actions if one.kind == self.override]
        return any(one.after < other.end and other.after < one.end for one in frozen for other in off)


def _module(dropout: Action) -> float:
    return VALUES[DROPOUT][0] if math.isnan(dropout.value) else dropout.value


LIMITS: Final = (
    Limit(
        "told_driving",
        "steering_report_frozen",
        3,
        "on a straight road a steering that is off, or that the driver has taken over, and whose report is frozen "
        "differs from a good one in nothing; it is found as soon as the steering is told to move",
        "steering_override",
    ),
    Limit(
        "told_driving",
        "brake_report_frozen",
        1,
        "brakes that are off and whose report is frozen differ from good ones in nothing while they are not told to "
        "brake, or are told to hold a car that stands with the same torque as ever; they are found as soon as they are "
        "told otherwise, or the car rolls. In a car that drives an override shows in how it slows",
        "brake_override",
        at_rest_only=True,
    ),
    Limit(
        "told_driving",
        "throttle_report_frozen",
        2,
        "a throttle that is off and whose report is frozen differs from a good one in nothing while it is told to stay "
        "closed; it is found as soon as it is told to open. A driver's foot on it shows in the car's speed alone, "
        "which the limits of rig and scenario bound",
        "throttle_override",
    ),
)


def known(invariant: str, episode: Episode) -> bool:
    """Whether a listed limit explains the violation."""
    return any(limit.invariant == invariant and limit.explains(episode) for limit in LIMITS)
