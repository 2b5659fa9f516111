"""The trust gate: decides whether a fix is good enough to drive on, given the fixes before it.

It knows fixes and nothing of the car, the map, the controller or the gateway. It cannot be overridden: a fix is trusted
when no reason speaks against it. Every comparison is written so that NaN fails it, except where NaN means that a
receiver does not report a quantity that no drive needs: such a quantity is not compared.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.frozen import fast_frozen
from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.pose.steadiness import Steadiness
from vve_sumo.values import Fix, FixQuality

FUTURE_LIMIT: Final = 0.02  #: a fix may be this far ahead of now, for clocks that are not quite the same [s]
LEVER_LIMIT: Final = 4.0  #: no output point lies further from the rear axle [m]: bounds its course in a bend
YAW_RATE_LIMIT: Final = 2.0  #: no car on its wheels turns faster [rad/s]
DRIFT_WINDOW: Final = 0.5  #: over which position and velocity are compared as a whole [s]
VELOCITY_NOISE: Final = 0.5  #: what two velocities may differ by besides acceleration [m/s]
FROZEN_SPEED: Final = 0.2  #: above it two fixes of a fine wire cannot have the same position to the last bit [m/s]
#: a car that goes this many steps of its wire's positions has another one, whatever its heading (the diagonal of a step
#: at most), with as much again for noise that goes against the way
FROZEN_STEPS: Final = 2.0 * math.sqrt(2.0)
ABSURD_ACCELERATION: Final = 20.0  #: specific force that only a crash or a broken sensor shows [m/s2]
ACCELERATION_LIMIT: Final = 12.0  #: of any car [m/s2]: bounds how far it can leave a straight line
MIN_ALTITUDE: Final = -600.0  #: of any road [m]: the Dead Sea's shore, less what ellipsoid and sea level differ by
MAX_ALTITUDE: Final = 7000.0  #: of any road [m]
TILT_LIMIT: Final = 0.7  #: pitched or rolled farther no car stands on its wheels [rad]
TILT_RATE: Final = 1.0  #: a car pitches and rolls no faster over what it may drive over [rad/s]
TILT_NOISE: Final = 0.01  #: what two pitches or rolls may differ by besides [rad]
MAX_SLOPE: Final = 0.5  #: climb over way, where the receiver says no vertical velocity
YAW_ACCELERATION_LIMIT: Final = 10.0  #: no car begins to turn faster [rad/s2]

REASONS: Final[dict[str, str]] = {
    "not_finite": "time, position, velocity, yaw rate or acceleration is missing or not a number",
    "heading_invalid": "the receiver says that its heading is invalid",
    "pitch_invalid": "the receiver says that its pitch is invalid, so gravity cannot be told from acceleration",
    "status_not_locked": "the receiver does not say that its navigation is locked (in real time)",
    "not_rtk_fixed": "the position is not RTK with fixed ambiguities, or its quality is not known",
    "position_sigma": "the receiver's own position accuracy is too poor, stale or not known",
    "velocity_sigma": "the receiver's own velocity accuracy is too poor, stale or not known",
    "heading_sigma": "the receiver's own heading accuracy is too poor, stale or not known",
    "corrections_old": "the RTK corrections are too old, or their age is not known",
    "fix_too_old": "the fix was made too long ago",
    "fix_from_future": "the fix is dated later than now: the clocks disagree",
    "fix_ahead": "the fix is dated ahead of what the arrivals before it allow, and no run of fixes agrees with it yet",
    "time_not_increasing": "the fix is not newer than one already judged",
    "gap": "too long a time since the fix before this one",
    "pose_jump": "the position is not where the velocity leads from the fix before",
    "pose_drift": "over half a second the position ran away from where the velocity leads",
    "heading_drift": "over half a second the heading turned away from where the yaw rate leads",
    "velocity_jump": "the velocity changed by more than a car can accelerate",
    "heading_jump": "the heading changed by more than the yaw rate explains",
    "motion_absurd": "yaw rate or acceleration is more than a car on its wheels can do",
    "altitude_absurd": "the altitude is one at which there are no roads",
    "tilt_absurd": "pitch or roll is more than a car on its wheels can have",
    "altitude_jump": "altitude or vertical velocity is not where the fix before leads",
    "tilt_jump": "pitch or roll changed faster than a car can tilt",
    "motion_jump": "yaw rate or acceleration changed by more than a car can change them",
    "frozen_pose": "the position stays the same while the velocity says that the car moves",
    "heading_off_course": "the heading and the direction of travel disagree",
    "settling": "a jump or gap was seen a moment ago; fixes must agree for a while before they count again",
    "pose_stale": "no trusted fix for too long",
    "pose_unsteady": "too many fixes of the last second were refused, or trusted ones interrupted too often",
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
    pitch_needed: bool  #: refuses a fix whose gravity cannot be told from its acceleration
    corrections_age_limit: float  #: [s]
    age_limit: float  #: from the fix's own time to now [s]
    gap_limit: float  #: between fixes [s]
    stale_limit: float  #: since the last trusted fix's own time [s]
    jump_limit: float  #: from where the velocity leads, from fix to fix and over `DRIFT_WINDOW` [m]
    heading_jump_limit: float  #: from where the yaw rate leads, from fix to fix [rad]
    altitude_jump_limit: float  #: from where the vertical velocity leads, from fix to fix [m]
    yaw_rate_jump_limit: float  #: from fix to fix, on top of what a car can begin to turn [rad/s]
    acceleration_jump_limit: float  #: from fix to fix [m/s2]
    course_limit: float  #: heading against course [rad], on top of what a bend explains
    course_speed: float  #: the course is judged above it [m/s]
    settling: float  #: how long fixes must agree after a jump or gap [s]
    position_step: float = 0.0  #: between two positions that the wire can say [m]; 0 where it is below any noise

    def __post_init__(self) -> None:
        """Raise ConfigError for a profile that would arm a car on fixes whose quality is not judged."""
        if self.may_arm and not self.live:
            raise ConfigError(f"trust profile {self.name}: one that does not judge live quality may never arm")


#: A car may drive on it. 0.10 m and 100 ms are what the rest of the pipeline is built on (a setpoint lives 100 ms);
#: 0.01 rad puts a point 10 m ahead 0.1 m off; 0.25 m is ten sigma of RTK noise and less than a lane margin, and heights
#: are half as good. A gyroscope in a shaken car may be 0.1 rad/s off for a moment. An acceleration may vanish at once,
#: as it does when full braking has brought the car to rest.
DRIVE: Final = TrustProfile(
    name="drive",
    may_arm=True,
    live=True,
    position_sigma_limit=0.10,
    velocity_sigma_limit=0.10,
    heading_sigma_limit=0.01,
    pitch_needed=True,
    corrections_age_limit=10.0,
    age_limit=0.10,
    gap_limit=0.15,
    stale_limit=0.15,
    jump_limit=0.25,
    heading_jump_limit=0.05,
    altitude_jump_limit=0.5,
    yaw_rate_jump_limit=0.1,
    acceleration_jump_limit=12.0,
    course_limit=0.20,
    course_speed=3.0,
    settling=0.5,
)

#: NMEA 0183: a car may drive on it, and it is the lower class. RTK-fixed (GGA), position accuracy (GST) and the age of
#: corrections are required as of NCOM; accuracies of heading and velocity are what the rig declares (the decoder puts
#: them in). Acceleration is differenced speed, free of gravity, so no pitch is needed. The time limits allow for 10
#: fixes a second, one of which may be lost, and 50 ms on the wire; a prediction over 0.25 s that misses braking at
#: 5 m/s2 is 0.16 m wrong. The yaw rate is differenced heading, late by 50 ms: a bend entered at 0.6 rad/s of yaw is
#: 0.03 rad off it, and 0.01 rad are noise. In return a step of the heading shows by half: the least found is 0.16 rad.
#: Noise of 0.08 rad makes 0.8 rad/s of a yaw rate that is differenced over 0.1 s. Positions may have no more than five
#: decimals of a minute, the fewest that are enough for RTK.
NMEA: Final = replace(
    DRIVE,
    name="nmea",
    pitch_needed=False,
    age_limit=0.15,
    gap_limit=0.25,
    stale_limit=0.25,
    heading_jump_limit=0.08,
    yaw_rate_jump_limit=0.8,
    position_step=0.0186,
)

#: u-blox: judged as NMEA, whose rates it shares; its accuracies are the receiver's own. Positions in steps of 1e-7
#: degrees.
UBX: Final = replace(NMEA, name="ubx", position_step=0.0112)

#: Septentrio and NovAtel: likewise, with positions as doubles. The yaw rate is differenced, or the receiver's own
#: difference, and the acceleration is differenced speed with gravity's share by the pitch: no pitch is needed.
SBF: Final = replace(NMEA, name="sbf", position_step=0.0)
NOVATEL: Final = replace(SBF, name="novatel")

#: CAN output of an OXTS unit: as NCOM, with positions in steps of 1e-7 degrees.
OXTS_CAN: Final = replace(DRIVE, name="oxts_can", position_step=0.0112)

#: Recordings: no quality, no real time, as few as 2 fixes a second; a car is never armed on them.
PLAYBACK: Final = TrustProfile(
    name="playback",
    may_arm=False,
    live=False,
    position_sigma_limit=math.inf,
    velocity_sigma_limit=math.inf,
    heading_sigma_limit=math.inf,
    pitch_needed=False,
    corrections_age_limit=math.inf,
    age_limit=math.inf,
    gap_limit=1.0,
    stale_limit=1.0,
    jump_limit=1.0,
    heading_jump_limit=math.inf,
    altitude_jump_limit=math.inf,
    yaw_rate_jump_limit=math.inf,
    acceleration_jump_limit=math.inf,
    course_limit=0.35,
    course_speed=3.0,
    settling=0.0,
)


@fast_frozen
@dataclass(frozen=True, slots=True)
class Trust:
    """The gate's answer about one fix."""

    trusted: bool
    reasons: tuple[str, ...]  #: keys of `REASONS`, empty when trusted


