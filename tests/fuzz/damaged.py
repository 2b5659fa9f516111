"""NCOM packets whose contents were damaged in several bytes while all three sums are right: what does the gate trust?

A run is 20 s of the simulated receiver, noise and all, on a random drive over hills, 2000 packets. One packet in fifty
is damaged in two to eight bytes: next to each other, anywhere, or within one field, which is the hardest to see; then
its sums are made right. The next five are true. The decoder of the damaged stream and the trust gate behind it are
compared with a decoder of the true stream, fix by fix. A trusted fix is wrong where anything that one packet says
differs from the true one; `quality` is what travels in status channels, which stays wrong until the channel's next
turn.

Invariants:

 1. No wrong fix is trusted that is farther off than `BOUNDS` in anything.
 2. A packet that is damaged in what is neither its time, status, position, horizontal velocity, heading nor status
    channel keeps no true fix out; any other does for 1.05 s at most.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tests.fuzz.invariant import Violation, hold
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.plant.receiver import PERIOD, ReceiverParameters, SimulatedReceiver
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Fix, Point, Pose

FIXES: Final = 2000  # of a run
EVERY: Final = 50  # packets, one of which is damaged, on average
SPARED: Final = 5  # packets after a damaged one
BEGUN: Final = 100  # packets before the first
SETTLED: Final = 105  # packets after which nothing is left of any damage: half a second of drift, and then it settles
EPOCH: Final = 1_460_000_000.0
LOT: Final = "+proj=tmerc +lat_0=40.31 +lon_0=-83.55 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
EARTH_RADIUS: Final = 6_371_000.0
SUMS: Final = (22, 61, 71)
#: Bytes of a packet's fields: time, acceleration, yaw rate, latitude, longitude, altitude, velocities, angles, channel.
FIELDS: Final = (
    (1, 3), (3, 6), (18, 21), (23, 31), (31, 39), (39, 43), (43, 46), (46, 49), (49, 52), (52, 55), (55, 58), (58, 61),
    (63, 71),
)  # fmt: skip
#: After a damage in one of these alone a true fix may be kept out: jumps settle, and a channel speaks until its next
#: turn. All others leave no trace.
LASTING: Final = frozenset({1, 2, *range(21, 39), *range(43, 49), *range(52, 55), *range(62, 71)})
#: Farthest off that a trusted fix may be: what the gate allows 20 ms after the fix before, and the receiver's noise.
BOUNDS: Final = {
    "time [s]": 0.0201, "position [m]": 0.35, "altitude [m]": 0.51, "velocity [m/s]": 0.90,
    "vertical velocity [m/s]": 0.75, "heading [rad]": 0.062, "pitch [rad]": 0.032, "roll [rad]": 0.031,
    "yaw rate [rad/s]": 0.32, "acceleration [m/s2]": 12.3, "quality": math.inf,
}  # fmt: skip
QUALITIES: Final = ("locked", "quality", "position_sigma", "velocity_sigma", "heading_sigma", "differential_age")


@dataclass(slots=True)
class Tally:
    """What became of it all."""

    fixes: int = 0  #: that the decoder of the damaged stream gave
    damaged: int = 0  #: packets
    given: int = 0  #: wrong fixes out of the decoder
    trusted: int = 0  #: wrong fixes that the gate trusted, quality not counted
    kept_out: int = 0  #: true fixes that were not trusted
    stops: int = 0  #: times that no fix was trusted for longer than a drive may go on
    wrong: dict[str, int] = field(default_factory=lambda: dict.fromkeys(BOUNDS, 0))  #: among the trusted
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(BOUNDS, 0.0))  #: among the trusted


ALL: Final = Tally()  #: of this process's runs


class _Hills:
    """A random drive: speed, yaw rate and grade wander, all as smooth as a car."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self._x = self._y = self._climbed = self._yaw_rate = self._acceleration = self._grade = 0.0
        self._heading, self._speed = chance.uniform(-3.0, 3.0), chance.choice((0.0, 2.0, 8.0, 15.0))
        self._wanted = (0.0, 0.0, 0.0)  # acceleration, yaw rate, grade

    def step(self, number: int) -> tuple[Pose, float]:
        """The pose of a packet, and how far the car has climbed."""
        if number % 200 == 0:
            one = self._chance.uniform
            self._wanted = (one(-4.0, 3.0), one(-0.4, 0.4), one(-0.1, 0.1))
        acceleration, yaw_rate, grade = self._wanted
        if not 0.0 < self._speed + PERIOD * acceleration < 20.0:
            acceleration = 0.0
        self._acceleration += 0.05 * (acceleration - self._acceleration)
        self._yaw_rate += 0.05 * ((yaw_rate if self._speed > 1.0 else 0.0) - self._yaw_rate)
        self._grade += 0.02 * (grade - self._grade)
        self._speed = max(self._speed + PERIOD * self._acceleration, 0.0)
        self._heading = math.remainder(self._heading + PERIOD * self._yaw_rate, math.tau)
        self._x += PERIOD * self._speed * math.cos(self._heading)
        self._y += PERIOD * self._speed * math.sin(self._heading)
        self._climbed += PERIOD * self._speed * math.tan(self._grade)
        pose = Pose(
            number * PERIOD, Point.REAR_AXLE, self._x, self._y, self._heading, self._speed, 0.0, self._yaw_rate,
            self._acceleration, self._grade,
        )  # fmt: skip
        return pose, self._climbed


