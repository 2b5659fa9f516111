"""Car-following laws: what acceleration the gap to the car ahead asks for, by its speed and one's own.

Knows numbers only: neither how a gap is measured nor how the car is steered. A law takes the present gap and speeds as
they are and predicts no latency away, so that what a delay does to it can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

LEAST_GAP: Final = 0.1  #: gap that stands for contact, where the law divides by it [m]


@dataclass(frozen=True, slots=True)
class ConstantTimeGap:
    """Adaptive cruise control with a constant time gap (Rajamani, Vehicle Dynamics and Control, 2012, chapter 6).

    a = k1 (s - s0 - T v) + k2 (v_lead - v), so that the equilibrium gap is s0 + T v. Without lag, a string of such
    cars amplifies no disturbance where k2 T + k1 T^2 / 2 >= 1.
    """

    standstill_gap: float = 5.0  #: s0 [m]
    time_gap: float = 1.5  #: T [s]
    gap_gain: float = 0.23  #: k1 [1/s2]
    speed_gain: float = 0.6  #: k2 [1/s]

    def acceleration(self, speed: float, desired: float, gap: float, lead_speed: float) -> float:
        """Return the acceleration [m/s2], infinite without a car ahead; the `desired` speed has no part in it.

        Speeds in m/s along the path; `gap` from bumper to bumper [m].
        """
        error = gap - self.standstill_gap - self.time_gap * speed
        return self.gap_gain * error + self.speed_gain * (lead_speed - speed)

    def equilibrium_gap(self, speed: float) -> float:
        """Return the gap [m] that is kept behind a car of constant speed [m/s]."""
        return self.standstill_gap + self.time_gap * speed


@dataclass(frozen=True, slots=True)
class IntelligentDriver:
    """Intelligent Driver Model (Treiber, Hennecke, Helbing, Physical Review E 62, 1805, 2000), by default as there.

    a = a0 (1 - (v / v0)^delta - (s* / s)^2) with s* = s0 + max(0, v T + v (v - v_lead) / (2 sqrt(a0 b))); v0 is the
    desired speed.
    """

    standstill_gap: float = 2.0  #: s0 [m]
    time_gap: float = 1.6  #: T [s]
    greatest_acceleration: float = 0.73  #: a0 [m/s2]
    comfortable_deceleration: float = 1.67  #: b [m/s2], positive
    exponent: float = 4.0  #: delta

    def acceleration(self, speed: float, desired: float, gap: float, lead_speed: float) -> float:
        """Return the acceleration [m/s2]; without a car ahead, of infinite gap, that of the free road.

        Speeds in m/s along the path; `gap` from bumper to bumper [m], below LEAST_GAP taken for it.
        """
        free = 1.0 - math.pow(max(speed, 0.0) / desired, self.exponent)
        if math.isinf(gap):
            return self.greatest_acceleration * free
        softness = 2.0 * math.sqrt(self.greatest_acceleration * self.comfortable_deceleration)
        dynamic = speed * self.time_gap + speed * (speed - lead_speed) / softness
        wanted = self.standstill_gap + max(0.0, dynamic)
        return self.greatest_acceleration * (free - (wanted / max(gap, LEAST_GAP)) ** 2)

    def equilibrium_gap(self, speed: float, desired: float) -> float:
        """Return the gap [m] that is kept behind a car of constant speed [m/s] below the desired one."""
        return (self.standstill_gap + speed * self.time_gap) / math.sqrt(1.0 - math.pow(speed / desired, self.exponent))
