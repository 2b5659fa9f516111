"""Drives along recorded waypoints and stops before what stands in the way: what the brains beside it have in common.

It knows fixes and scans in SI units; the wires that they came over are read elsewhere.
"""

from __future__ import annotations

import argparse
import csv
import math
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from vve_sumo.pose.ncom import Decoder
from vve_sumo.values import Fix
from vve_sumo.wire.datagrams import RadarDatagram, SetpointDatagram, decode_radar, encode_setpoint
from vve_sumo.wire.signature import signed, without_tag

EARTH = 6_371_000.0  # [m]
WHEELBASE, BUMPER = 2.85, 3.84  # [m]
AHEAD, LEFT = 0.30, 0.20  # of the rear axle lies the receiver [m]
LOOKAHEAD, SHORTEST = 0.5, 3.0  # [s], [m]
HALF_WIDTH, GAP, COMFORT, HARDEST = 1.3, 5.5, 1.8, 6.0  # [m], [m], [m/s2], [m/s2]
LAG = 0.1  # of the brakes [s]
BLIND, SAME_TICK = 2.0, 0.05  # braking without a radar [m/s2], fix and datagram apart [s]
MAX_AGE, SEQUENCES = 0.3, 1 << 32  # of a scan [s]; after so many a sequence begins again
SIDEWAYS, SLOWING, REACH = 1.2, 1.0, 5  # [m/s2] in bends, [m/s2] before them, waypoints on either side


class Target(Protocol):
    """What a radar says of one object, seen from the middle of the front bumper."""

    @property
    def range(self) -> float:
        """Distance [m]."""

    @property
    def azimuth(self) -> float:
        """Direction [rad], left positive."""

    @property
    def range_rate(self) -> float:
        """Radial speed [m/s], opening positive."""


class Seen(Protocol):
    """What a radar says at one moment; a `RadarDatagram` is one."""

    @property
    def time(self) -> float:
        """Now, GNSS time [s]."""

    @property
    def measured(self) -> float:
        """When the scan was made, GNSS time [s]."""

    @property
    def speed(self) -> float:
        """Of the car [m/s]."""

    @property
    def targets(self) -> Sequence[Target]:
        """The objects of the scan."""


@dataclass(frozen=True)
class Scan:
    """A scan of a radar that says no more than its objects; the car's speed comes from elsewhere."""

    time: float  #: now, GNSS time [s]
    measured: float  #: when it was made, GNSS time [s]
    speed: float  #: of the car [m/s]
    targets: Sequence[Target]


