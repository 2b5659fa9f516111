"""Velocity commands of ROS 2 as setpoints: which tick one answers, what it asks for, and why one is not taken.

Knows numbers and times; it must not know DDS or sockets. A command that is not taken has a reason, and changes nothing:
no setpoint is sent in its place, and where none comes the gateway stops the car.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.timing import SETPOINT_LIFETIME
from vve_sumo.wire.datagrams import SetpointDatagram
from vve_sumo.wire.ros2.messages import unix_nanoseconds

#: ticks that a command may still answer
MAX_TICKS: Final = 10
#: a stamp may be ahead of the newest tick by this much [ns]: the clock of a node goes on between two ticks
MAX_AHEAD: Final = 50_000_000
#: below this speed a turn by yaw rate has no steering angle [m/s]
LEAST_SPEED: Final = 0.5
#: why a command is not taken
LATE, AHEAD, NO_TICK = "command_late", "command_ahead", "command_without_tick"
NOT_FINITE, MALFORMED, SECOND = "command_not_finite", "command_malformed", "command_second_publisher"
#: no setpoint asks for more [m/s2]: the gateway's limits are far within
LARGEST: Final = 10.0


@dataclass(frozen=True, slots=True)
class Command:
    """What a message asks for."""

    stamp: int | None  #: Unix time of its header [ns]; None of a type without one, which answers the newest tick
    speed: float  #: [m/s]; below zero asks to stand
    yaw_rate: float | None  #: [rad/s], left positive; None where the steering is given
    steering: float | None = None  #: road-wheel angle [rad], left positive; None where the yaw rate is given
    limit: float = LARGEST  #: of the acceleration, either way [m/s2]


@dataclass(frozen=True, slots=True)
class Beat:
    """A tick that may be answered."""

    sequence: int  #: of its radar datagram
    time: float  #: GNSS time of it [s]
    speed: float  #: of the rear axle [m/s]


def command_of(kind: str, message: Any) -> Command:
    """Return what a message of a rig's `ros2.commands` asks for."""
    if kind == "ackermann":
        drive = message.drive
        limit = abs(drive.acceleration) if drive.acceleration else LARGEST
        return Command(_stamp(message), drive.speed, None, drive.steering_angle, limit)
    twist = message.twist if kind == "twist_stamped" else message
    return Command(_stamp(message) if kind == "twist_stamped" else None, twist.linear.x, twist.angular.z)


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


class Answers:
    """The setpoints that one publisher's commands come to."""

    def __init__(self, wheelbase: float, time_constant: float) -> None:
        """`wheelbase` in metres; a speed is asked for as what reaches it in about `time_constant` [s]."""
        self._wheelbase, self._time_constant = wheelbase, time_constant
        self._beats: OrderedDict[int, Beat] = OrderedDict()  # by Unix time [ns], in order
        self._writer: int | None = None  # the brain: who sent the first command that was taken
        self._steering, self._sequence = 0.0, 0
        self.taken = 0  #: commands that became setpoints
        self.refused: Counter[str] = Counter()  #: commands that did not, by reason
        self.silenced = False  #: a second publisher commands: no setpoint is sent any more

    def ticked(self, beat: Beat) -> None:
        """Note a tick that may be answered."""
        self._beats[unix_nanoseconds(beat.time)] = beat
        while len(self._beats) > MAX_TICKS:
            self._beats.popitem(last=False)

    def forget(self) -> None:
        """Forget all ticks: none may be answered until the next."""
        self._beats.clear()

    def take(self, writer: int, command: Command | None) -> SetpointDatagram | None:
        """Return the setpoint that a publisher's command comes to; None where it is not taken. None is no command."""
        reason, beat = self._judged(writer, command)
        if reason or command is None or beat is None:
            self.refused[reason] += 1
            return None
        self._writer = writer
        self.taken += 1
        self._sequence += 1
        self._steering = self._steered(command, beat.speed)
        wanted = (max(command.speed, 0.0) - beat.speed) / self._time_constant
        limit = min(command.limit, LARGEST)
        acceleration = max(-limit, min(limit, wanted))
        return SetpointDatagram(
            self._sequence, beat.sequence, beat.time, SETPOINT_LIFETIME, self._steering, acceleration
        )

    def _judged(self, writer: int, command: Command | None) -> tuple[str, Beat | None]:
        if command is None:
            return MALFORMED, None
        if self._writer is not None and writer != self._writer:
            # Whose car it is cannot be told: the gateway stops it.
            self.silenced = True
        if self.silenced:
            return SECOND, None
        numbers = (command.speed, command.yaw_rate or 0.0, command.steering or 0.0, command.limit)
        if not all(map(math.isfinite, numbers)):
            return NOT_FINITE, None
        if not self._beats:
            return NO_TICK, None
        newest = next(reversed(self._beats))
        if command.stamp is None:
            return "", self._beats[newest]
        if command.stamp > newest + MAX_AHEAD:
            return AHEAD, None
        answered = [at for at in self._beats if at <= command.stamp]
        return ("", self._beats[answered[-1]]) if answered else (LATE, None)

    def _steered(self, command: Command, speed: float) -> float:
        """Return the road-wheel angle of a command [rad]: of a yaw rate at the present speed by the wheelbase."""
        if command.steering is not None:
            return command.steering
        if speed < LEAST_SPEED:
            return self._steering
        return math.atan(self._wheelbase * (command.yaw_rate or 0.0) / speed)