_RTK_FIXED: Final = FixQuality.RTK_FIXED  # found once, for every fix: looking it up in its class costs a call


def _of_the_fix(fix: Fix, profile: TrustProfile) -> list[str]:
    """Reasons against the fix by its own content."""
    reasons = []
    total = fix.time + fix.latitude + fix.longitude + fix.velocity_north + fix.velocity_east
    if not math.isfinite(total + fix.yaw_rate + fix.acceleration):
        reasons.append("not_finite")
    if abs(fix.yaw_rate) > YAW_RATE_LIMIT or abs(fix.acceleration) > ABSURD_ACCELERATION:
        reasons.append("motion_absurd")
    if fix.altitude < MIN_ALTITUDE or fix.altitude > MAX_ALTITUDE:
        reasons.append("altitude_absurd")
    if abs(fix.pitch) > TILT_LIMIT or abs(fix.roll) > TILT_LIMIT:
        reasons.append("tilt_absurd")
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
    """Reasons against the fix by the receiver's own status and accuracies."""
    reasons = []
    if profile.pitch_needed and not math.isfinite(fix.pitch):
        reasons.append("pitch_invalid")
    if fix.locked is not True:  # so that nothing else passes for it, not a number either
        reasons.append("status_not_locked")
    if fix.quality is not _RTK_FIXED:
        reasons.append("not_rtk_fixed")
    if not 0.0 <= fix.position_sigma <= profile.position_sigma_limit:
        reasons.append("position_sigma")
    if not 0.0 <= fix.velocity_sigma <= profile.velocity_sigma_limit:
        reasons.append("velocity_sigma")
    if not 0.0 <= fix.heading_sigma <= profile.heading_sigma_limit:
        reasons.append("heading_sigma")
    if not 0.0 <= fix.differential_age <= profile.corrections_age_limit:
        reasons.append("corrections_old")
    return reasons