class Brain:
    """Path following and stopping for what stands in the way."""

    def __init__(self, waypoints: list[tuple[float, float]], speed: float) -> None:
        """Waypoints are latitude and longitude [rad]; `speed` is kept where nothing forbids it [m/s]."""
        self._origin = waypoints[0]
        self._path = [self._plane(*point) for point in waypoints]
        self._speeds = self._slowed(speed)
        self._nearest = 0
        self._stopping = False
        self._sequence: int | None = None  # of the newest datagram that was believed

    def believes(self, beat: RadarDatagram) -> bool:
        """Whether a datagram may be acted on: it is valid, newer than the last, and its scan is not too old."""
        if not (self.newer(beat) and self.valid(beat) and self.age(beat) <= MAX_AGE):
            return False
        self._sequence = beat.sequence
        return True

    def newer(self, beat: RadarDatagram) -> bool:
        """Whether a datagram's sequence is newer than that of the last that was believed."""
        return self._sequence is None or 0 < (beat.sequence - self._sequence) % SEQUENCES < SEQUENCES // 2

    def timely(self, fix: Fix, beat: RadarDatagram) -> bool:
        """Whether a fix and a datagram are of the same time: the fix tells how late the datagram is."""
        return abs(fix.time - beat.time) <= SAME_TICK

    def valid(self, beat: RadarDatagram) -> bool:
        """Whether a datagram says that it is valid."""
        return beat.valid

    def age(self, seen: Seen) -> float:
        """Return how old a scan is [s]."""
        return seen.time - seen.measured

    def range_rate(self, target: Target) -> float:
        """Return the radial speed of a target [m/s], opening positive."""
        return target.range_rate

    def azimuth(self, target: Target) -> float:
        """Return the direction of a target [rad], left positive."""
        return target.azimuth

    def _plane(self, latitude: float, longitude: float) -> tuple[float, float]:
        north = EARTH * (latitude - self._origin[0])
        return EARTH * math.cos(self._origin[0]) * (longitude - self._origin[1]), north

    def _rear_axle(self, fix: Fix) -> tuple[float, float]:
        x, y = self._plane(fix.latitude, fix.longitude)
        cos, sin = math.cos(fix.heading), math.sin(fix.heading)
        return x - AHEAD * cos + LEFT * sin, y - AHEAD * sin - LEFT * cos

    def _slowed(self, speed: float) -> list[float]:
        """Return the speed at each waypoint: slow enough for its bend, and for the bends to come."""
        path, speeds = self._path, [speed] * len(self._path)
        for n in range(REACH, len(path) - REACH):
            (ax, ay), (bx, by), (cx, cy) = path[n - REACH], path[n], path[n + REACH]
            turn = math.atan2(cy - by, cx - bx) - math.atan2(by - ay, bx - ax)
            turn = abs((turn + math.pi) % math.tau - math.pi)
            curvature = turn / max(0.5 * (math.hypot(bx - ax, by - ay) + math.hypot(cx - bx, cy - by)), 0.1)
            speeds[n] = min(speed, math.sqrt(SIDEWAYS / max(curvature, 1e-6)))
        for n in range(len(path) - 2, -1, -1):
            step = math.hypot(path[n + 1][0] - path[n][0], path[n + 1][1] - path[n][1])
            speeds[n] = min(speeds[n], math.sqrt(speeds[n + 1] ** 2 + 2.0 * SLOWING * step))
        return speeds

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return steering [rad] and acceleration [m/s2] for a valid fix and radar datagram."""
        x, y = self._rear_axle(fix)
        goal = self._goal(x, y, max(SHORTEST, LOOKAHEAD * radar.speed))
        far = math.hypot(goal[0] - x, goal[1] - y)
        aside = math.atan2(goal[1] - y, goal[0] - x) - fix.heading
        curvature = 2.0 * math.sin(aside) / max(far, 1.0)
        return math.atan(WHEELBASE * curvature), self._acceleration(radar, curvature)

    def _goal(self, x: float, y: float, ahead: float) -> tuple[float, float]:
        ranges = [math.hypot(px - x, py - y) for px, py in self._path[self._nearest : self._nearest + 200]]
        self._nearest += ranges.index(min(ranges))
        for px, py in self._path[self._nearest :]:
            if math.hypot(px - x, py - y) >= ahead:
                return px, py
        return self._path[-1]

    def _acceleration(self, radar: Seen, curvature: float) -> float:
        gap, age = math.inf, self.age(radar)
        for target in radar.targets:
            azimuth = self.azimuth(target)
            along, aside = target.range * math.cos(azimuth), target.range * math.sin(azimuth)
            # What moves with the road is left to others: this brain stops for what stands.
            stands = abs(self.range_rate(target) + radar.speed * math.cos(azimuth)) < 2.0
            if stands and abs(aside - 0.5 * curvature * (along + BUMPER) ** 2) < HALF_WIDTH:
                gap = min(gap, along - radar.speed * (age + LAG))
        needed = radar.speed**2 / (2.0 * max(gap - GAP, 0.1))
        self._stopping |= needed >= COMFORT
        if self._stopping and gap < math.inf:
            return -min(needed, HARDEST) if radar.speed > 0.05 else -1.0
        return max(-2.5, min(1.0, 0.8 * (self._speeds[min(self._nearest + 5, len(self._speeds) - 1)] - radar.speed)))


def listen(port: int) -> socket.socket:
    """Return a socket on a port of this machine."""
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", port))
    return end


def waypoints(file: Path) -> list[tuple[float, float]]:
    """Return latitude and longitude [rad] of every waypoint of a recorded route."""
    with file.open(encoding="utf-8") as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        return [(math.radians(float(r["latitude_deg"])), math.radians(float(r["longitude_deg"]))) for r in rows]


class Fixes:
    """The newest fix of a receiver that sends NCOM."""

    def __init__(self) -> None:
        self._decoder = Decoder()
        self._fix: Fix | None = None

    def feed(self, data: bytes) -> None:
        """Take a packet that has come."""
        self._fix = ([self._fix, *self._decoder.feed(data, 0.0)])[-1]

    @property
    def fix(self) -> Fix | None:
        """The newest fix where it is one to drive by, else None."""
        return self._fix if self._fix is not None and self._fix.locked else None


class Gnss:
    """The newest fix of a receiver that sends NCOM to a port of this machine."""

    def __init__(self, port: int) -> None:
        self.socket, self._fixes = listen(port), Fixes()
        self.socket.setblocking(False)

    def read(self) -> Fix | None:
        """Take what has come, and return the newest fix where it is one to drive by, else None."""
        while True:
            try:
                data = self.socket.recv(100)
            except BlockingIOError:
                return self._fixes.fix
            self._fixes.feed(data)


#: what a brain sees at a fix, in the tick of a radar datagram; None: it has no radar now
Look = Callable[[Fix, RadarDatagram], Seen | None]


class Answers:
    """Makes the setpoint that answers a radar datagram, where the brain believes it."""

    lifetime = 0.1  # of the setpoints [s]

    def __init__(self, brain: Brain, look: Look, key: bytes = b"") -> None:
        """With a `key`, datagrams that are not signed with it are not believed, and setpoints are signed."""
        self._brain, self._look, self._key = brain, look, key
        self._sequence, self._steering = 0, 0.0

    def to(self, data: bytes, fix: Fix | None) -> bytes | None:
        """Return the bytes of the setpoint that answers a datagram; without a radar it brakes. None: no answer."""
        body = without_tag(data, self._key)
        beat = None if body is None else decode_radar(body)
        if beat is None or fix is None or not self._brain.timely(fix, beat) or not self._brain.believes(beat):
            return None
        seen, acceleration = self._look(fix, beat), -BLIND
        if seen is not None:
            self._steering, acceleration = self._brain.answer(fix, seen)
        self._sequence += 1
        asked = SetpointDatagram(
            self._sequence, beat.sequence, beat.time, self.lifetime, self._steering, acceleration
        )  # fmt: skip
        sent = encode_setpoint(asked)
        return signed(sent, self._key) if self._key else sent


def answer(answers: Answers, gnss: int, radar: int, setpoints: int) -> None:
    """Answer the radar datagrams that come to a port of this machine, by the fixes that come to another, to a third.

    The datagram is the beat of the setpoints, whatever the brain sees by: a setpoint names the one that it answers.
    """
    receiver, beats = Gnss(gnss), listen(radar)
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.bind(("127.0.0.1", 0))
    while True:
        data = beats.recv(2048)
        setpoint = answers.to(data, receiver.read())  # the fix of the same tick was sent before
        if setpoint is not None:
            out.sendto(setpoint, ("127.0.0.1", setpoints))


def answer_by_radar(make: Callable[[argparse.Namespace], Brain], description: str | None) -> None:
    """Run a brain that sees by the radar datagram, with the arguments of the command line."""
    given = arguments(description).parse_args()
    answer(Answers(make(given), lambda _fix, radar: radar, given.key), given.gnss, given.radar, given.setpoints)


def read_key(file: str) -> bytes:
    """Return the key in a file of hexadecimal digits."""
    return bytes.fromhex(Path(file).read_text(encoding="ascii"))


def arguments(description: str | None) -> argparse.ArgumentParser:
    """Return what every brain that answers with setpoints can be told."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("waypoints", type=Path)
    parser.add_argument("--gnss", type=int, default=5001, help="port of NCOM")
    parser.add_argument("--radar", type=int, default=5002, help="port of the radar datagrams")
    parser.add_argument("--setpoints", type=int, default=5003, help="port that the setpoints go to")
    parser.add_argument("--key", type=read_key, default=b"", metavar="FILE", help="the rig's brain.key_file")
    parser.add_argument("--speed", type=float, default=11.176, help="[m/s]")
    return parser
