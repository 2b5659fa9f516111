"""The process that computes setpoints, as far as a gateway can tell: 50 a second, straight on.

It believes the speed that the gateway tells it, and knows one plan: up to a speed, along for a while, down to rest.
"""

from __future__ import annotations

import math
import os
import signal
import time

from vve_sumo.live.channel import Channel
from vve_sumo.values import Setpoint
from vve_sumo.vehicle import link

PERIOD = 0.02
LIFETIME = 0.1
SPEED = 4.0
ACCELERATION = 1.8
CRUISE_TIME = 1.0


class Sender:
    """A child of this process; with `cruise` it never brakes."""

    def __init__(self, channel: Channel, others: Channel, t0: float, cruise: bool) -> None:
        self.pid = os.fork()
        if self.pid == 0:
            others.close()
            try:
                _send(channel, t0, math.inf if cruise else CRUISE_TIME)
            finally:
                os._exit(0)
        channel.close()

    def kill(self, number: int) -> None:
        """Send it a signal."""
        os.kill(self.pid, number)

    def end(self) -> None:
        """End it, which it also does by itself when the gateway has gone."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)


def _send(channel: Channel, t0: float, cruise_time: float) -> None:
    speed, driven, reached, due, sequence = 0.0, 0.0, math.inf, time.monotonic(), 0
    before = time.monotonic() - t0
    while not channel.closed:
        due = max(due + PERIOD, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))
        for data in channel.receive():
            feedback = link.decode_feedback(data)
            assert isinstance(feedback, link.Feedback)
            speed = feedback.wheel_speed if math.isfinite(feedback.wheel_speed) else 0.0
        now = time.monotonic() - t0
        if speed > SPEED - 0.1:
            reached = min(reached, now)
        wish = min(max(SPEED - speed, -ACCELERATION), ACCELERATION) if now < reached + cruise_time else -ACCELERATION
        driven, before = driven + speed * (now - before), now
        setpoint = Setpoint(
            0.0, wish, emergency=False, note="", sequence=sequence, time=now, expires=now + LIFETIME,
            x=driven, y=0.0, heading=0.0, speed=speed, yaw_rate=0.0, grade=0.0, faults=(), fallback_path=None,
        )  # fmt: skip
        channel.send(link.encode_setpoint(setpoint))
        sequence += 1
