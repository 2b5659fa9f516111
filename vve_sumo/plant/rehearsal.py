"""Faults on purpose, at a stated time after the car first moves: what a drive must survive, tried before it happens.

It stands between the hardware-free car and the world and alters what passes; it knows no gateway, no clock and no I/O.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.plant.kit import HANDS_OFF, DriverInputs, Kit
from vve_sumo.values import Fix, Frame
from vve_sumo.vehicle import dbw
from vve_sumo.vehicle.messages import (
    BrakeCommand,
    BrakeKind,
    BrakeReport,
    SteeringCommand,
    SteeringReport,
    ThrottleReport,
    WheelSpeeds,
)

#: Kind of fault to plain words.
KINDS: Final[dict[str, str]] = {
    "pose_lost": "no fixes are sent",
    "pose_frozen": "position, heading and velocity stay what they were, while time goes on",
    "pose_jump": "the position lies to the left of the true one by value [m]",
    "pose_rtk_lost": "RTK falls back to float, with value [m] of standard deviation",
    "pose_backwards": "the receiver's clock is set back by value [s]",
    "pose_nan": "latitude is not a number",
    "pose_heading_invalid": "the receiver marks its heading as invalid",
    "pose_bursts": "packets are held back and let go together, every value [s]",
    "pose_garbage": "random bytes between the packets, and instead of every value-th one",
    "pose_duplicates": "every packet comes twice",
    "pose_reordered": "of every two packets the later one comes first",
    "pose_late": "packets come value [s] later",
    "bus_silent": "the bus is dead: reports are not heard, nor are commands",
    "reports_stale": "the car reports nothing any more but obeys",
    "another_writer": "someone else commands straight steering and value [N m] of brakes, with our identifiers",
    "brake_override": "the driver is on the brake: pedal sensor at value",
    "throttle_override": "the driver is on the throttle: pedal sensor at value",
    "steering_override": "the driver turns the wheel with value [N m]",
    "driver_touch": "the driver's foot is on the brake, short of an override: pedal sensor at value",
    "brake_fault": "the brake module reports one of its two channels as broken, and works",
    "throttle_fault": "the throttle module reports one of its two channels as broken, and works",
    "steering_fault": "the steering module reports one of its two buses as broken, and works",
    "report_malformed": "steering reports come one byte short",
    "wheel_speed_invalid": "the rear left wheel's speed is marked as invalid",
    "kit_dropout": "a module works no more, whatever it is told: 1 brake, 2 throttle, 3 steering, as value says",
}

#: What `value` is where none is given, and the range that it must lie in; the other kinds take none.
_VALUES: Final[dict[str, tuple[float, float, float]]] = {
    "pose_jump": (5.0, -1e4, 1e4),
    "pose_rtk_lost": (0.5, 0.0, 60.0),
    "pose_backwards": (1.0, 0.0, 20.0),
    "pose_bursts": (0.048, 0.01, 10.0),
    "pose_garbage": (5.0, 1.0, 1e6),
    "pose_late": (0.05, 0.0, 10.0),
    "another_writer": (1000.0, 0.0, 3250.0),
    "brake_override": (0.26, 0.15, 0.5),
    "throttle_override": (0.35, 0.15, 0.8),
    "steering_override": (5.0, -7.9, 7.9),
    "driver_touch": (0.20, 0.15, 0.22),
    "kit_dropout": (3.0, 1.0, 3.0),
}
_NO_VALUE: Final = (math.nan, math.nan, math.nan)

#: Reports that a fault changes: identifier to kind and the fields that it sets.
_REPORTED: Final[dict[int, tuple[str, dict[str, Any]]]] = {
    dbw.BRAKE_REPORT: ("brake_fault", {"fault_channel_1": True}),
    dbw.THROTTLE_REPORT: ("throttle_fault", {"fault_channel_1": True}),
    dbw.STEERING_REPORT: ("steering_fault", {"fault_bus_1": True}),
    dbw.WHEEL_SPEEDS: ("wheel_speed_invalid", {"rear_left": math.nan}),
}

STARTED: Final = 0.5  # the speed that starts the rehearsal's time [m/s]
RTK_FLOAT: Final = 5  # NCOM position mode
EARTH_RADIUS: Final = 6_371_000.0  # mean [m]; only turns metres of a jump into angles
ROUNDING: Final = 1e-9  # of times that are sums [s]
LONGEST_GARBAGE: Final = 150  # bytes; about two packets


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """One fault; raises ConfigError for a kind or a number that cannot be."""

    kind: str  #: a key of `KINDS`
    at: float  #: beginning, after the car first moves [s]
    duration: float  #: [s]
    value: float = math.nan  #: see `KINDS`; NaN is the kind's own

    def __post_init__(self) -> None:
        """Refuse what cannot be rehearsed."""
        if self.kind not in KINDS:
            raise ConfigError(f"rehearsal: kind must be one of {', '.join(sorted(KINDS))}; got {self.kind!r}")
        if not (0.0 <= self.at < math.inf and self.duration > 0.0):
            raise ConfigError(f"rehearsal {self.kind}: at must be 0 s or more and duration positive, got {self}")
        _usual, least, most = _VALUES.get(self.kind, _NO_VALUE)
        if not (least <= self.value <= most or math.isnan(self.value)):
            wanted = f"value must be {least:g} to {most:g}" if self.kind in _VALUES else "takes no value"
            raise ConfigError(f"rehearsal {self.kind}: {wanted}, got {self.value:g}")


class Rehearsal:
    """The faults of one drive; every method may be called at every step and does nothing while nothing is due.

    Times are drive times [s]. `seeds` are for the random bytes; `variant` is the kit's.
    """

    def __init__(
        self,
        rehearsed: Iterable[Rehearsed],
        seeds: np.random.SeedSequence,
        variant: dbw.Variant = dbw.Variant.DBW1_2024,
    ) -> None:
        self._rehearsed = tuple(rehearsed)
        self._variant = variant
        self._random = np.random.Generator(np.random.PCG64(seeds))
        self._moved = math.inf  # when the car first did
        self._frozen: Fix | None = None
        self._packets = 0
        self._kept: bytes | None = None  # waits for its successor to go first
        self._held: deque[tuple[float, bytes]] = deque()  # moment of release and packet
        self._counter = 0  # of the other writer
        self._foreign: list[Frame] = []  # what the other writer has said and the kit not yet heard

    def moves(self, time: float, speed: float) -> None:
        """Take note of the car's speed [m/s]; what is rehearsed is counted from when it first moves."""
        if abs(speed) > STARTED:
            self._moved = min(self._moved, time)

    def on_fix(self, fix: Fix) -> Fix | None:
        """Return what the receiver makes of a fix; its `time_received` says when it was measured."""
        time = fix.time_received
        if self._value("pose_lost", time) is not None:
            return None
        fix = self._freeze(time, fix)
        if (left := self._value("pose_jump", time)) is not None:
            fix = _beside(fix, left)
        if (sigma := self._value("pose_rtk_lost", time)) is not None:
            fix = replace(fix, position_mode=RTK_FLOAT, position_sigma=sigma)
        if (back := self._value("pose_backwards", time)) is not None:
            fix = replace(fix, time=fix.time - back)
        if self._value("pose_nan", time) is not None:
            fix = replace(fix, latitude=math.nan)
        if self._value("pose_heading_invalid", time) is not None:
            fix = replace(fix, heading=math.nan)
        return fix

    def on_packets(self, now: float, packets: Sequence[tuple[float, bytes]]) -> list[tuple[float, bytes]]:
        """Return what arrives by `now`, of `packets` (time of arrival and bytes) and of what was held back before."""
        for time, packet in packets:
            for piece in self._mangled(time, packet):
                # No packet overtakes the one before it: a network path is a queue.
                earliest = self._held[-1][0] if self._held else time
                self._held.append((max(earliest, self._release(time)), piece))
        arrived: list[tuple[float, bytes]] = []
        while self._held and self._held[0][0] <= now + ROUNDING:
            arrived.append(self._held.popleft())
        if not self._holding(now):
            arrived += [(now, piece) for _, piece in self._held]
            self._held.clear()
        return arrived

    def on_reports(self, now: float, reports: Sequence[tuple[float, Frame]]) -> list[tuple[float, Frame]]:
        """Return what is on the car's bus up to `now`, of what the car says: time and frame."""
        dead = self._value("bus_silent", now) is not None
        if dead or self._value("reports_stale", now) is not None:
            return []
        heard = []
        for time, frame in reports:
            heard.append((time, self._altered(time, frame)))
            if frame.id == dbw.BRAKE_REPORT and (torque := self._value("another_writer", time)) is not None:
                written = self._written(torque)
                self._foreign += written
                heard += [(time, foreign) for foreign in written]
        return heard

    def on_commands(self, now: float, commands: Sequence[Frame]) -> list[Frame]:
        """Return what the kit hears at `now`, of the `commands` on the bus."""
        foreign, self._foreign = self._foreign, []
        return [] if self._value("bus_silent", now) is not None else [*commands, *foreign]

    def driver(self, now: float) -> DriverInputs:
        """Return what the driver does at `now`."""
        inputs = HANDS_OFF
        for kind in ("driver_touch", "brake_override"):
            if (pedal := self._value(kind, now)) is not None:
                inputs = replace(inputs, brake_pedal=pedal)
        if (pedal := self._value("throttle_override", now)) is not None:
            inputs = replace(inputs, throttle_pedal=pedal)
        if (torque := self._value("steering_override", now)) is not None:
            inputs = replace(inputs, steering_torque=torque)
        return inputs

    def on_kit(self, now: float, kit: Kit) -> None:
        """Break the kit's modules, and mend them."""
        broken = self._value("kit_dropout", now)
        for number, module in enumerate(kit.modules, start=1):
            module.broken = number == broken

    def _value(self, kind: str, time: float) -> float | None:
        """Value of the `kind` that is due at `time`, NaN where it takes none; None where none is due."""
        since = time - self._moved
        for fault in self._rehearsed:
            if fault.kind == kind and fault.at <= since < fault.at + fault.duration:
                return _VALUES.get(kind, _NO_VALUE)[0] if math.isnan(fault.value) else fault.value
        return None

    def _freeze(self, time: float, fix: Fix) -> Fix:
        if self._value("pose_frozen", time) is None:
            self._frozen = None
            return fix
        self._frozen = self._frozen or fix
        return replace(self._frozen, time=fix.time, time_received=fix.time_received)

    def _mangled(self, time: float, packet: bytes) -> list[bytes]:
        """What leaves the receiver instead of `packet`, in order."""
        pieces = [packet]
        if (period := self._value("pose_garbage", time)) is not None:
            self._packets += 1
            pieces = [self._garbage()] if self._packets % int(period) == 0 else [self._garbage(), packet]
        if self._value("pose_duplicates", time) is not None:
            pieces = [piece for piece in pieces for _ in range(2)]
        kept, self._kept = self._kept, None
        if self._value("pose_reordered", time) is None:
            return pieces if kept is None else [kept, *pieces]
        if kept is not None:
            return [*pieces, kept]
        self._kept = pieces.pop()
        return pieces

    def _garbage(self) -> bytes:
        return self._random.bytes(int(self._random.integers(1, LONGEST_GARBAGE + 1)))

    def _holding(self, time: float) -> bool:
        return self._value("pose_late", time) is not None or self._value("pose_bursts", time) is not None

    def _release(self, time: float) -> float:
        """When a packet that arrived at `time` is let go."""
        time += self._value("pose_late", time) or 0.0
        if (period := self._value("pose_bursts", time)) is not None:
            begun = self._moved
            time = begun + math.ceil((time - begun) / period - ROUNDING) * period
        return time

    def _altered(self, time: float, frame: Frame) -> Frame:
        """What becomes of a report."""
        if frame.id == dbw.STEERING_REPORT and self._value("report_malformed", time) is not None:
            return Frame(frame.id, frame.data[:-1])
        kind, changes = _REPORTED.get(frame.id, ("", {}))
        if self._value(kind, time) is None:
            return frame
        report = dbw.decode(frame, self._variant)
        assert isinstance(report, BrakeReport | ThrottleReport | SteeringReport | WheelSpeeds)
        return dbw.encode(report._replace(**changes), self._variant)

    def _written(self, torque: float) -> list[Frame]:
        self._counter = (self._counter + 1) & 0xFF
        return [
            dbw.encode(BrakeCommand(BrakeKind.TORQUE, torque, True, self._counter), self._variant),
            dbw.encode(SteeringCommand(0.0, 0.0, True, self._counter), self._variant),
        ]


def _beside(fix: Fix, left: float) -> Fix:
    """The fix with its position moved to the left of its heading by `left` [m]."""
    return replace(
        fix,
        latitude=fix.latitude + left * math.cos(fix.heading) / EARTH_RADIUS,
        longitude=fix.longitude - left * math.sin(fix.heading) / (EARTH_RADIUS * math.cos(fix.latitude)),
    )
