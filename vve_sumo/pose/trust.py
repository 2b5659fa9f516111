"""The trust gate: is this one fix good enough, given the fixes before it?

Knows fixes and nothing of the car, the map, the controller or the gateway. There is no way to override it: a fix is
trusted when no reason speaks against it. Every comparison is written so that NaN fails it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.values import Fix

LOCKED: Final = 4  #: the NCOM navigation status that is real time
RTK_FIXED: Final = frozenset({6, 16, 24, 29})  #: NCOM position modes with integer ambiguities (channel 0)
EARTH_RADIUS: Final = 6_371_000.0  #: mean [m]; good to 0.5 % over the metre between two fixes
FUTURE_LIMIT: Final = 0.02  #: a fix may be this far ahead of now, for clocks that are not quite the same [s]
LEVER_LIMIT: Final = 4.0  #: no output point lies further from the rear axle [m]: bounds its course in a bend
FROZEN_SPEED: Final = 0.2  #: above it two fixes cannot have the same position to the last bit [m/s]
ACCELERATION_LIMIT: Final = 12.0  #: no car accelerates more [m/s2]: bounds the way it can leave a straight line

REASONS: Final[dict[str, str]] = {
    "not_finite": "time, position, velocity, yaw rate or acceleration is missing or not a number",
    "heading_invalid": "the receiver says that its heading is invalid",
    "pitch_invalid": "the receiver says that its pitch is invalid, so gravity cannot be told from acceleration",
    "status_not_locked": "the navigation status is not 4 (locked, real time)",
    "not_rtk_fixed": "the position mode is not RTK with fixed ambiguities, or not known",
    "position_sigma": "the receiver's own position accuracy is too poor, stale or not known",
    "velocity_sigma": "the receiver's own velocity accuracy is too poor, stale or not known",
    "heading_sigma": "the receiver's own heading accuracy is too poor, stale or not known",
    "corrections_old": "the RTK corrections are too old, or their age is not known",
    "fix_too_old": "the fix was made too long ago",
    "fix_from_future": "the fix is dated later than now: the clocks disagree",
    "time_not_increasing": "the fix is not newer than one already judged",
    "gap": "too long a time since the fix before this one",
    "pose_jump": "the position is not where the velocity leads from the fix before",
    "frozen_pose": "the position stands still to the last bit while the velocity says that the car moves",
    "heading_off_course": "the heading and the direction of travel disagree",
    "settling": "a jump or gap was seen a moment ago; fixes must agree for a while before they count again",
    "pose_stale": "no trusted fix for too long",
}


@dataclass(frozen=True, slots=True)
class TrustProfile:
    """How strict the gate is."""

    name: str
    may_arm: bool  #: whether a car may be armed on fixes that passed; False for recordings
    live: bool  #: judges status, RTK mode, sigmas, correction age and the fix's age; False for recordings without them
    position_sigma_limit: float  #: 1 sigma [m]
    velocity_sigma_limit: float  #: 1 sigma [m/s]
    heading_sigma_limit: float  #: 1 sigma [rad]
    corrections_age_limit: float  #: [s]
    age_limit: float  #: from the fix's own time to now [s]
    gap_limit: float  #: between fixes [s]
    stale_limit: float  #: since the last trusted fix's own time [s]
    jump_limit: float  #: from where the velocity leads [m]
    course_limit: float  #: heading against course [rad], on top of what a bend explains
    course_speed: float  #: the course is judged above it [m/s]
    settling: float  #: how long fixes must agree after a jump or gap [s]


#: A car may drive on it. 0.10 m and 100 ms are the figures the rest of the chain is built on (a setpoint lives 100 ms);
#: 0.01 rad puts a point 10 m ahead 0.1 m off; 0.25 m is ten sigma of RTK noise and less than a lane margin.
DRIVE: Final = TrustProfile(
    name="drive",
    may_arm=True,
    live=True,
    position_sigma_limit=0.10,
    velocity_sigma_limit=0.10,
    heading_sigma_limit=0.01,
    corrections_age_limit=10.0,
    age_limit=0.10,
    gap_limit=0.15,
    stale_limit=0.15,
    jump_limit=0.25,
    course_limit=0.20,
    course_speed=3.0,
    settling=0.5,
)

#: Recordings: no quality, no real time, as few as 2 fixes a second; never a car.
PLAYBACK: Final = TrustProfile(
    name="playback",
    may_arm=False,
    live=False,
    position_sigma_limit=math.inf,
    velocity_sigma_limit=math.inf,
    heading_sigma_limit=math.inf,
    corrections_age_limit=math.inf,
    age_limit=math.inf,
    gap_limit=1.0,
    stale_limit=1.0,
    jump_limit=1.0,
    course_limit=0.35,
    course_speed=3.0,
    settling=0.0,
)


@dataclass(frozen=True, slots=True)
class Trust:
    """The gate's answer about one fix."""

    trusted: bool
    reasons: tuple[str, ...]  #: keys of `REASONS`, empty when trusted


