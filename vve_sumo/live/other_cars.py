"""Tells each real car of a live drive when it can no longer count on another one.

A car that is stopped, let go of, or lost with its gateway stands, or rolls to rest, somewhere on the virtual road.
Where its receiver is lost too, nobody knows where. So by default every other car comes to rest in comfort. It never
goes on by itself: a stop ends the drive. Knows states; no channel, no road and no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from vve_sumo.drive.reasons import in_words
from vve_sumo.drive.termination import Outcome
from vve_sumo.values import ArmingState

#: reason codes: nobody commands the other car any more, or its gateway has stopped it or let go of it
GONE: Final = "other_car_gone"
STOPPED: Final = "other_car_stopped"


class RealCar(Protocol):
    """What is asked of each real car."""

    @property
    def id(self) -> str:
        """Id of the car's ego."""
        ...

    @property
    def outcome(self) -> Outcome | None:
        """How the car's drive ended; None while it goes on."""
        ...

    @property
    def stops_with_others(self) -> bool:
        """Whether the car stops where it can no longer count on another one; its rig says so."""
        ...

    @property
    def other_cars_lost(self) -> dict[str, dict[str, Any]]:
        """The others that the car can no longer count on, by their ids, and why; added to here."""
        ...

    def lost(self) -> str:
        """Return the reason code for which no other car can count on this one any more; empty while it can."""
        ...

    def stop_reasons(self) -> tuple[str, ...]:
        """Return why the gateway stopped the car; empty while it has not."""
        ...


def lost_reason(gone: bool, has_engaged: bool, state: ArmingState) -> str:
    """Return why no other car can count on a car any more; empty while it can.

    `gone`: its gateway has closed its channel, or is silent. A car that was never engaged stands, and is waited for.
    """
    if gone:
        return GONE
    return STOPPED if has_engaged and state is not ArmingState.ENGAGED else ""


class OtherCars:
    """What each of a drive's real cars is told of the others."""

    def __init__(self, cars: Sequence[RealCar], say: Callable[[str], None]) -> None:
        """`say` is called with a line for the operator when a car is first told of another one."""
        self._cars, self._say = cars, say

    def codes(self, place: int, now: float) -> tuple[str, ...]:
        """Tell the car at a place at drive time `now` [s]; return the reason codes for which it stops.

        Once every car has its outcome the drive is over, and each lets go of its car when it is parked.
        """
        if all(car.outcome is not None for car in self._cars):
            return ()
        car, codes = self._cars[place], dict[str, None]()
        for other in self._cars:
            if other is car or not (code := other.lost()):
                continue
            codes[code] = None
            if other.id not in car.other_cars_lost:
                car.other_cars_lost[other.id] = {"code": code, "time_s": now, "reasons": list(other.stop_reasons())}
                goes_on = "" if car.stops_with_others else "; it goes on, as its rig says"
                self._say(f"{car.id}: {in_words(code)} ({other.id}){goes_on}")
        return tuple(codes) if car.stops_with_others else ()