def _off_the_velocity(last: Fix, fix: Fix) -> tuple[float, float]:
    """How far the newer fix lies from where the velocities lead, north and east [m]."""
    step = fix.time - last.time
    north = (fix.latitude - last.latitude) * EARTH_RADIUS
    east = math.remainder(fix.longitude - last.longitude, math.tau) * EARTH_RADIUS * math.cos(fix.latitude)
    return (
        north - 0.5 * step * (fix.velocity_north + last.velocity_north),
        east - 0.5 * step * (fix.velocity_east + last.velocity_east),
    )


def _off_the_yaw_rate(last: Fix, fix: Fix) -> float:
    """How far the newer heading lies from where the yaw rates lead [rad]; 0 where a heading is missing.

    A missing heading is a reason by itself; it is not compared here.
    """
    turned = fix.heading - last.heading - 0.5 * (fix.time - last.time) * (fix.yaw_rate + last.yaw_rate)
    return math.remainder(turned, math.tau) if math.isfinite(turned) else 0.0


def _off_the_climb(last: Fix, fix: Fix) -> float:
    """How far the newer altitude lies from where the vertical velocities lead [m].

    Without vertical velocities, how far it lies beyond what the steepest road explains.
    """
    step, climbed = fix.time - last.time, fix.altitude - last.altitude
    down = fix.velocity_down + last.velocity_down
    if math.isfinite(down):
        return abs(climbed + 0.5 * step * down)
    fast = math.hypot(fix.velocity_north, fix.velocity_east) + math.hypot(last.velocity_north, last.velocity_east)
    return abs(climbed) - MAX_SLOPE * 0.5 * step * fast