def damage(chance: random.Random, packet: bytes) -> tuple[bytes, frozenset[int]]:
    """The packet with several bytes changed under right sums, and which."""
    count, kind = chance.randrange(2, 9), chance.randrange(4)
    if kind == 0:
        start = chance.randrange(1, 71)
        places = range(start, min(start + count, 71))
    elif kind == 1:
        places = sorted(chance.sample(range(1, 71), count))
    else:
        begin, end = chance.choice(FIELDS)
        places = sorted(chance.sample(range(begin, end), min(count, end - begin)))
    changed = bytearray(packet)
    touched = frozenset(place for place in places if place not in SUMS)
    for place in touched:
        changed[place] ^= chance.randrange(1, 256)
    for end in SUMS:
        changed[end] = sum(changed[1:end]) & 0xFF
    return bytes(changed), touched


def errors(fix: Fix, true: Fix) -> dict[str, float]:
    """How far a fix is off in what one packet says; 0 where it says the same."""
    north = (fix.latitude - true.latitude) * EARTH_RADIUS
    east = math.remainder(fix.longitude - true.longitude, math.tau) * EARTH_RADIUS * math.cos(true.latitude)
    said = {
        "time [s]": fix.time - true.time,
        "position [m]": math.hypot(north, east),
        "altitude [m]": fix.altitude - true.altitude,
        "velocity [m/s]": math.hypot(fix.velocity_north - true.velocity_north, fix.velocity_east - true.velocity_east),
        "vertical velocity [m/s]": fix.velocity_down - true.velocity_down,
        "heading [rad]": math.remainder(fix.heading - true.heading, math.tau)
        if math.isfinite(fix.heading)
        else math.nan,
        "pitch [rad]": fix.pitch - true.pitch,
        "roll [rad]": fix.roll - true.roll,
        "yaw rate [rad/s]": fix.yaw_rate - true.yaw_rate,
        "acceleration [m/s2]": fix.acceleration - true.acceleration,
        "quality": float(any(getattr(fix, name) != getattr(true, name) for name in QUALITIES)),
    }
    return {name: abs(value) for name, value in said.items()}


class _Run:
    def __init__(self, seed: int, tally: Tally) -> None:
        self._chance = random.Random(f"damaged {seed}")
        self._tally, self._decoder, self._true = tally, Decoder(), Decoder()
        self._gate = TrustGate(DRIVE, EPOCH)
        self._damaged_at, self._lasting_at, self._stopped = 0, -FIXES, False

    def drive(self, seed: int) -> None:
        parameters = ReceiverParameters(Mounting(1.3, 0.2))
        receiver = SimulatedReceiver(parameters, MapFrame(LOT), EPOCH, np.random.SeedSequence(seed))
        hills = _Hills(self._chance)
        for number in range(FIXES):
            pose, climbed = hills.step(number)
            receiver.measure(pose, climbed)
            for received, packet in receiver.arrived(pose.time + 1.0):
                self._hear(number, received, packet)

    def _hear(self, number: int, received: float, packet: bytes) -> None:
        true = self._true.feed(packet, received)
        due = number >= BEGUN and number > self._damaged_at + SPARED
        touched: frozenset[int] = frozenset()
        if due and self._chance.random() < 1.0 / (EVERY - SPARED):
            packet, touched = damage(self._chance, packet)
            self._tally.damaged += 1
            self._damaged_at = number
            if touched & LASTING:
                self._lasting_at = number
        for fix in self._decoder.feed(packet, received):
            self._judge(number, received, fix, true[0], touched)
        stale = bool(self._gate.stale(received)) and number >= BEGUN
        self._tally.stops += stale and not self._stopped
        self._stopped = stale

    def _judge(self, number: int, now: float, fix: Fix, true: Fix, touched: frozenset[int]) -> None:
        tally, off = self._tally, errors(fix, true)
        reasons = self._gate.step(now, fix).reasons
        wrong = any(value != 0.0 for name, value in off.items() if name != "quality")
        tally.fixes += 1
        tally.given += wrong
        if not touched and reasons and number >= BEGUN:
            tally.kept_out += 1
            hold(2, number - self._lasting_at <= SETTLED, (now, reasons, fix))
        if reasons:
            return
        tally.trusted += wrong
        for name, value in off.items():
            tally.wrong[name] += value != 0.0
            tally.worst[name] = max(tally.worst[name], value)


def reported(tally: Tally) -> list[str]:
    """The tally in lines."""
    lines = [
        f"{tally.fixes} fixes of {tally.damaged} damaged packets and the true ones between; {tally.given} fixes were "
        f"wrong, {tally.trusted} of them trusted; {tally.kept_out} true ones kept out, {tally.stops} stops"
    ]
    return lines + [
        f"  {name:24s} {tally.wrong[name]:6d} trusted, farthest off {tally.worst[name]:.6g}" for name in BOUNDS
    ]


def run(seed: int, tally: Tally = ALL) -> int:
    """Try one drive; how many packets that were. Raises Violation, which says where."""
    try:
        _Run(seed, tally).drive(seed)
        for name, bound in BOUNDS.items():
            hold(1, tally.worst[name] <= bound, (name, tally.worst[name], bound))
    except Violation as violation:
        raise Violation(f"invariant {violation}\n  seed {seed}") from violation
    return FIXES
