"""Decides whether the car stands, from wheel speeds, the receiver's speed and the time that braking takes.

One report of zero is never enough: a wheel-speed report can be wrong, and a car that is believed to stand is held with
a holding torque only and asked to shift to park. The module knows no frames and commands nothing.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.vehicle.actuation import START_ACCELERATION
from vve_sumo.vehicle.setpoint_validation import Debounce

WHEEL_REST: Final = 0.05  # no wheel turns faster [m/s]; reports resolve 13 mm/s on a Fusion, 3 mm/s on the wire
GNSS_REST: Final = 0.30  # the receiver's speed at standstill stays below [m/s]: ten sigma of RTK velocity
# Its mean over the last tenths of a second stays below this: noise averages out, and a creeping car does not.
GNSS_MEAN_REST: Final = 0.05  # [m/s]
GNSS_LAG: Final = 0.1  # of that mean [s]
REST_TIME: Final = 0.3  # standing this long is rest [s]
# Time after which the receiver alone is believed, against wheel speeds that are missing or above rest [s].
GNSS_REST_TIME: Final = 3.0
# No car brakes harder, so wheel speeds that fall faster are not the car's speed [m/s2].
MAX_BRAKING: Final = 12.0
QUANTUM: Final = 0.04  # of wheel speeds, three times what they resolve on a Fusion [m/s]
# Wheel speeds that fell too fast to zero, and that no receiver confirms, are believed once a car with this share of the
# commanded deceleration could stand.
BRAKING_SHARE: Final = 0.5
MIN_BRAKING: Final = 0.3  # of a car that is commanded to brake, however gently [m/s2]
# Speed that a car was commanded to gain without any report that shows it: with more, reports of rest are not believed.
# Either something holds the car, or wheels and receiver are wrong [m/s]. A car that drives off shows its first motion
# at less than half of it.
UNANSWERED: Final = 0.5
COASTING: Final = 0.1  # deceleration of a car that nobody brakes and nobody drives, at least [m/s2]


class Standstill:
    """Weighs the evidence step by step."""

    def __init__(self) -> None:
        self._possible = 0.0  # the speed that the car may still have [m/s]
        self._unanswered = 0.0  # speed that the car was commanded to gain and that no report has shown [m/s]
        self._turned_at = -math.inf  # drive time at which a wheel was last heard to turn [s]
        self.gnss_mean = 0.0  #: the receiver's speed, averaged near standstill [m/s]; the last one where unknown
        self._long = Debounce(REST_TIME)
        self._gnss_long = Debounce(GNSS_REST_TIME)
        self.certain = False  #: the wheels say so, for long enough to be true, and nothing contradicts them
        self.settled = False  #: certain for `REST_TIME`, and not commanded to drive off
        self.at_rest = False  #: settled, or the receiver alone has said so for long
        self.contradicted = False  #: the receiver has long said rest, but the wheels do not confirm it
        #: the wheels say less than the hardest braking can have left of their speed, and than the receiver
        self.fell_too_fast = False
        self.moves = False  #: something says that the car moves
        #: it moves, or the wheels do not make certain that it stands; unheard, as last heard
        self.may_move = False

    def step(
        self, now: float, elapsed: float, wheels: float | None, gnss: float | None, braking: float | None
    ) -> None:  # fmt: skip
        """Weigh the evidence at `now` [s], `elapsed` after the last step.

        `wheels` is the speed of the fastest wheel, without sign, `gnss` the receiver's, forward positive [m/s];
        None is "not known". `braking` is the commanded deceleration [m/s2], at most 0 where nobody brakes, and None
        where a driver may brake as hard as the car can.
        """
        if gnss is not None:
            self._average(gnss, elapsed)
        gnss_stands = gnss is not None and abs(gnss) < GNSS_REST
        gnss_moves = gnss is not None and abs(self.gnss_mean) >= GNSS_MEAN_REST
        wheels_stand = wheels is not None and wheels < WHEEL_REST
        if wheels is not None and not wheels_stand:
            self._turned_at = now
        fell = wheels is not None and wheels < self._possible - MAX_BRAKING * elapsed - QUANTUM
        # Wheels that the receiver confirms fell from a speed that was wrong.
        confirmed = wheels is not None and gnss is not None and wheels >= gnss - GNSS_REST
        self.fell_too_fast = fell and not confirmed
        if wheels is not None and not fell:
            self._possible = wheels
        else:
            if gnss_stands or braking is None:
                fall = MAX_BRAKING
            else:
                fall = max(BRAKING_SHARE * braking, MIN_BRAKING) if braking > 0.0 else 0.0
            self._possible = max(self._possible - fall * elapsed, 0.0)
        self.moves = gnss_moves or (wheels is not None and not wheels_stand)
        self._count_unanswered(elapsed, braking)
        answered = self._unanswered < UNANSWERED
        self.certain = wheels_stand and not gnss_moves and self._possible < WHEEL_REST and answered
        if wheels is not None:
            self.may_move = not self.certain
        elif gnss is not None:
            # A receiver that says rest may be frozen: wheels that turned a moment ago count for longer.
            turned = now - self._turned_at < GNSS_REST_TIME
            self.may_move = self.moves or (self.may_move and turned)
        # Reports that stop as the car moves off are those of a car that stood.
        self.settled = self._long.step(now, self.certain and not (braking is not None and braking < 0.0))
        self.at_rest = self._gnss_long.step(now, gnss_stands and not gnss_moves and answered) or self.settled
        self.contradicted = self.at_rest and not self.certain

    def _count_unanswered(self, elapsed: float, braking: float | None) -> None:
        """Add up the speed that is commanded while nothing says that the car moves, and take off what brakes can."""
        if self.moves:
            self._unanswered = 0.0
        elif braking is None:
            self._unanswered = max(self._unanswered - MAX_BRAKING * elapsed, 0.0)
        elif braking < 0.0:
            # A smaller request leaves a standing car held.
            self._unanswered += -braking * elapsed if -braking > START_ACCELERATION else 0.0
        else:
            loses = max(BRAKING_SHARE * braking, MIN_BRAKING) if braking > 0.0 else COASTING
            self._unanswered = max(self._unanswered - loses * elapsed, 0.0)

    def _average(self, gnss: float, elapsed: float) -> None:
        """Average the receiver's speed; one that is above rest is taken as it is, so that the mean does not lag it."""
        if abs(gnss) >= GNSS_REST:
            self.gnss_mean = math.copysign(GNSS_REST, gnss)
        elif elapsed > 0.0:
            self.gnss_mean += (gnss - self.gnss_mean) * elapsed / (GNSS_LAG + elapsed)
