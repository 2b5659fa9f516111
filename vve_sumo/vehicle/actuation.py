"""Turns a requested acceleration into what an interface is asked for, and holds the car at standstill.

A bounded integral corrects what the car misses. An interface that takes an acceleration gets that, corrected; one that
takes pedals gets a brake torque or a throttle opening by the calibration's inverse model (drag, creep) and the grade,
never both at once. The module knows no comfort limits, no frames and no arming states.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from vve_sumo.laws import clamp
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.vehicle.calibration import Calibration

#: Acceleration for each m/s of speed that the car is behind its reference [1/s]. The speed error is the integral of
#: the acceleration error, so this is an integral gain: the effect of a wrong mass or brake gain fades in about 1/3 s.
INTEGRAL_GAIN: Final = 3.0
CORRECTION_LIMIT: Final = 1.5  # largest correction [m/s2]: 15 % mass, 10 % brake gain and 3 % grade at 3.5 m/s2
PEDAL_BAND: Final = 0.10  # a change of pedals needs this much force beyond zero, over mass [m/s2]; 1 % of grade
START_ACCELERATION: Final = 0.10  # leaving standstill needs a request above this [m/s2]
REST_SPEED: Final = 0.05  # slower than this is standing [m/s]; reports resolve 13 mm/s on a Fusion
ROLL_BACK_SPEED: Final = 0.10  # faster backwards than this is rolling away [m/s]
HOLD_GRADE: Final = 0.10  # the car is held on any grade up to this, whatever grade is estimated
HOLD_MARGIN: Final = 1.3  # covers 15 % mass and 10 % brake gain
HOLDING_SHARE: Final = 0.9  # of the holding torque from which a standing car counts as held
HOLD_RATE: Final = 3000.0  # of the holding torque, both ways [N m/s]; full hold within a third of a second


class Pedals(NamedTuple):
    """Commanded pedals, of which at most one is not zero, and the acceleration that they are to give.

    Of a car that is commanded an acceleration, the pedals are what its own controller is expected to use.
    """

    brake_torque: float  #: all wheels together [N m]
    throttle: float  #: 0 to 1
    acceleration: float = 0.0  #: over ground [m/s2]; of a car that is held, that of its holding torque


class Actuation:
    """Turns acceleration into pedals, step by step; holds the car at standstill.

    The reference is the speed that the requested accelerations would give through the declared delay and lag of the
    actuators (brake_delay and brake_lag [s], or the calibration's drive lag while the throttle works).
    """

    def __init__(self, calibration: Calibration, brake_delay: float, brake_lag: float) -> None:
        self._calibration = calibration
        self._brake_delay, self._brake_lag = brake_delay, brake_lag
        self._time = 0.0  # its own, by the steps' lengths [s]
        self._delayed: deque[tuple[float, float]] = deque()  # time and requested acceleration
        creep = calibration.creep_force / calibration.mass
        hold_torque = HOLD_MARGIN * calibration.brake_gain * (creep + GRAVITY * HOLD_GRADE)
        self._hold_torque = min(hold_torque, calibration.brake_torque_limit)
        #: a car that stands is held by this brake torque at least, less what the last steps of its rise miss [N m]
        self.holding_torque = HOLDING_SHARE * self._hold_torque
        self.reset()

    def reset(self) -> None:
        """Forget the past: the car is about to be engaged, at rest."""
        self._holding = True
        self._hold_target = self._hold_torque
        self._driving = False
        self._torque = 0.0
        self._believed_speed = 0.0
        self._restart()

    def step(
        self,
        acceleration: float,
        speed: float,
        grade: float,
        elapsed: float,
        *,
        brakes_only: bool = False,
        believed: bool = True,
    ) -> Pedals:
        """Pedals for `acceleration` [m/s2] at the measured `speed` [m/s] on `grade` [rad, uphill positive].

        `elapsed` is the time since the last step [s]. A grade beyond HOLD_GRADE is clipped to it. With `brakes_only`
        the throttle always stays closed, and no acceleration above zero is asked for. In place of a speed that is NaN
        or not `believed` the last other one counts, and nothing more is corrected; with `brakes_only` a correction from
        before counts only if it brakes harder.
        """
        measured = speed if believed else math.nan
        if measured == measured:
            self._believed_speed = speed
        speed = self._believed_speed
        if self._stands(acceleration, speed):
            return self._hold(speed, elapsed)
        error = self._speed_error(acceleration, measured, elapsed)
        if brakes_only and measured != measured:
            # Nobody sees any more whether the car brakes too hard: what made it so may be the speed's own jump.
            error = min(error, 0.0)
        requested = acceleration + INTEGRAL_GAIN * error
        slope = clamp(math.sin(grade), -HOLD_GRADE, HOLD_GRADE)
        force = self._calibration.force(requested, slope, speed)
        return self._pedals(force, requested, speed, brakes_only)

    def without_speed(self, deceleration: float, grade: float) -> Pedals:
        """Pedals for `deceleration` [m/s2] when the speed is not known: brakes alone, against full creep.

        A downhill `grade` [rad, uphill positive] is braked against as well; an uphill one is not relied on.
        """
        downhill = min(max(-math.sin(grade), 0.0), HOLD_GRADE)
        force = self._calibration.mass * (deceleration + GRAVITY * downhill) + self._calibration.creep_force
        self._torque = self._calibration.brake_torque(force)
        return Pedals(self._torque, 0.0, -deceleration)

    def lose_speed(self) -> None:
        """Compare the next speed with none before it: what is lost while the speed is unknown is not corrected."""
        self._last_speed = math.nan

    def _stands(self, acceleration: float, speed: float) -> bool:
        if self._holding:
            if acceleration > START_ACCELERATION and speed > -ROLL_BACK_SPEED:
                self._holding = False
                self._restart()
        elif (acceleration <= 0.0 and speed < REST_SPEED) or speed < -ROLL_BACK_SPEED:
            self._holding = True
            self._hold_target = self._hold_torque
        return self._holding

    def _restart(self) -> None:
        self._error = 0.0
        self._saturation = 0
        self._reference_acceleration = 0.0
        self._delayed.clear()
        self._delayed.append((-math.inf, 0.0))
        self._last_speed = math.nan

    def _hold(self, speed: float, elapsed: float) -> Pedals:
        if abs(speed) >= REST_SPEED and self._torque >= self._hold_target:
            # The car rolls although it is held: the grade exceeds HOLD_GRADE. The full torque then holds it until it is
            # released.
            self._hold_target = self._calibration.brake_torque_limit
        change = HOLD_RATE * elapsed
        self._torque += clamp(self._hold_target - self._torque, -change, change)
        self._driving = False
        return Pedals(self._torque, 0.0, -self._torque / self._calibration.brake_gain)

    def _speed_error(self, acceleration: float, speed: float, elapsed: float) -> float:
        """Reference speed minus measured speed [m/s], bounded; it does not grow against a saturated pedal."""
        lag = self._calibration.drive_lag if self._driving else self._brake_lag
        blend = elapsed / (lag + elapsed) if elapsed > 0.0 else 0.0
        reference = self._reference_target(acceleration, elapsed)
        self._reference_acceleration += blend * (reference - self._reference_acceleration)
        change = self._reference_acceleration * elapsed - (speed - self._last_speed)
        self._last_speed = speed
        if change != change or change * self._saturation > 0.0:
            return self._error
        bound = CORRECTION_LIMIT / INTEGRAL_GAIN
        self._error = clamp(self._error + change, -bound, bound)
        return self._error

    def _reference_target(self, acceleration: float, elapsed: float) -> float:
        """The request that this step's speed reflects: that of a step and the brakes' delay ago, to half a step."""
        self._time += elapsed
        delayed = self._delayed
        delayed.append((self._time, acceleration))
        newest = self._time - self._brake_delay - 0.5 * elapsed
        while len(delayed) > 1 and delayed[1][0] <= newest:
            delayed.popleft()
        return delayed[0][1]

    def _pedals(self, force: float, acceleration: float, speed: float, brakes_only: bool) -> Pedals:
        band = PEDAL_BAND * self._calibration.mass
        if brakes_only:
            self._driving = False
        elif self._driving:
            self._driving = force > -band
        else:
            self._driving = force > band
        if self._driving:
            self._torque = 0.0
            throttle = self._calibration.throttle(force, speed)
            self._saturation = 1 if throttle >= 1.0 else 0
            return Pedals(0.0, throttle, acceleration)
        self._torque = self._calibration.brake_torque(-force)
        if self._torque >= self._calibration.brake_torque_limit:
            self._saturation = -1
        else:
            # Drive force withheld by `brakes_only` must not be made up for once the throttle works again.
            self._saturation = 1 if brakes_only and force > 0.0 else 0
        return Pedals(self._torque, 0.0, min(acceleration, 0.0) if brakes_only else acceleration)
