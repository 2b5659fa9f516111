"""Counts the stops that the gateway makes of itself over hours of driving in which nothing is wrong, by their reason.

Usage: PYTHONPATH=. python benchmarks/false_alarms.py [--hours H] [--noise FACTOR] [--seed S] [--processes N]
       [--smoke]

The whole pipeline drives the simulated vehicle in closed loop, as fast as it goes: bytes of the receiver, trust gate,
predictor, a path follower and the gateway; there is no street, and the way to rest is left out, which stops a car only
where it leaves its lot. Every leg has a road, a car and a driver of its own, drawn from the ranges below. Prints;
changes nothing.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from controllers import follow_and_stop
from tests import vehicles
from tests.vehicle.closed_loop import ClosedLoop
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.path import ReferencePath
from vve_sumo.plant.car import CarParameters
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, ControlCommand, Observation

LEG = 180.0  # [s]
ROAD = 2500.0  # longer than a leg [m]
# How far the true car lies from what is declared of it, either way.
MASS, BRAKE_GAIN, WHEEL_RADIUS = 0.15, 0.10, 0.01
GRADE = math.atan(0.03)
WHEEL_BIAS, MISALIGNMENT, GYRO_BIAS = math.radians(1.0), math.radians(0.2), 0.01  # [rad], [rad], [rad/s]
SPEEDS = (3.0, 13.0)  # [m/s]
CREEPING = (0.4, 2.0)  # [m/s]
#: what a driver does next, and how often
PHASES = (("cruise", 0.45), ("creep", 0.12), ("stop", 0.2), ("hard_stop", 0.08), ("emergency", 0.05), ("idle", 0.1))
BRAKING = {"stop": (0.8, 2.5), "hard_stop": (2.5, 3.5), "emergency": (4.0, 9.0), "idle": (0.8, 2.0)}  # [m/s2]
STANDS = {"stop": (0.5, 5.0), "hard_stop": (0.5, 5.0), "emergency": (1.0, 5.0), "idle": (10.0, 60.0)}  # [s]
LONGEST_STOP = 30.0  # [s]


class NoWayToRest(Pipeline):
    """The pipeline without the way to rest, a fifth of what a tick costs."""

    def prepare(self, time: float, steering: float) -> None:
        """Find nothing."""
        self._prepared_for = time


class Driver:
    """Follows its path at changing speeds: cruises, creeps, stops gently and hard, stands for a while, starts again."""

    def __init__(self, parameters: CarParameters, generator: np.random.Generator) -> None:
        self._follower = follow_and_stop.make(parameters.vehicle, {})
        self._random = generator
        self._phase, self._value, self._until = "cruise", 8.0, 20.0
        self._stood = math.inf  # since when
        self.phases: Counter[str] = Counter()

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation."""
        if observation.time >= self._until:
            self._next(observation.time)
        if self._phase in ("cruise", "creep"):
            return self._follower.step(replace(observation, desired_speed=self._value))
        if self._stood == math.inf and abs(observation.pose.speed) < 0.05:
            self._stood = observation.time
            self._until = observation.time + self._random.uniform(*STANDS[self._phase])
        setpoint = self._follower.step(replace(observation, desired_speed=0.5))
        standing = self._stood < math.inf
        wanted = -1.0 if standing else -self._value
        return replace(setpoint, acceleration=wanted, emergency=self._phase == "emergency" and not standing)

    def _next(self, now: float) -> None:
        names, shares = zip(*PHASES, strict=True)
        self._phase, self._stood = str(self._random.choice(names, p=shares)), math.inf
        self.phases[self._phase] += 1
        if self._phase in BRAKING:
            self._value, self._until = self._random.uniform(*BRAKING[self._phase]), now + LONGEST_STOP
        else:
            speeds = SPEEDS if self._phase == "cruise" else CREEPING
            self._value, self._until = self._random.uniform(*speeds), now + self._random.uniform(4.0, 25.0)


@dataclass(slots=True)
class Tally:
    """What was driven, and what stopped it."""

    seconds: float = 0.0
    moving: float = 0.0  #: [s]
    driven: float = 0.0  #: [m]
    stops: Counter[str] = field(default_factory=Counter)  #: by the codes with which each began
    legs: list[str] = field(default_factory=list)  #: each stop with the leg that it was in
    phases: Counter[str] = field(default_factory=Counter)

    def add(self, other: Tally) -> None:
        """Take in another one."""
        self.seconds += other.seconds
        self.moving += other.moving
        self.driven += other.driven
        self.stops += other.stops
        self.legs += other.legs
        self.phases += other.phases


