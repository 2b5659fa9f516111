"""Cooperative adaptive cruise control: follows closer than ACC, by what the car ahead says of its own acceleration.

Behind a car whose V2X messages come, its acceleration is added to that of `car_following.ConstantTimeGap`, and the time
gap is short; without them the time gap grows to that of ACC, and ACC it is. The scenario needs a sensor of kind `v2x`;
the tuning key `sensor` names it. Everything else is that of `acc`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from vve_sumo.controller import Tuning, settle
from vve_sumo.laws import rate_limit
from vve_sumo.values import ControlCommand, Observation, Vehicle

from . import acc
from .car_following import ConstantTimeGap
from .follow_and_stop import PERIOD, FollowAndStop, steering_law
from .lead_message import LeadMessage, LeadMessages

#: A message older than this is no more heeded [s]: a vehicle sends at least every second.
LIFETIME: Final = 1.2
#: The radar's gap and the message's may differ by this, or the message is another car's [m].
SAME_CAR: Final = 4.0
#: How fast the time gap grows where messages are lost, and falls where they come again [s/s].
GROWS, FALLS = 0.2, 0.1

TUNING: dict[str, float | str | bool] = {
    **acc.TUNING,
    "time_headway_s": 0.8,  #: on top of `gap_m`, times the speed, behind a car whose messages come
    "time_headway_without_s": 1.5,  #: the same behind any other
    "gap_gain_per_s2": 0.1,
    "speed_gain_per_s": 0.7,
    "feed_forward": 0.7,  #: share of the acceleration of the car ahead that is asked for
    "smoothing_s": 0.0,  #: time constant of that acceleration, which messages tell with noise
    "sensor": "obu",  #: name of the scenario's V2X receiver
}
RANGES: dict[str, tuple[float, float]] = {
    **acc.RANGES,
    "time_headway_without_s": (0.0, 5.0),
    "feed_forward": (0.0, 1.0),
    "smoothing_s": (0.0, 5.0),
}


@dataclass(slots=True)
class CooperativeTimeGap:
    """The law of the gap: `ConstantTimeGap` with a time gap of the moment, plus the acceleration of the car ahead.

    With the lag tau and the delay theta of the car's answer and messages of age a, H = v / v_lead is
    e^(-theta s) (k1 + k2 s + F s^2 e^(-a s)) / (s^2 (tau s + 1) + e^(-theta s) ((k2 + k1 T) s + k1)), F the fed share.
    """

    standstill_gap: float  #: [m]
    gap_gain: float  #: k1 [1/s2]
    speed_gain: float  #: k2 [1/s]
    with_messages: float  #: time gap where they come [s]
    without: float  #: time gap where they do not [s]
    share: float  #: of the acceleration of the car ahead
    smoothing: float  #: [s]
    message: LeadMessage | None = None  #: the newest of the car ahead
    time_gap: float = field(init=False)  #: of the moment [s]
    _fed: float = field(init=False, default=0.0)  # [m/s2]

    def __post_init__(self) -> None:
        self.time_gap = self.without

    def acceleration(self, speed: float, desired: float, gap: float, lead_speed: float) -> float:
        """Return the acceleration [m/s2], infinite without a car ahead; called once every PERIOD.

        Arguments are those of `ConstantTimeGap.acceleration`.
        """
        message = self.message
        heard = message is not None and message.age <= LIFETIME and abs(message.gap - gap) <= SAME_CAR
        wanted = self.with_messages if heard else self.without
        self.time_gap = rate_limit(wanted, self.time_gap, GROWS if wanted > self.time_gap else FALLS, PERIOD)
        fed = self.share * message.acceleration if heard and message is not None else 0.0
        self._fed += (fed - self._fed) * PERIOD / (self.smoothing + PERIOD)
        law = ConstantTimeGap(self.standstill_gap, self.time_gap, self.gap_gain, self.speed_gain)
        own = law.acceleration(speed, desired, gap, lead_speed)
        return own + self._fed if math.isfinite(own) else own


class CooperativeCruiseControl:
    """`FollowAndStop` with a law of the gap that hears the car ahead."""

    def __init__(self, follow: FollowAndStop, law: CooperativeTimeGap, messages: LeadMessages) -> None:
        """`law` is that of `follow`."""
        self._follow, self._law, self._messages = follow, law, messages
        self._s: float | None = None

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation; called once every PERIOD."""
        pose = observation.pose
        projection = observation.path.project(pose.x, pose.y, self._s)
        self._s = projection.s
        self._law.message = self._messages.step(observation, projection)
        return self._follow.step(observation)


def make(vehicle: Vehicle, tuning: Tuning) -> CooperativeCruiseControl:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()}
    law = CooperativeTimeGap(
        numbers["gap_m"],
        numbers["gap_gain_per_s2"],
        numbers["speed_gain_per_s"],
        numbers["time_headway_s"],
        numbers["time_headway_without_s"],
        numbers["feed_forward"],
        numbers["smoothing_s"],
    )
    follow = FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers | {"comfort": 1.0}, law)
    return CooperativeCruiseControl(follow, law, LeadMessages(vehicle, sensor))
