"""Drives as follow_and_stop does, with observers around its steering law: against delay, and against disturbances.

The tuning keys are those of follow_and_stop and of the observers.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import delay_observers, follow_and_stop
from .delay_observers import delay_observer, innermost, with_observers
from .follow_and_stop import FollowAndStop, SteeringLaw, steering_law
from .preview import PreviewSteering

TUNING: dict[str, float | str | bool] = {
    **follow_and_stop.TUNING,
    **delay_observers.TUNING,
    "cdob_time_constant_s": 0.1,
}
RANGES: dict[str, tuple[float, float]] = {**follow_and_stop.RANGES, **delay_observers.RANGES}


class DelayTolerant(FollowAndStop):
    """FollowAndStop whose steering law is inside the observers that the tuning asks for."""

    def __init__(self, vehicle: Vehicle, law: SteeringLaw, tuning: dict[str, float]) -> None:
        super().__init__(vehicle, with_observers(law, vehicle, tuning), tuning)
        core = innermost(law)
        self.preview_tuning = core.tuning if isinstance(core, PreviewSteering) else None
        # For the gain design: of the steering trim, and time constant and washout time [s] of what bears delay.
        self.trim_share, self.delay_observer = tuning["trim_share"], delay_observer(self._law)


def make(vehicle: Vehicle, tuning: Tuning) -> DelayTolerant:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()}
    return DelayTolerant(vehicle, steering_law(name, vehicle, numbers), numbers)
