"""How the lot lies on the virtual road and what time it is, measured while the car stands: where a live drive begins.

Averages the receiver's trusted fixes at standstill. The alignment is frozen for the drive: nothing moves the road under
a car that is engaged.
"""

from __future__ import annotations

import cmath
import math
import select
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import RigError
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.pose.clock import Clock
from vve_sumo.pose.receivers.port import FixDecoder
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import EARTH_RADIUS, TrustGate, TrustProfile
from vve_sumo.values import Fix, Pose

#: over which trusted fixes at standstill are averaged [s]: RTK noise falls by three at 10 Hz, by ten at 100 Hz
AVERAGING_TIME: Final = 1.5
#: between two polls of a silent receiver [s]
POLL_INTERVAL: Final = 0.1
#: a receiver that gives no such fixes for so long is not ready [s]
TIMEOUT: Final = 30.0
#: a car that is faster does not stand [m/s]: five sigma of a receiver's velocity
MAX_STANDSTILL_SPEED: Final = 0.15


@dataclass(frozen=True, slots=True)
class StandingPose:
    """What the receiver said while the car stood."""

    epoch: float  #: GNSS second of drive time 0
    fix: Fix  #: the average
    fixes: int  #: so many of them
    spread: float  #: farthest of them from the average [m]
    turn: float  #: largest difference of their headings from the average [rad]


def standing_pose(
    source: Source,
    decoder: FixDecoder,
    profile: TrustProfile,
    minimum_delay: float,
    t0: float,
    absolute: float | None = None,
) -> StandingPose:
    """Average the fixes of a standing car.

    `minimum_delay` is what the rig declares [s], `t0` the monotonic second of drive time 0, `absolute` the GNSS second
    of drive time 0 where this machine's clock knows it. Raises RigError saying what the receiver's fixes lack, or that
    the car moves.
    """
    begun = time.monotonic()
    timing: Clock | None = None
    gate: TrustGate | None = None
    epoch = math.nan
    standing: list[Fix] = []
    lacks: Counter[str] = Counter()
    while time.monotonic() - begun < TIMEOUT:
        select.select([source], [], [], POLL_INTERVAL)
        for stamp, data in source.receive():
            received = stamp - t0
            for fix in decoder.feed(data, received):
                if timing is None or gate is None:
                    epoch = fix.time - (received - minimum_delay) if absolute is None else absolute
                    timing = Clock(epoch, minimum_delay, absolute=absolute is not None)
                    gate = TrustGate(profile, epoch)
                timed = replace(fix, time=epoch + timing.step(received, fix.time))
                trust = gate.step(received, timed)
                lacks.update(trust.reasons)
                moves = not math.hypot(fix.velocity_north, fix.velocity_east) < MAX_STANDSTILL_SPEED
                lacks.update(("car_moves",) if moves else ())
                if moves or not trust.trusted:
                    standing.clear()
                else:
                    standing.append(fix)
        if standing and standing[-1].time - standing[0].time >= AVERAGING_TIME:
            return average_fixes(epoch, standing)
    lacking = "no fix at all" if timing is None else ", ".join(code for code, _count in lacks.most_common(4))
    raise RigError(f"pose: {TIMEOUT:.0f} s without {AVERAGING_TIME} s of trusted fixes at standstill: {lacking}")


def lot_alignment(
    standing: StandingPose, frame: MapFrame, mounting: Mounting, begin: Pose, stored: Alignment | None
) -> LotAlignment:
    """Return how the lot, with its map `frame`, lies on the street.

    A `stored` alignment is taken as it is; without one, where the car stands becomes the street's pose `begin`, the
    start of its path.
    """
    if stored is not None:
        return LotAlignment(frame.projection, stored, standing.epoch)
    there = Placement(frame, Alignment(), mounting, standing.epoch).place(standing.fix)
    here = pose_at_rest(there.x, there.y, there.heading)
    alignment = Alignment.from_matched_start(here, pose_at_rest(begin.x, begin.y, begin.heading))
    return LotAlignment(frame.projection, alignment, standing.epoch)


def average_fixes(epoch: float, fixes: Sequence[Fix]) -> StandingPose:
    """Return what the fixes of a standing car say together; `epoch` is the GNSS second of drive time 0."""
    count = len(fixes)
    latitude = sum(fix.latitude for fix in fixes) / count
    longitude = sum(fix.longitude for fix in fixes) / count
    heading = cmath.phase(sum((cmath.exp(1j * fix.heading) for fix in fixes), 0j))
    north = [(fix.latitude - latitude) * EARTH_RADIUS for fix in fixes]
    east = [(fix.longitude - longitude) * EARTH_RADIUS * math.cos(latitude) for fix in fixes]
    middle = replace(
        fixes[-1],
        latitude=latitude,
        longitude=longitude,
        heading=heading,
        velocity_north=0.0,
        velocity_east=0.0,
        yaw_rate=0.0,
        acceleration=sum(fix.acceleration for fix in fixes) / count,
    )
    turn = max(abs(math.remainder(fix.heading - heading, math.tau)) for fix in fixes)
    return StandingPose(epoch, middle, count, max(map(math.hypot, north, east)), turn)
