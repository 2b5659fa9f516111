"""A process that computes setpoints, as far as a gateway can tell: 50 a second, for 8 m/s straight on.

`python -m tests.live.sender CHANNEL T0`; it believes the speed that the gateway tells it.
"""

from __future__ import annotations

import math
import sys
import time

from vve_sumo.live.channel import adopt
from vve_sumo.live.priority import DRIVE_NICE, raise_priority
from vve_sumo.values import Setpoint
from vve_sumo.vehicle import link

PERIOD = 0.02
SPEED = 8.0


def main(descriptor: int, t0: float) -> None:
    """Send setpoints until nobody hears them."""
    channel = adopt(descriptor)
    raise_priority(DRIVE_NICE)
    speed, driven, due, sequence = 0.0, 0.0, time.monotonic(), 0
    before = due - t0
    while not channel.closed:
        due = max(due + PERIOD, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))
        for data in channel.receive():
            feedback = link.decode_feedback(data)
            speed = feedback.wheel_speed if math.isfinite(feedback.wheel_speed) else 0.0
        now = time.monotonic() - t0
        driven, before = driven + speed * (now - before), now
        setpoint = Setpoint(
            steering=0.0,
            acceleration=min(max(SPEED - speed, -1.5), 1.5),
            emergency=False,
            note="",
            sequence=sequence,
            time=now,
            expires=now + 0.1,
            x=driven,
            y=0.0,
            heading=0.0,
            speed=speed,
            yaw_rate=0.0,
            grade=0.0,
            faults=(),
            fallback_path=None,
        )
        channel.send(link.encode_setpoint(setpoint))
        sequence += 1


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
