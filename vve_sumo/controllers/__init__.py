"""The parts of the shipped controllers, for a controller of one's own: `from vve_sumo.controllers import Tracker`.

The modules of this package are the files of the shipped folder `controllers/`, wherever it is installed, never those of
the working folder. Nothing is imported before it is used.
"""

from __future__ import annotations

import importlib
from typing import Any, Final

from vve_sumo.workspace import shipped_root

__path__ = [str(shipped_root() / "controllers")]

#: parts by name, and the module of each
PARTS: Final = {
    "Approach": "approach",
    "CarFollowing": "follow_and_stop",
    "CommunicationDisturbanceObserver": "delay_observers",
    "ConstantTimeGap": "car_following",
    "CooperativeTimeGap": "cacc",
    "DelayTolerant": "delay_tolerant",
    "Deviation": "deviation",
    "DeviationObserver": "deviation",
    "DisturbanceObserver": "delay_observers",
    "ElasticBand": "elastic_band",
    "Emergency": "emergency",
    "FollowAndStop": "follow_and_stop",
    "FrenetSampling": "frenet_sampling",
    "GainSchedule": "gain_schedule",
    "Goal": "approach",
    "IntelligentDriver": "car_following",
    "LateralRegulator": "lqr",
    "LeadMessages": "lead_message",
    "Outlines": "outlines",
    "PreviewSteering": "preview",
    "PreviewTuning": "preview",
    "PurePursuit": "pure_pursuit",
    "RadarStop": "radar_stop",
    "SignalStop": "signal_stop",
    "SignalWatch": "signal_stop",
    "SpeedKeeper": "speed",
    "SpeedProfile": "speed",
    "Standstill": "approach",
    "Stanley": "stanley",
    "SteerAround": "steer_around",
    "SteeringLaw": "follow_and_stop",
    "SteeringTrim": "trim",
    "Target": "tracks",
    "Tracker": "tracks",
    "steering_law": "follow_and_stop",
    "with_observers": "delay_observers",
}

__all__ = sorted(PARTS)  # noqa: PLE0605 - of names that __getattr__ gives


def __getattr__(name: str) -> Any:
    if name not in PARTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{PARTS[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
