"""The metrics of a drive tick by tick: a column each, in the order of the table of `over_time`.

To add one, write its function here with its row above it. NaN stands wherever a metric has nothing to say: nothing
ahead, nothing that closes in, no pose. Reads a drive's tables; nothing of who asks.
"""

from __future__ import annotations

import numpy as np

from vve_sumo.metrics import following
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.metric import MetricTable
from vve_sumo.metrics.slope import SLOPE_REACH, slope
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.values import Floats

PER_TICK: MetricTable[DriveData] = MetricTable()
metric = PER_TICK.metric


@metric("time_s", "drive time", "drive time of the tick")
def time(drive: DriveData) -> Floats:
    """Drive time."""
    return drive.motion.time


@metric(
    "speed_mps",
    "speed",
    "ego's rear axle along its heading, forward positive: the truth where there is one, else the estimate",
)
def speed(drive: DriveData) -> Floats:
    """Speed."""
    return drive.motion.speed


@metric("acceleration_mps2", "acceleration", "rate of change of speed_mps")
def acceleration(drive: DriveData) -> Floats:
    """Acceleration."""
    return drive.motion.acceleration


@metric(
    "jerk_mps3",
    "jerk",
    f"rate of change of acceleration_mps2: slope of the line that fits best within ±{SLOPE_REACH} s",
)
def jerk(drive: DriveData) -> Floats:
    """Jerk."""
    return slope(drive.motion.time, drive.motion.acceleration, drive.period)


@metric(
    "gap_m",
    "gap",
    "front bumper to the nearest box in the ego's strip, along the path; negative is overlap",
    worse="lower",
)
def gap(drive: DriveData) -> Floats:
    """Gap."""
    return drive.lead.gap


@metric(
    "closing_speed_mps",
    "closing speed",
    "ego's speed minus the leader's along the path, closing positive",
    worse="higher",
)
def closing_speed(drive: DriveData) -> Floats:
    """Closing speed."""
    return drive.lead.closing_speed


@metric("leader", "lead vehicle", "actor that the gap is to; empty where there is none", kind="str")
def leader(drive: DriveData) -> list[str]:
    """Name of the lead vehicle."""
    return drive.lead.actor


@metric("headway_s", "time headway", "gap over ego's speed", worse="lower", source="SUMO's safety device, TGAP")
def headway(drive: DriveData) -> Floats:
    """Headway, bumper to bumper."""
    return _finite(following.headway(drive.lead.gap, _or_rest(drive.motion.speed)))


@metric(
    "headway_front_s",
    "time headway, front to front",
    "gap and leader's length over ego's speed: front to front",
    worse="lower",
    source="Highway Capacity Manual",
)
def headway_front(drive: DriveData) -> Floats:
    """Headway, front to front."""
    return _finite(following.headway_front(drive.lead.gap, _or_rest(drive.motion.speed), drive.lead_motion.length))


@metric("ttc_s", "TTC", "time to collision: gap over closing speed", worse="lower", source="Hayward 1972")
def ttc(drive: DriveData) -> Floats:
    """Time to collision."""
    return drive.lead.time_to_collision


@metric(
    "mttc_s",
    "modified TTC",
    "time to collision at constant accelerations: smallest positive root of gap - dv t - da t²/2",
    worse="lower",
    source="Ozbay, Yang, Bartin and Mudigonda 2008",
)
def mttc(drive: DriveData) -> Floats:
    """Modified time to collision."""
    lead, closing = drive.lead, drive.motion.acceleration - drive.lead_motion.acceleration
    modified = following.modified_time_to_collision(lead.gap, lead.closing_speed, closing)
    return np.where(lead.gap > 0.0, _finite(modified), np.nan)


@metric(
    "drac_mps2",
    "DRAC",
    "deceleration rate to avoid a crash: closing speed squared over twice the gap, braking positive",
    worse="higher",
    source="Almqvist, Hydén and Risser 1991",
)
def drac(drive: DriveData) -> Floats:
    """Deceleration rate to avoid a crash."""
    return drive.lead.required_deceleration


@metric(
    "required_deceleration_mps2",
    "MDRAC",
    "DRAC after the declared dead time of the brakes; inf where that uses up the gap",
    worse="higher",
    source="SUMO's safety device, MDRAC",
)
def mdrac(drive: DriveData) -> Floats:
    """DRAC with the dead time of the brakes."""
    lead = drive.lead
    needed = following.required_deceleration(lead.gap, lead.closing_speed, drive.vehicle.brake_delay)
    return np.where(lead.closes, needed, np.nan)


@metric(
    "rss_distance_m",
    "RSS safe distance",
    "least safe gap of Responsibility-Sensitive Safety for two cars that go the same way",
    source="Shalev-Shwartz, Shammah and Shashua 2017",
)
def rss_distance(drive: DriveData) -> Floats:
    """Safe distance of RSS."""
    return following.rss_distance(_or_rest(drive.motion.speed), _or_rest(drive.lead_motion.speed))


@metric(
    "ttc_2d_s",
    "TTC of boxes",
    "least time until the ego's box touches an actor's, both going on steadily; 0 at overlap",
    worse="lower",
)
def ttc_2d(drive: DriveData) -> Floats:
    """Time to collision in the plane."""
    return drive.first_touch[0]


@metric(
    "ttc_2d_actor", "actor of the TTC of boxes", "actor of ttc_2d_s; empty where no box would be touched", kind="str"
)
def ttc_2d_actor(drive: DriveData) -> list[str]:
    """Actor of the time to collision in the plane."""
    return drive.first_touch[1]


@metric("lateral_deviation_m", "lateral deviation", "rear axle from the path, left positive")
def lateral_deviation(drive: DriveData) -> Floats:
    """Lateral deviation."""
    return drive.tracking.lateral_deviation


@metric("heading_error_rad", "heading error", "ego's heading minus the path's, left positive")
def heading_error(drive: DriveData) -> Floats:
    """Heading error."""
    return drive.tracking.heading_error


@metric("pose_age_s", "pose age", "tick minus epoch of the newest trusted fix", worse="higher")
def pose_age(drive: DriveData) -> Floats:
    """Age of the newest trusted fix."""
    return drive.column("pose_age_s")


def _or_rest(speed: Floats) -> Floats:
    """Return speeds, 0 where the car is at rest."""
    return np.where(np.abs(speed) < AT_REST, 0.0, speed)


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)
