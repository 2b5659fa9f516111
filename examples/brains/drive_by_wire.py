"""An external controller: NCOM over UDP and a Delphi ESR over CAN in, the car's own command frames out.

    python drive_by_wire.py WAYPOINTS.csv [--gnss PORT] [--esr INTERFACE:CHANNEL] [--car INTERFACE:CHANNEL]

It commands a Dataspeed drive-by-wire controller by itself, 50 times a second: it takes the car over when its sensors
are valid for the first time, drives as stop_for_parked.py beside it, brakes while a sensor is not valid or too old, and
stops for good when that lasts. At rest it shifts to park and lets go. Nobody limits what it sends: this is the paper's
architecture.
"""

from __future__ import annotations

import argparse
import contextlib
import enum
import math
import os
import select
import time
from pathlib import Path

from driving import Brain, Gnss, waypoints
from esr_radar import EsrRadar, open_bus

from vve_sumo.errors import RigError
from vve_sumo.vehicle.dataspeed.interface import make
from vve_sumo.vehicle.interface import ActuationCommand, Gear, GearState, WheelSpeeds, YawRate

PRIORITY = 20  # real-time, where the system allows it
PERIOD = 0.02  # of the command frames [s]
GNSS_LIFETIME = 0.1  # of a fix, which comes every 20 ms [s]
GRACE = 0.3  # the brain brakes at once without a sensor, and after so long it stops for good [s]
STOP, HARDEST = 2.5, 6.0  # braking without a sensor, and at most [m/s2]
# The car: mass [kg], brake torque for each m/s2 [kg m], largest force [N], power [W], throttle, torque [N m];
# rolling radius of a wheel [m], steering ratio, limit [rad] and rate [rad/s] of the steering wheel.
MASS, BRAKE, FORCE, POWER, THROTTLE, TORQUE = 1690.0, 550.0, 6500.0, 120_000.0, 0.6, 3250.0
RADIUS, RATIO, WHEEL_LIMIT, WHEEL_RATE = 0.3245, 14.8, 8.0, 8.7
HOLD = 1100.0  # holds the car at rest [N m]
GAIN, SHARE = 3.0, 0.5  # [1/s] of the speed's error, which counts up to [m/s]
REST = 0.05  # slower is standing [m/s]


class Phase(enum.Enum):
    """How far the drive is."""

    WAITING = enum.auto()  # for sensors that are valid
    DRIVING = enum.auto()
    STOPPING = enum.auto()  # a sensor is not valid
    OVER = enum.auto()  # in park, let go


class Car:
    """The drive-by-wire controller: what it reports, and what it is told."""

    def __init__(self, place: str) -> None:
        self.bus, self._interface = open_bus(place), make({"variant": "dbw1_2024"})
        self.gear, self.speed, self.yaw_rate = Gear.NONE, 0.0, 0.0
        self._wanted_speed, self._fresh = 0.0, True

    def listen(self) -> None:
        """Take what the car reports."""
        for frame in self.bus.drain():
            reports = self._interface.decode(frame)
            for report in reports if isinstance(reports, tuple) else ():
                self._take(report)

    def _take(self, report: object) -> None:
        if isinstance(report, WheelSpeeds):
            self.speed = 0.5 * RADIUS * (report.rear_left + report.rear_right)
        elif isinstance(report, YawRate):
            self.yaw_rate = report.yaw
        elif isinstance(report, GearState):
            self.gear = report.gear

    def drive(self, steering: float, acceleration: float) -> None:
        """Ask for a road-wheel angle [rad] and an acceleration [m/s2]; shift to drive first."""
        if self.gear is not Gear.DRIVE:
            self._send(HOLD, 0.0, steering, Gear.DRIVE)
            return
        if acceleration <= 0.0 and self.speed < REST:
            self._wanted_speed = 0.0
            self._send(HOLD, 0.0, steering, Gear.NONE)
            return
        wanted = self._wanted_speed + acceleration * PERIOD
        self._wanted_speed = min(max(wanted, self.speed - SHARE), self.speed + SHARE)
        force = MASS * (acceleration + GAIN * (self._wanted_speed - self.speed)) + 200.0 + 0.4 * self.speed**2
        throttle = min(max(force, 0.0) / min(FORCE, POWER / max(self.speed, 1.0)), THROTTLE)
        self._send(min(max(-force, 0.0) * BRAKE / MASS, TORQUE), throttle, steering, Gear.NONE)

    def stop(self, steering: float) -> bool:
        """Brake to rest, and shift to park; whether the car is in park."""
        standing = self.speed < REST
        torque = HOLD if standing else STOP * BRAKE + 200.0
        self._send(torque, 0.0, steering, Gear.PARK if standing else Gear.NONE)
        return self.gear is Gear.PARK and standing

    def let_go(self) -> None:
        """Send a command that enables nothing."""
        self._send(0.0, 0.0, 0.0, Gear.NONE, enable=False)

    def _send(self, torque: float, throttle: float, steering: float, gear: Gear, *, enable: bool = True) -> None:
        angle = min(max(steering * RATIO, -WHEEL_LIMIT), WHEEL_LIMIT)
        clear, self._fresh = self._fresh and enable, self._fresh and not enable
        command = ActuationCommand(torque, throttle, angle, WHEEL_RATE, gear, enable, clear)
        for frame in self._interface.encode(command):
            self.bus.send(frame)


