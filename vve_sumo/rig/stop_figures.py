"""Checks that what a rig says of its stops is what car, brakes, wire, gateway, interface and tyres can do.

The one place where it is checked; `rig.validation` asks it for every rig that is loaded.
"""

from __future__ import annotations

from collections.abc import Iterator

from vve_sumo.rig.resolve import braking_of, limits_of
from vve_sumo.rig.schema import Rig, WatchdogTest
from vve_sumo.vehicle.effective_deceleration import EffectiveDeceleration
from vve_sumo.vehicle.interface import InterfaceFacts, WhenCommandsStop


def complaints(rig: Rig, facts: InterfaceFacts) -> Iterator[str]:
    """Yield, naming the key, every figure of a stop that is more than what is there to give it."""
    braking = braking_of(rig, facts)
    yield from _of_the_gateway(rig, braking)
    if rig.watchdog_test is not None:
        yield from _of_the_watchdog(rig, rig.watchdog_test, facts, braking.without_gateway())


def _of_the_gateway(rig: Rig, braking: EffectiveDeceleration) -> Iterator[str]:
    limits, stated = limits_of(rig), rig.limits.model_fields_set
    stops = {
        "stop_deceleration_mps2": limits.stop_deceleration,
        "critical_deceleration_mps2": limits.critical_deceleration,
    }
    # Only as an upper limit the comfort envelope may be left wider than the car.
    stops |= {"comfort_deceleration_mps2": limits.comfort.deceleration} if "comfort_deceleration_mps2" in stated else {}
    for key, value in stops.items():
        if value > braking.value:
            usual = "" if key in stated else ", its default"
            yield f"limits.{key}: expected {braking.rounded_down()}; got {value:g}{usual}"


def _of_the_watchdog(
    rig: Rig, test: WatchdogTest, facts: InterfaceFacts, braking: EffectiveDeceleration
) -> Iterator[str]:
    key, value, stops = "watchdog_test.deceleration_mps2", test.deceleration_mps2, facts.when_commands_stop
    by_itself = f"when commands stop, {facts.title} {stops.words}"
    if stops.action is WhenCommandsStop.HOLDS:
        yield f"watchdog_test: expected none: {by_itself}, so nothing stops the car; drive with --shadow"
    if value > braking.value:
        yield f"{key}: expected {braking.rounded_down()}; got {value:g}"
    if not test.armed:
        return
    if stops.action is WhenCommandsStop.RELEASES:
        yield f"watchdog_test.armed: expected false: {by_itself}; it has no watchdog that brakes"
    most = stops.largest_deceleration(rig.calibration.brake_gain_kgm)
    if value > most:
        yield f"{key}: expected {most:.2f} m/s2 or less, all that the watchdog of {facts.title} gives; got {value:g}"