def _of_the_rest(last: Fix, fix: Fix, profile: TrustProfile) -> list[str]:
    """Reasons against a fix by the one before it, in all but position, horizontal velocity and heading."""
    step = fix.time - last.time
    reasons = []
    faster = abs(fix.velocity_down - last.velocity_down)
    if (
        _off_the_climb(last, fix) > profile.altitude_jump_limit + 0.25 * ACCELERATION_LIMIT * step * step
        or faster > ACCELERATION_LIMIT * step + VELOCITY_NOISE
    ):
        reasons.append("altitude_jump")
    tilt = TILT_RATE * step + TILT_NOISE
    if abs(fix.pitch - last.pitch) > tilt or abs(fix.roll - last.roll) > tilt:
        reasons.append("tilt_jump")
    if (
        abs(fix.yaw_rate - last.yaw_rate) > YAW_ACCELERATION_LIMIT * step + profile.yaw_rate_jump_limit
        or abs(fix.acceleration - last.acceleration) > profile.acceleration_jump_limit
    ):
        reasons.append("motion_jump")
    return reasons


def _speed(fix: Fix) -> float:
    return math.hypot(fix.velocity_north, fix.velocity_east)


def _of_one_step(
    last: Fix, fix: Fix, off: tuple[float, float, float], frozen: bool, profile: TrustProfile
) -> list[str]:
    """Reasons against a fix by the one before it; both are finite, and `fix` is the newer.

    `off` is how far the fix lies from where the one before leads, north and east [m], and its heading [rad];
    `frozen` whether its position stays the same though it must not.
    """
    step = fix.time - last.time
    north, east, turned = off
    reasons = []
    faster = math.hypot(fix.velocity_north - last.velocity_north, fix.velocity_east - last.velocity_east)
    if not faster <= ACCELERATION_LIMIT * step + VELOCITY_NOISE:
        reasons.append("velocity_jump")
    if abs(turned) > profile.heading_jump_limit:
        reasons.append("heading_jump")
    if frozen:
        reasons.append("frozen_pose")
    if not math.hypot(north, east) <= profile.jump_limit + 0.25 * ACCELERATION_LIMIT * step * step:
        reasons.append("pose_jump")
    return reasons


#: a fix with one of these cannot be of this car: it is not kept, and the next fix is compared with the one before it
_TRACELESS: Final = frozenset({"not_finite", "fix_from_future", "motion_absurd", "altitude_absurd", "tilt_absurd"})

#: after one of these, fixes must agree among themselves for the profile's `settling`
_UNSETTLING: Final = frozenset({"gap", "pose_jump", "pose_drift", "velocity_jump", "heading_jump", "heading_drift"})


#: after one of these, the drift is counted from zero
_BREAKING: Final = frozenset({"gap", "pose_jump", "velocity_jump", "heading_jump"})


#: what a late, repeated or misdated message, or a jump before it, says against a fix: not the receiver's quality
_OF_THE_WAY: Final = frozenset({"time_not_increasing", "fix_too_old", "fix_from_future", "gap", "settling"})


