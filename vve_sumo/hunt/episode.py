"""What one episode of a hunt is: the road, the phase in which the first action sets in, and the timeline of actions.

Plain values with their JSON; nothing here runs an episode.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.hunt.brains import BEHAVIOURS
from vve_sumo.plant.injected_faults import DRIVER_ACTIONS, KINDS, FaultClock, InjectedFault, Shape
from vve_sumo.vehicle.arming_machine import OperatorCommand


class EpisodePhase(enum.StrEnum):
    """Part of a drive in which an episode's first action sets in."""

    ARMING = "arming"  #: nothing is engaged yet
    ENGAGING = "engaging"  #: the DBW controller is being enabled, the gear is shifted
    HELD = "held"  #: engaged, waiting for the operator's go
    DRIVING = "driving"  #: under way
    BEND = "bend"  #: under way in a bend
    BRAKING = "braking"  #: the controller brakes for the obstacle
    AT_REST = "at_rest"  #: engaged, at rest behind the obstacle
    STOPPED = "stopped"  #: the drive is over, the gateway holds the car
    RELEASED = "released"  #: parked, the gateway has let go


#: What a driver does, as kinds of injected faults.
DRIVER: Final = tuple(kind for kind in KINDS if kind in DRIVER_ACTIONS)
#: Faults of car, bus and receiver.
FAULTS: Final = tuple(kind for kind in KINDS if kind not in DRIVER)
#: Operator commands as kinds of actions.
KEYS: Final = {f"key_{command.value}": command for command in OperatorCommand}
#: Every kind of action.
ACTIONS: Final = (*FAULTS, *DRIVER, *KEYS, *BEHAVIOURS)


@dataclass(frozen=True, slots=True)
class Action:
    """One fault, driver action, operator key or behaviour of the brain; raises ConfigError for an unknown kind."""

    kind: str  #: one of `ACTIONS`
    after: float  #: beginning, after the episode's onset [s]
    duration: float  #: [s]; a key is pressed once
    value: float = math.nan  #: of an injected fault; NaN is the kind's default
    shape: Shape = Shape.STEP  #: of an injected fault
    period: float = math.nan  #: of `Shape.FLAPPING`, of each half [s]

    def __post_init__(self) -> None:
        """Raise ConfigError for what cannot be done."""
        if self.kind not in ACTIONS:
            raise ConfigError(f"action: kind must be one of {', '.join(ACTIONS)}; got {self.kind!r}")
        if self.kind in KINDS:
            self.fault(0.0)
        elif not (0.0 <= self.after < math.inf and self.duration > 0.0):
            raise ConfigError(f"action {self.kind}: after must be 0 s or more and duration positive, got {self}")

    @property
    def end(self) -> float:
        """When it is over, after the onset [s]."""
        return self.after if self.kind in KEYS else self.after + self.duration

    def fault(self, onset: float) -> InjectedFault:
        """Return the fault to inject; `onset` is the drive time of the episode's [s]."""
        at = onset + self.after
        return InjectedFault(self.kind, at, self.duration, self.value, self.shape, self.period, FaultClock.DRIVE)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        numbers = {"value": self.value, "period_s": self.period}
        told = {name: number for name, number in numbers.items() if not math.isnan(number)}
        shape = {} if self.shape is Shape.STEP else {"shape": self.shape.value}
        return {"kind": self.kind, "after_s": self.after, "for_s": self.duration, **told, **shape}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Action:
        """Return what `to_dict` gave; raises AttributeError, KeyError, TypeError or ValueError for other data."""
        shape, period = Shape(data.get("shape", Shape.STEP)), data.get("period_s", math.nan)
        return cls(data["kind"], data["after_s"], data["for_s"], data.get("value", math.nan), shape, period)

    def __str__(self) -> str:
        """Return the action in a few words."""
        value = "" if math.isnan(self.value) else f"={self.value:g}"
        shape = "" if self.shape is Shape.STEP else f" ({self.shape.value})"
        lasting = "" if self.kind in KEYS else f" for {self.duration:g} s"
        return f"{self.kind}{value}{shape} at {self.after:g} s{lasting}"


@dataclass(frozen=True, slots=True)
class RoadConditions:
    """The road and the true car, as the scenario's `ego.car` and `weather` say them."""

    grade_percent: float = 0.0  #: uphill positive
    friction: float = 0.9  #: of tyre on road
    mass_factor: float = 1.0  #: true mass over declared
    brake_gain_factor: float = 1.0  #: true brake torque over commanded


@dataclass(frozen=True, slots=True)
class Episode:
    """A timeline of actions in a drive that is nominal up to its onset."""

    phase: EpisodePhase
    offset: float  #: of the onset, after the phase's beginning [s]
    actions: tuple[Action, ...]
    road: RoadConditions = RoadConditions()
    seed: int = 1  #: of the vehicle's noise

    @property
    def end(self) -> float:
        """When the last action is over, after the onset [s]."""
        return max((action.end for action in self.actions), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {
            "phase": self.phase.value,
            "offset_s": self.offset,
            "actions": [action.to_dict() for action in self.actions],
            "road": asdict(self.road),
            "seed": self.seed,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Episode:
        """Return what `to_dict` gave; raises AttributeError, KeyError, TypeError or ValueError for other data."""
        actions = tuple(map(Action.from_dict, data["actions"]))
        return cls(EpisodePhase(data["phase"]), data["offset_s"], actions, RoadConditions(**data["road"]), data["seed"])

    def __str__(self) -> str:
        """Return the timeline on one line."""
        actions = ", ".join(map(str, self.actions))
        return f"{self.phase.value} + {self.offset:g} s: {actions}"
