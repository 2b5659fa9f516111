"""A car on a steady circle and its receiver, compared by the plausibility check; a test adds errors to either."""

from __future__ import annotations

import math
from dataclasses import replace

from tests.setpoints import setpoint as complete
from tests.vehicle.car import CALIBRATION, FUSION
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility

STEP = 0.02  # [s]
TOLERANCE = 0.02  # of the wheels' scale, the calibration's
#: Lateral speed of the rear axle over speed squared and yaw rate: its slip angle over the lateral acceleration, which
#: is its share of the mass over its cornering stiffness [s2/m].
SLIP = 1690.0 * 1.27 / (2.85 * 100_740.0)
UNDERSTEER = 1690.0 / 2.85 * (1.58 / 120_000.0 - 1.27 / 100_740.0)


class Drive:
    """A car on a steady circle, its receiver, and what a test adds to either."""

    def __init__(
        self,
        speed: float = 10.0,
        yaw_rate: float = 0.0,
        heading: float = 0.7,
        learnt: bool = True,
        settling: float = 3.0,
    ) -> None:
        self.subject = Plausibility(FUSION, replace(CALIBRATION, wheel_speed_tolerance=TOLERANCE))
        self.speed, self.yaw_rate, self.heading = speed, yaw_rate, heading
        self.x, self.y = 100.0, -50.0
        self.now, self.ticks = 0.0, 0
        if learnt:
            self.stand(0.5)
        self.run(settling)

    def stand(self, duration: float, yaw_rate: float = 0.0) -> None:
        for _ in range(round(duration / STEP)):
            self._tick()
            self.subject.step(self.now, STEP, CarMotion(0.0, yaw_rate, 0.0, (0.0,), math.nan, True), None, False)

    def step(self, car: dict | None = None, receiver: dict | None = None, **how: float) -> list[str]:
        """Drive for a step; `car` and `receiver` are added to what either says, or stand in its place."""
        self._tick()
        turn = self.yaw_rate * STEP
        middle, driven = self.heading + 0.5 * turn, self.speed * STEP
        across = -SLIP * self.speed**2 * self.yaw_rate * STEP
        self.x += driven * math.cos(middle) - across * math.sin(middle)
        self.y += driven * math.sin(middle) + across * math.cos(middle)
        self.heading += turn
        said = {
            "speed": self.speed,
            "yaw_rate": self.yaw_rate + (0.0 if how.get("still") else 1e-9 * self.ticks),  # no gyroscope is still
            "steering": self.angle(),
            "wheels": (float(self.ticks),),
            "commanded_steering": math.nan,
            "stands": False,
        }
        motion = CarMotion(
            **{**said, **{k: v if k in ("wheels", "stands") else said[k] + v for k, v in (car or {}).items()}}
        )
        setpoint = None
        if not how.get("silent"):
            values = {"x": self.x, "y": self.y, "heading": self.heading, "speed": self.speed, "yaw_rate": self.yaw_rate}
            for name, more in (receiver or {}).items():
                values[name] += more
            setpoint = complete(0.0, 0.0, time=self.now, **values)
        return self.subject.step(self.now, how.get("elapsed", STEP), motion, setpoint, how.get("fresh", True))

    def angle(self) -> float:
        """Road-wheel angle that drives the circle [rad]."""
        curvature = self.yaw_rate / max(self.speed, 1e-9)
        return math.atan(2.85 * curvature * (1.0 + UNDERSTEER * self.speed**2 / 2.85))

    def _tick(self) -> None:
        self.ticks += 1
        self.now = self.ticks * STEP

    def run(self, duration: float, **what: object) -> None:
        for _ in range(round(duration / STEP)):
            assert self.step(**what) == []

    def until(self, within: float = 0.9, **what: object) -> tuple[float, list[str]]:
        """After which time something is said, and what; infinite for nothing within that time."""
        for number in range(round(within / STEP)):
            reasons = self.step(**what)
            if reasons:
                return number * STEP, reasons
        return math.inf, []

    def ahead(self, metres: float) -> dict[str, float]:
        return {"x": metres * math.cos(self.heading), "y": metres * math.sin(self.heading)}

    def left(self, metres: float) -> dict[str, float]:
        return {"x": -metres * math.sin(self.heading), "y": metres * math.cos(self.heading)}