class Drive:
    """One drive, from the first valid sensors until the brain has let go of the car."""

    def __init__(self, brain: Brain, gnss: Gnss, radar: EsrRadar, car: Car) -> None:
        self._brain, self._gnss, self._radar, self._car = brain, gnss, radar, car
        self._phase, self._steering, self._released = Phase.WAITING, 0.0, 0
        self._fix_time, self._fix_came, self._seen = math.nan, -math.inf, -math.inf

    def step(self, now: float) -> bool:
        """Read all sensors, command the car, and tell the radar how it moves; whether the drive goes on."""
        self._car.listen()
        self._radar.listen(now)
        wanted = self._wanted(now)
        self._seen = now if wanted is not None else self._seen
        if self._phase is Phase.WAITING and wanted is not None:
            print("sensors valid: the brain takes the car over", flush=True)
            self._phase = Phase.DRIVING
        elif self._phase is Phase.DRIVING and now - self._seen > GRACE:
            print(f"sensors not valid: the brain stops, from {self._car.speed:.1f} m/s", flush=True)
            self._phase = Phase.STOPPING
        self._command(wanted)
        self._radar.tell(self._car.speed, self._car.yaw_rate)
        return self._released < 10

    def _wanted(self, now: float) -> tuple[float, float] | None:
        """Return steering [rad] and acceleration [m/s2]; None where a sensor is not valid, or too old."""
        fix = self._gnss.read()
        if fix is not None and fix.time != self._fix_time:
            self._fix_time, self._fix_came = fix.time, now
        if fix is None or now - self._fix_came > GNSS_LIFETIME:
            return None
        scan = self._radar.scan(now, fix.time, self._car.speed)
        return None if scan is None else self._brain.answer(fix, scan)

    def _command(self, wanted: tuple[float, float] | None) -> None:
        if self._phase is Phase.DRIVING:
            self._steering, acceleration = wanted or (self._steering, -STOP)
            self._car.drive(self._steering, max(acceleration, -HARDEST))
        elif self._phase is Phase.STOPPING and self._car.stop(self._steering):
            self._phase = Phase.OVER
        elif self._phase is Phase.OVER:
            self._released += 1
            self._car.let_go()


def main() -> None:
    """Drive once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("waypoints", type=Path)
    parser.add_argument("--gnss", type=int, default=5001, help="port of NCOM")
    parser.add_argument("--esr", default="slcan:esr.pty", help="the radar's bus; slcan:esr.pty where nothing is said")
    parser.add_argument("--car", default="slcan:car.pty", help="the car's bus; slcan:car.pty where nothing is said")
    parser.add_argument("--speed", type=float, default=11.176, help="[m/s]")
    given = parser.parse_args()
    brain, gnss = Brain(waypoints(given.waypoints), given.speed), Gnss(given.gnss)
    with contextlib.suppress(PermissionError):  # what commands a car must not wait for a browser
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    radar, car = EsrRadar(open_bus(given.esr)), Car(given.car)
    drive = Drive(brain, gnss, radar, car)
    try:
        while drive.step(time.monotonic()):
            # A fix that comes is answered at once; without one the next step is due a period later.
            select.select([gnss.socket], [], [], PERIOD)
    except RigError as gone:
        print(f"the brain has lost the bus of the car: {gone}", flush=True)
        return
    finally:
        radar.bus.close()
        car.bus.close()
    print("the brain has let go of the car", flush=True)


if __name__ == "__main__":
    main()