def road(generator: np.random.Generator) -> ReferencePath:
    """A road of straights and bends of 15 to 200 m radius, both ways, of smooth curvature."""
    bends = np.zeros(int(ROAD))
    s = 40
    while s < len(bends) - 100:
        length, radius = int(generator.uniform(15.0, 80.0)), generator.uniform(15.0, 200.0)
        turn = min(length / radius, 1.9)
        bends[s : s + length] = generator.choice([-1.0, 1.0]) * turn / length
        s += length + int(generator.uniform(10.0, 120.0))
    kernel = np.hanning(15)
    bends = np.convolve(bends, kernel / kernel.sum(), "same")
    heading = np.cumsum(bends)
    return ReferencePath.from_points(np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)))


def car(generator: np.random.Generator, noise: float) -> CarParameters:
    """A car as calibrated, but for what its declaration leaves open, with the imperfections that were measured."""

    def either_way(most: float) -> float:
        return float(generator.uniform(-most, most))

    parameters = vehicles.parameters(
        noise=noise,
        imperfections=vehicles.FUSION.measured,
        mass_factor=1.0 + either_way(MASS),
        brake_gain_factor=1.0 + either_way(BRAKE_GAIN),
        grade=either_way(GRADE),
        steering_wheel_bias=either_way(WHEEL_BIAS),
        heading_misalignment=either_way(MISALIGNMENT),
    )
    wheels = 1.0 + either_way(WHEEL_RADIUS)
    return replace(parameters, gyro_bias=either_way(GYRO_BIAS), wheel_radius_factor=wheels)


def leg(seed: int, number: int, noise: float) -> Tally:
    """Drive one leg; it ends early where the gateway stops."""
    generator = np.random.default_rng((seed, number))
    parameters = car(generator, noise)
    driver, tally = Driver(parameters, generator), Tally()
    loop = ClosedLoop(
        road(generator), 8.0, (), parameters, number, driver, deviation_limit=4.0, pipeline=NoWayToRest
    )  # fmt: skip
    engaged = False
    for ticked in loop.ticks():
        state, speed = ticked.status.state, ticked.truth.speed
        engaged |= state is ArmingState.ENGAGED
        tally.seconds, tally.driven = ticked.now, tally.driven + PERIOD * abs(speed)
        tally.moving += PERIOD * (speed != 0.0)
        if engaged and state is not ArmingState.ENGAGED:
            codes = "+".join(ticked.status.reasons)
            tally.stops[codes] += 1
            tally.legs.append(
                f"leg {number}, {ticked.now:.2f} s, {speed:.2f} m/s, {driver.phases}: {codes} {parameters}"
            )
        if ticked.now >= LEG or (engaged and state is not ArmingState.ENGAGED):
            break
    assert engaged, f"leg {number} never began: {ticked.status}"
    tally.phases += driver.phases
    return tally


def legs(seed: int, numbers: range, noise: float) -> Tally:
    """Drive some legs."""
    tally = Tally()
    for number in numbers:
        tally.add(leg(seed, number, noise))
    return tally


def drive(hours: float, noise: float, seed: int, processes: int) -> Tally:
    """Drive for so long at least."""
    count, size = math.ceil(hours * 3600.0 / LEG), 4
    portions = [range(first, min(first + size, count)) for first in range(0, count, size)]
    total = Tally()
    with ProcessPoolExecutor(processes) as crew:
        for tally in crew.map(legs, [seed] * len(portions), portions, [noise] * len(portions)):
            total.add(tally)
            print(f"{total.seconds / 3600.0:.2f} h, {dict(total.stops)}", file=sys.stderr, flush=True)
    return total


def reported(tally: Tally, noise: float) -> Iterator[str]:
    """The tally in words."""
    hours = tally.seconds / 3600.0
    yield f"{hours:.2f} h, {tally.moving / 3600.0:.2f} h moving, {tally.driven / 1000.0:.1f} km, noise x {noise:g}"
    yield f"phases: {', '.join(f'{name} {count}' for name, count in sorted(tally.phases.items()))}"
    yield f"stops: {sum(tally.stops.values())}, {sum(tally.stops.values()) / hours:.2f} an hour"
    for codes, count in tally.stops.most_common():
        yield f"  {codes}: {count}, {count / hours:.2f} an hour"


def main() -> None:
    """Drive and tell."""
    parser = argparse.ArgumentParser(description="stops of the gateway where nothing is wrong")
    parser.add_argument("--hours", type=float, default=10.0, help="of driving")
    parser.add_argument("--noise", type=float, default=1.0, help="factor on the receiver's and the gyroscope's errors")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--each", action="store_true", help="tell each stop")
    parser.add_argument("--smoke", action="store_true", help="a single leg, only to see that it runs")
    wanted = parser.parse_args()
    begun = time.monotonic()
    tally = drive(LEG / 3600.0 if wanted.smoke else wanted.hours, wanted.noise, wanted.seed, wanted.processes)
    took = time.monotonic() - begun
    print("\n".join(reported(tally, wanted.noise)))
    if wanted.each:
        print("\n".join(tally.legs))
    print(f"{tally.seconds / took:.0f} times real time with {wanted.processes} process(es)")


if __name__ == "__main__":
    main()
