"""Injects faults of a receiver into its fixes, and the packets of another sender.

It knows fixes and packets, and nothing of the car or of who receives them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.plant.injected_faults import POSE_KINDS, Due, Share
from vve_sumo.plant.receiver import PERIOD
from vve_sumo.pose.receivers.port import FixEncoder, MinuteEncoder, Receiver
from vve_sumo.values import Fix, FixQuality

STEP_INTERVAL: Final = 1.0  # between steps of the position [s]
DATE_ERROR: Final = 12.0  # of a fix with a wrong time [s]
MINUTES_WRONG: Final = 5


class ReceiverFaults:
    """Alters fixes, one after the other; a fix's `time_received` says when it was measured."""

    def __init__(self, due: Due) -> None:
        self._due = due
        self._active = due.ever(*POSE_KINDS)
        self._frozen: Fix | None = None
        self._dated = False  # one fix has got the wrong time already

    def alter(self, fix: Fix) -> Fix | None:
        """Return what is sent in place of `fix`, None for nothing."""
        if not self._active:
            return fix
        time, value = fix.time_received, self._due.value
        if value("pose_lost", time) is not None:
            return None
        fix = self._drift(time, self._freeze(time, fix))
        if (left := value("pose_jump", time)) is not None:
            fix = _beside(fix, left)
        if (sigma := value("pose_rtk_lost", time)) is not None:
            fix = replace(fix, quality=FixQuality.RTK_FLOAT, position_sigma=sigma)
        if (back := value("pose_backwards", time)) is not None:
            fix = replace(fix, time=fix.time - back)
        if value("pose_nan", time) is not None:
            fix = replace(fix, latitude=math.nan)
        if value("pose_heading_invalid", time) is not None:
            fix = replace(fix, heading=math.nan)
        return self._date(time, fix)

    def _freeze(self, time: float, fix: Fix) -> Fix:
        if self._due.value("pose_frozen", time) is None:
            self._frozen = None
            return fix
        self._frozen = self._frozen or fix
        return replace(self._frozen, time=fix.time, time_received=fix.time_received)

    def _drift(self, time: float, fix: Fix) -> Fix:
        """Apply the faults by which position or heading drift away slowly."""
        if (drift := self._due.share("pose_drift_lateral", time)) is not None:
            fix = _carried_off(fix, 0.0, 1.0, drift)
        if (drift := self._due.share("pose_drift_along", time)) is not None:
            fix = _carried_off(fix, 1.0, 0.0, drift)
        if (steps := self._due.share("pose_steps", time)) is not None:
            fix = _beside(fix, steps.value * (1 + math.floor(steps.since / STEP_INTERVAL)))
        if (drift := self._due.share("pose_heading_drift", time)) is not None:
            heading = math.remainder(fix.heading + drift.total, math.tau)
            fix = replace(fix, heading=heading, yaw_rate=fix.yaw_rate + drift.value)
        return fix

    def _date(self, time: float, fix: Fix) -> Fix:
        if self._due.value("pose_ahead_once", time) is None:
            self._dated = False
        elif not self._dated:
            self._dated = True
            return replace(fix, time=fix.time + DATE_ERROR)
        return fix


class WrongMinute:
    """Alters one message that holds the minute; only an encoder that is a `MinuteEncoder` has such messages."""

    def __init__(self, due: Due, encoder: FixEncoder | None) -> None:
        self._due = due
        self._encoder = encoder if isinstance(encoder, MinuteEncoder) else None
        self._wrong_minute_sent = False

    def alter(self, time: float, packet: bytes) -> bytes:
        """Return what is sent at `time` in place of a packet."""
        if self._due.value("pose_minute_wrong", time) is None or self._encoder is None:
            self._wrong_minute_sent = False
        elif (
            not self._wrong_minute_sent
            and (wrong := self._encoder.with_wrong_minute(packet, MINUTES_WRONG)) is not None
        ):
            self._wrong_minute_sent = True
            return wrong
        return packet


class Forger:
    """Another sender, which receives the packets and sends between them."""

    def __init__(self, due: Due, receiver: Receiver) -> None:
        self._due = due
        self._decoder = receiver.decoder() if due.ever("pose_forged", "pose_overtaken") else None
        self._encoder = receiver.encoder()

    def surround(self, time: float, packet: bytes) -> list[bytes]:
        """Return a packet that arrives at `time`, with the other sender's just before and after it, in order."""
        encoder, pieces = self._encoder, [packet]
        if self._decoder is None or encoder is None:
            return pieces
        before, after = self._due.share("pose_overtaken", time), self._due.share("pose_forged", time)
        for fix in self._decoder.feed(packet, time):
            if before is not None:
                pieces.insert(0, encoder.encode(_carried_off(fix, 0.0, 1.0, before)))
            if after is not None:
                pieces.append(encoder.encode(_carried_off(_next(fix), 0.0, 1.0, after)))
        return pieces


def _next(fix: Fix) -> Fix:
    """The fix that comes after this one."""
    north, east = PERIOD * fix.velocity_north, PERIOD * fix.velocity_east
    return replace(_moved(fix, north, east), time=fix.time + PERIOD)


def _carried_off(fix: Fix, ahead: float, left: float, drift: Share) -> Fix:
    """The fix after a drift in the direction of `ahead` and `left`, which its velocity shows."""
    cos, sin = math.cos(fix.heading), math.sin(fix.heading)
    north, east = ahead * sin + left * cos, ahead * cos - left * sin
    return replace(
        _moved(fix, drift.total * north, drift.total * east),
        velocity_north=fix.velocity_north + drift.value * north,
        velocity_east=fix.velocity_east + drift.value * east,
    )


def _beside(fix: Fix, left: float) -> Fix:
    """The fix with its position moved to the left of its heading by `left` [m]."""
    return _moved(fix, left * math.cos(fix.heading), -left * math.sin(fix.heading))


def _moved(fix: Fix, north: float, east: float) -> Fix:
    """The fix with its position moved [m]."""
    latitude = fix.latitude + north / EARTH_RADIUS
    return replace(fix, latitude=latitude, longitude=fix.longitude + east / (EARTH_RADIUS * math.cos(fix.latitude)))