def _of_the_fix(fix: Fix, profile: TrustProfile) -> list[str]:
    """What speaks against the fix in itself."""
    reasons = []
    total = fix.time + fix.latitude + fix.longitude + fix.velocity_north + fix.velocity_east
    if not math.isfinite(total + fix.yaw_rate + fix.acceleration):
        reasons.append("not_finite")
    if not math.isfinite(fix.heading):
        reasons.append("heading_invalid")
    elif _off_course(fix, profile):
        reasons.append("heading_off_course")
    return reasons


def _off_course(fix: Fix, profile: TrustProfile) -> bool:
    """Whether heading and course disagree by more than the limit and what a bend explains (reversing disagrees)."""
    speed = math.hypot(fix.velocity_north, fix.velocity_east)
    if not speed > profile.course_speed:
        return False
    course = math.atan2(fix.velocity_north, fix.velocity_east)
    allowed = profile.course_limit + LEVER_LIMIT * abs(fix.yaw_rate) / speed
    return not abs(math.remainder(fix.heading - course, math.tau)) <= allowed


def _of_the_receiver(fix: Fix, profile: TrustProfile) -> list[str]:
    """What the receiver itself says against the fix."""
    judged = (
        ("pitch_invalid", math.isfinite(fix.pitch)),
        ("status_not_locked", fix.status == LOCKED),
        ("not_rtk_fixed", fix.position_mode in RTK_FIXED),
        ("position_sigma", 0.0 <= fix.position_sigma <= profile.position_sigma_limit),
        ("velocity_sigma", 0.0 <= fix.velocity_sigma <= profile.velocity_sigma_limit),
        ("heading_sigma", 0.0 <= fix.heading_sigma <= profile.heading_sigma_limit),
        ("corrections_old", 0.0 <= fix.differential_age <= profile.corrections_age_limit),
    )
    return [reason for reason, good in judged if not good]


def _of_the_step(last: Fix, fix: Fix, profile: TrustProfile) -> list[str]:
    """What the fix before speaks against this one; both finite, `fix` the newer."""
    step = fix.time - last.time
    if step > profile.gap_limit:
        return ["gap"]
    reasons = []
    if fix.latitude == last.latitude and fix.longitude == last.longitude:
        slower = min(
            math.hypot(fix.velocity_north, fix.velocity_east), math.hypot(last.velocity_north, last.velocity_east)
        )
        if slower > FROZEN_SPEED:
            reasons.append("frozen_pose")
    north = (fix.latitude - last.latitude) * EARTH_RADIUS
    east = math.remainder(fix.longitude - last.longitude, math.tau) * EARTH_RADIUS * math.cos(fix.latitude)
    north -= 0.5 * step * (fix.velocity_north + last.velocity_north)
    east -= 0.5 * step * (fix.velocity_east + last.velocity_east)
    if not math.hypot(north, east) <= profile.jump_limit + 0.25 * ACCELERATION_LIMIT * step * step:
        reasons.append("pose_jump")
    return reasons


class TrustGate:
    """Judges fixes one by one against their history.

    `epoch` is the GNSS second of drive time 0. The history moves on with every fix that is finite, newer than the one
    before and not from the future, trusted or not; so a jump is one reason once, and then `settling`.
    """

    def __init__(self, profile: TrustProfile, epoch: float) -> None:
        self.profile = profile
        self._epoch = epoch
        self._last: Fix | None = None
        self._unsettled_until = -math.inf
        self._trusted_until = -math.inf

    def step(self, now: float, fix: Fix) -> Trust:
        """Judge `fix` at drive time `now` [s]."""
        profile = self.profile
        reasons = _of_the_fix(fix, profile)
        if profile.live:
            reasons += _of_the_receiver(fix, profile)
            reasons += self._of_the_age(now, fix)
        if "not_finite" not in reasons and "fix_from_future" not in reasons:
            reasons += self._of_the_history(fix)
        if not reasons:
            self._trusted_until = fix.time - self._epoch + profile.stale_limit
        return Trust(not reasons, tuple(reasons))

    def stale(self, now: float) -> tuple[str, ...]:
        """Return ("pose_stale",) when the last trusted fix was made too long before drive time `now`, else ()."""
        return () if now <= self._trusted_until else ("pose_stale",)

    def _of_the_age(self, now: float, fix: Fix) -> list[str]:
        age = now - (fix.time - self._epoch)
        if age < -FUTURE_LIMIT:
            return ["fix_from_future"]
        return [] if age <= self.profile.age_limit else ["fix_too_old"]

    def _of_the_history(self, fix: Fix) -> list[str]:
        last = self._last
        if last is None:
            self._last = fix
            return []
        if not fix.time > last.time:
            return ["time_not_increasing"]
        self._last = fix
        reasons = _of_the_step(last, fix, self.profile)
        if "gap" in reasons or "pose_jump" in reasons:
            self._unsettled_until = fix.time + self.profile.settling
        elif fix.time < self._unsettled_until:
            reasons.append("settling")
        return reasons
