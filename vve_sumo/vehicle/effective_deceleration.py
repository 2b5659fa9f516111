"""How hard a car brakes as it is driven: the least of what car, brakes, wire, gateway and tyres allow.

The one place where these values meet: controllers, suites, the geofence, the doctor and the check of a rig's stops
take theirs from here. Everything holds on the level and at the declared mass, unless another is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import InterfaceFacts, load
from vve_sumo.vehicle.limits import Limits
from vve_sumo.vehicle.model import VehicleModel

#: friction of tyres on a dry road, where no other is known
DRY_FRICTION: Final = 0.9
#: factor by which a declared deceleration may exceed what torque limit and brake gain give: both are rounded
ROUNDING: Final = 1.02


class Bound(NamedTuple):
    """What one part allows."""

    part: str  #: which part, in a word
    deceleration: float  #: largest [m/s2], a positive number
    why: str  #: where the value comes from


@dataclass(frozen=True, slots=True)
class EffectiveDeceleration:
    """What every part allows; the least holds."""

    car: Bound  #: declared
    others: tuple[Bound, ...]  #: brakes, wire, gateway, tyres

    @property
    def limiting(self) -> Bound:
        """The part that allows least; the car where another allows just as much."""
        return min((self.car, *self.others), key=lambda bound: bound.deceleration)

    @property
    def value(self) -> float:
        """The effective deceleration [m/s2]."""
        return self.limiting.deceleration

    def without_gateway(self) -> EffectiveDeceleration:
        """Return the same without the gateway, as for what brakes when the gateway is dead."""
        return replace(self, others=tuple(bound for bound in self.others if bound.part != "gateway"))

    def in_words(self) -> str:
        """Return what every part allows, in one line."""
        bounds = ", ".join(f"{bound.part} {_rounded(bound.deceleration):g}" for bound in (self.car, *self.others))
        return f"{bounds} m/s2; least: {self.limiting.why}"

    def rounded_down(self) -> str:
        """Return the greatest value that a file may hold, rounded down."""
        return f"{_rounded(self.value):g} m/s2 or less ({self.in_words()})"

    def shortfall_text(self) -> str:
        """Return the line for whoever drives such a car; empty where it brakes as declared, but for rounding."""
        if self.car.deceleration <= ROUNDING * self.value:
            return ""
        return (
            f"this car brakes with {_rounded(self.value):g} m/s2 at most, not with the declared "
            f"{self.car.deceleration:g}: {self.in_words()}"
        )


def effective_deceleration(
    vehicle: Vehicle,
    calibration: Calibration,
    limits: Limits,
    facts: InterfaceFacts,
    *,
    friction: float = DRY_FRICTION,
    mass_factor: float = 1.0,
) -> EffectiveDeceleration:
    """Return what a car, its brakes, its wire, its gateway and its tyres allow.

    `friction` is that of tyre on road. `mass_factor` is the true mass over the declared one: the same torque brakes a
    heavier car less, while the tyres' friction grows with the weight.
    """

    def by_torque(torque: float) -> float:
        return torque / (calibration.brake_gain * mass_factor)

    by_gain = f", calibration.brake_gain_kgm {calibration.brake_gain:g}"
    torque = min(vehicle.brake_torque_limit, calibration.brake_torque_limit)
    declared, emergency = vehicle.deceleration_limit, limits.emergency.deceleration
    return EffectiveDeceleration(
        Bound("car", declared / mass_factor, f"vehicle.deceleration_limit_mps2 is {declared:g}"),
        (
            Bound("brakes", by_torque(torque), f"vehicle.brake_torque_limit_nm is {torque:g}{by_gain}"),
            _of_the_wire(facts, by_torque, by_gain),
            Bound("gateway", emergency / mass_factor, f"limits.emergency_deceleration_mps2 is {emergency:g}"),
            Bound("tyres", friction * GRAVITY, f"friction {friction:g}"),
        ),
    )


def _of_the_wire(facts: InterfaceFacts, by_torque: Callable[[float], float], by_gain: str) -> Bound:
    """Return what the wire can ask for; an acceleration is the car's own matter, whatever it weighs."""
    if facts.acceleration_limits is not None:
        least = facts.acceleration_limits.minimum
        return Bound("wire", -least, f"{facts.title} takes {least:g} m/s2")
    torque = facts.brake_torque_limit
    return Bound("wire", by_torque(torque), f"{facts.title} takes {torque:g} N m{by_gain}")


def of_model(model: VehicleModel, *, friction: float = DRY_FRICTION, mass_factor: float = 1.0) -> EffectiveDeceleration:
    """Return what a vehicle model allows with its own interface; raises ConfigError where that cannot be made."""
    return effective_deceleration(
        model.vehicle,
        model.calibration,
        model.limits,
        load(model.interface).facts,
        friction=friction,
        mass_factor=mass_factor,
    )


def limited_to(model: VehicleModel, effective: EffectiveDeceleration) -> VehicleModel:
    """Return the model with its declared deceleration lowered to the effective one, which controllers plan with."""
    if effective.limiting is effective.car:
        return model
    return replace(model, vehicle=replace(model.vehicle, deceleration_limit=effective.value))


def _rounded(deceleration: float) -> float:
    """Return a number of two decimals that is not greater, but for what a number in binary loses."""
    return math.floor(round(100.0 * deceleration, 6)) / 100.0
