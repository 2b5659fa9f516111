"""Measures how the lot lies on the virtual road, and the GNSS time, while the car stands before a live drive.

Averages the receiver's trusted fixes at standstill. The alignment is frozen for the drive, so the road never moves
under an engaged car.
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
from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.receivers.port import FixDecoder
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import TrustGate, TrustProfile
from vve_sumo.values import Fix, Pose

#: time over which trusted fixes at standstill are averaged [s]; divides RTK noise by three at 10 Hz, by ten at 100 Hz
AVERAGING_TIME: Final = 1.5
#: between two polls of a silent receiver [s]
POLL_INTERVAL: Final = 0.1
#: a receiver that does not give these fixes within this time, and what its decoder settles for, is not ready [s]
TIMEOUT: Final = 30.0
#: a car at this speed or faster counts as moving [m/s]: five sigma of a receiver's velocity
MAX_STANDSTILL_SPEED: Final = 0.15


@dataclass(frozen=True, slots=True)
class StandingPose:
    """The average of the receiver's fixes while the car stood."""

    epoch: float  #: GNSS second of drive time 0
    fix: Fix  #: the average
    fixes: int  #: number of fixes averaged
    spread: float  #: largest distance of a fix from the average [m]
    turn: float  #: largest difference of a heading from the average [rad]


def standing_pose(
    source: Source,
    decoder: FixDecoder,
    profile: TrustProfile,
    minimum_delay: float,
    t0: float,
    absolute: float | None = None,
    settling: float = 0.0,
) -> StandingPose:
    """Average the fixes of a standing car.

    `minimum_delay` is the shortest delay of a fix as the rig declares it [s], `t0` the monotonic second of drive time
    0, `absolute` the GNSS second of drive time 0 if this machine's clock gives it, `settling` the time for which a
    fresh decoder takes no fix to be locked [s]. Raises RigError saying what the receiver's fixes lack, or that the car
    moves.
    """
    patience = settling + TIMEOUT
    begun = time.monotonic()
    dater = FixDater(minimum_delay, math.nan if absolute is None else absolute, absolute=absolute is not None)
    gate: TrustGate | None = None
    standing: list[Fix] = []
    lacks: Counter[str] = Counter()
    while time.monotonic() - begun < patience:
        select.select([source], [], [], POLL_INTERVAL)
        for stamp, data in source.receive():
            received = stamp - t0
            for fix in decoder.feed(data, received):
                dated = dater.date(received, fix)
                if isinstance(dated, Undated):
                    lacks[dated.reason] += 1
                    standing.clear()
                    continue
                gate = gate or TrustGate(profile, dater.epoch)
                trust = gate.step(received, dated)
                lacks.update(trust.reasons)
                moves = not math.hypot(fix.velocity_north, fix.velocity_east) < MAX_STANDSTILL_SPEED
                lacks.update(("car_moves",) if moves else ())
                if moves or not trust.trusted:
                    standing.clear()
                else:
                    standing.append(fix)
        if standing and standing[-1].time - standing[0].time >= AVERAGING_TIME:
            return average_fixes(dater.measured_epoch, standing)
    lacking = "no fix at all" if not lacks else ", ".join(code for code, _count in lacks.most_common(4))
    raise RigError(f"pose: {patience:.0f} s without {AVERAGING_TIME} s of trusted fixes at standstill: {lacking}")


def lot_alignment(
    standing: StandingPose, frame: MapFrame, mounting: Mounting, begin: Pose, stored: Alignment | None
) -> LotAlignment:
    """Return how the lot, with its map `frame`, lies on the virtual road.

    A `stored` alignment is used unchanged. Without one, the alignment maps the pose of the standing car to `begin`, the
    start of the path on the virtual road.
    """
    if stored is not None:
        return LotAlignment(frame.projection, stored, standing.epoch)
    there = Placement(frame, Alignment(), mounting, standing.epoch).place(standing.fix)
    here = pose_at_rest(there.x, there.y, there.heading)
    alignment = Alignment.from_matched_start(here, pose_at_rest(begin.x, begin.y, begin.heading))
    return LotAlignment(frame.projection, alignment, standing.epoch)


def average_fixes(epoch: float, fixes: Sequence[Fix]) -> StandingPose:
    """Return the average of a standing car's fixes; `epoch` is the GNSS second of drive time 0."""
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