class TrustGate:
    """Judges fixes one by one against their history.

    `epoch` is the GNSS second of drive time 0. The history moves on with every fix that is finite, not absurd, newer
    than the one before and not from the future, trusted or not; so a jump is one reason once, and then `settling`. A
    jump of what is neither position, horizontal velocity nor heading affects only its own fix: the history does not
    move on, and the next fix is compared with the one before the jump. If such jumps go on, they become a gap.

    Of a profile that judges live quality, fixes that are refused again and again are a fault of their own, `unsteady`,
    also where enough trusted ones come between them. A fix that is refused for its way alone does not count there.
    """

    def __init__(self, profile: TrustProfile, epoch: float) -> None:
        self._profile = profile
        self._epoch = epoch
        # Position minus integrated velocity since the first fix, north and east [m], and heading minus integrated yaw
        # rate [rad]; then the same with their times, of the fixes in the window.
        self._drift = (0.0, 0.0, 0.0)
        self._drifts: deque[tuple[float, float, float, float]] = deque()
        self._last: Fix | None = None
        self._unchanged = 0.0  # how far the car has gone since its position last changed [m]
        self._unsettled_until = -math.inf
        self._trusted_until = -math.inf
        self._steadiness = Steadiness()

    @property
    def profile(self) -> TrustProfile:
        """How strict the gate is; fixed for its life."""
        return self._profile

    def step(self, now: float, fix: Fix) -> Trust:
        """Judge `fix` at drive time `now` [s]."""
        profile = self._profile
        reasons = _of_the_fix(fix, profile)
        if profile.live:
            reasons += _of_the_receiver(fix, profile)
            reasons += self._of_the_age(now, fix)
        if _TRACELESS.isdisjoint(reasons):
            reasons += self._of_the_history(fix)
        if not reasons:
            self._trusted_until = fix.time - self._epoch + profile.stale_limit
            self._steadiness.step(now, refused=False)
        elif not _OF_THE_WAY.issuperset(reasons):
            self._steadiness.step(now, refused=True)
        return Trust(not reasons, tuple(reasons))

    def stale(self, now: float) -> tuple[str, ...]:
        """Return ("pose_stale",) when the last trusted fix was made too long before drive time `now`, else ()."""
        return () if now <= self._trusted_until else ("pose_stale",)

    def unsteady(self) -> tuple[str, ...]:
        """Return ("pose_unsteady",) while fixes are refused too often to drive on those between them, else ()."""
        return ("pose_unsteady",) if self._profile.live and self._steadiness.unsteady else ()

    def _of_the_age(self, now: float, fix: Fix) -> list[str]:
        age = now - (fix.time - self._epoch)
        if age < -FUTURE_LIMIT:
            return ["fix_from_future"]
        return [] if age <= self._profile.age_limit else ["fix_too_old"]

    def _of_the_history(self, fix: Fix) -> list[str]:
        last = self._last
        if last is None:
            self._last = fix
            return []
        if not fix.time > last.time:
            return ["time_not_increasing"]
        gap = fix.time - last.time > self._profile.gap_limit
        if not gap and (jumps := _of_the_rest(last, fix, self._profile)):
            return jumps
        self._last = fix
        reasons = ["gap"] if gap else self._of_the_step(last, fix)
        if not _BREAKING.isdisjoint(reasons):
            # Older fixes cannot be compared with any more. Fixes that agree for `settling` fill the window again.
            self._drifts.clear()
            self._unchanged = 0.0
        if not _UNSETTLING.isdisjoint(reasons):
            self._unsettled_until = fix.time + self._profile.settling
        elif fix.time < self._unsettled_until:
            reasons.append("settling")
        return reasons

    def _of_the_step(self, last: Fix, fix: Fix) -> list[str]:
        """Reasons by how far the fix lies from where the one before leads, in this step and over the window."""
        off = *_off_the_velocity(last, fix), _off_the_yaw_rate(last, fix)
        reasons = _of_one_step(last, fix, off, self._frozen(last, fix), self._profile)
        return reasons + self._drifting(fix.time, off) if _BREAKING.isdisjoint(reasons) else reasons

    def _frozen(self, last: Fix, fix: Fix) -> bool:
        """Whether the position stays the same over a way on which the wire would say another one."""
        same = fix.latitude == last.latitude and fix.longitude == last.longitude
        slower = min(_speed(last), _speed(fix)) if same else 0.0
        self._unchanged = self._unchanged + slower * (fix.time - last.time) if slower > FROZEN_SPEED else 0.0
        return self._unchanged > FROZEN_STEPS * self._profile.position_step

    def _drifting(self, time: float, off: tuple[float, float, float]) -> list[str]:
        """Reasons by a drift over the window before `time` [s], in steps `off` that are each too small to be found."""
        (north, east, turned), (more_north, more_east, more_turned) = self._drift, off
        north, east, turned = north + more_north, east + more_east, turned + more_turned
        self._drift = (north, east, turned)
        drifts = self._drifts
        drifts.append((time, north, east, turned))
        while drifts[0][0] < time - DRIFT_WINDOW:
            drifts.popleft()
        _, first_north, first_east, first_turned = drifts[0]
        reasons = []
        if not math.hypot(north - first_north, east - first_east) <= self._profile.jump_limit:
            reasons.append("pose_drift")
        if abs(turned - first_turned) > self._profile.heading_jump_limit:
            reasons.append("heading_drift")
        return reasons
