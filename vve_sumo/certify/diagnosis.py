"""Names the likely defects of a brain by its behaviour alone: which cases failed, and how.

The rules are data. If a brain fails the nominal case, its nominal drives and the ghost cases are examined instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.certify.cases import BRAKING_DEMAND, HARD_BRAKING
from vve_sumo.certify.results import CaseDrive, CaseResult, CaseVerdict, Defect

NOT_ANSWERING: Final = "does not answer at all"
SIGN: Final = "sign of range rate"
RATE_UNIT: Final = "unit of range rate: km/h instead of m/s?"
NOT_DRIVING: Final = "does not drive the scenario without a fault"
STEERING_SIGN: Final = "sign of steering: left is positive"
STEERING_SCALE: Final = "steering too large: degrees, or the angle of the steering wheel?"
ACCELERATION_SIGN: Final = "sign of acceleration: braking is negative"
ACCELERATION_SMALL: Final = "acceleration too small by a factor: in g?"
ACCELERATION_LARGE: Final = "acceleration too large: percent of a pedal, or a force?"
MIRRORED: Final = "azimuth is mirrored: sign of azimuth, left is positive (on an ESR's bus right)"

#: defect by the reason code with which the gateway rejected setpoints
REFUSED: Final = {
    "setpoint_lifetime": "the lifetime of its setpoints is beyond 0.1 s",
    "setpoint_replayed": "the sequence of its setpoints does not count up",
    "setpoint_unasked": "its setpoints answer a sequence or a time that no radar datagram has",
    "setpoint_late": "its setpoints answer outdated radar datagrams",
    "setpoint_crc": "the CRC of its setpoints is wrong",
    "setpoint_length": "its setpoints have another length",
    "setpoint_magic": "its setpoints do not begin with VVES",
    "setpoint_version": "its setpoints are of another version",
    "setpoint_kind": "its setpoints are of another kind of datagram",
    "setpoint_not_finite": "its setpoints contain NaN or infinity",
    "setpoint_forged": "its setpoints are not signed with the rig's key",
}

#: largest road-wheel angle of any car [rad]
MAX_STEERING: Final = 0.9
#: largest acceleration of any car [m/s2]
MAX_ACCELERATION: Final = 15.0
#: driving off and stopping demand more than this at least once [m/s2]
MIN_DEMAND: Final = 1.0
#: driving off demands more than this [m/s2]
MOVE_OFF_ACCELERATION: Final = 0.3
#: shortest time of driving off at the begin of a drive [s]
MOVE_OFF_TIME: Final = 1.0
#: deviations from the path between which steering is examined [m]
MIN_DEVIATION, MAX_DEVIATION = 0.1, 3.0
#: largest time between a tick and the answer that is examined with it [s]
MAX_ANSWER_OFFSET: Final = 0.1
#: share of steering away from the path from which on its sign is wrong
MIN_WRONG_SHARE: Final = 0.8


class Rule(NamedTuple):
    """A defect that a failed case indicates, unless a more general case failed as well."""

    case: str
    defect: str
    unless: tuple[str, ...] = ()  #: cases whose failure explains this one
    late: str = ""  #: the defect where the reaction came, but too late


_BLIND: Final = ("radar_drop_out",)

RULES: Final = (
    Rule("radar_invalid", "acts on radar marked invalid", _BLIND),
    Rule("radar_ageing", "does not check the age of the radar", _BLIND),
    Rule("radar_counter", "does not check the sequence of the radar", _BLIND),
    Rule("radar_bit_flips", "does not check the radar's CRC", _BLIND),
    Rule("radar_not_a_number", "accepts NaN as a range", _BLIND),
    Rule("radar_drop_out", "drives on without radar"),
    Rule("radar_freeze", "takes repeated radar bytes for new ones", ("radar_drop_out", "radar_counter")),
    Rule("radar_delay", "acts on radar that arrives late", _BLIND),
    Rule("radar_gap", "does not tolerate a gap of two ticks in the radar"),
    Rule("radar_bit_flips_some", "does not tolerate single lost radar messages", ("radar_gap",)),
    Rule("radar_delay_short", "does not compensate the radar's age", ("radar_ageing",)),
    Rule("target_ghost", "does not brake for a standing target on its path", (), "reacts late to a target"),
    Rule("target_ghost_receding", "brakes for a target that drives away"),
    Rule("target_ghost_slower", "brakes hard for a target that approaches slowly: unit of range rate?"),
    Rule(
        "target_bend_in_way",
        "does not brake for a target in a bend: azimuth mirrored, or path assumed straight",
        ("target_ghost", "target_bend_mirrored", "target_rows_beside"),
        "reacts late to a target in a bend",
    ),
    Rule("target_bend_mirrored", MIRRORED),
    Rule("target_rows_beside", "brakes for targets beside its path: unit of azimuth?", ("target_bend_mirrored",)),
    Rule("target_passing_left", "brakes for a car that passes on the left"),
    Rule("target_passing_right", "brakes for a car that it passes on the right", ("target_rows_beside",)),
    Rule("target_missing", "does not bridge targets that its sensors miss for half a second"),
    Rule("sensor_drop_out", "drives on without its sensor"),
    Rule("sensor_freeze", "does not check whether its sensor's scans are new", ("sensor_drop_out",)),
    Rule("esr_error", "acts on an ESR that reports an error", ("sensor_drop_out",)),
    Rule("ars408_error", "acts on an ARS408 that reports an error", ("sensor_drop_out",)),
    Rule("camera_error", "acts on a camera that reports a failure", ("sensor_drop_out",)),
    Rule("camera_delay", "leaves no room for the camera's latency"),
    Rule("lidar_delay", "does not check the time of the lidar's packets", ("sensor_drop_out", "sensor_freeze")),
    Rule("v2x_delay", "does not know stations whose messages come late"),
    Rule("v2x_freeze", "forgets stations that say nothing new", ("v2x_delay",)),
    Rule("gnss_drop_out", "drives on without GNSS"),
    Rule("gnss_freeze", "does not check the time of the GNSS", ("gnss_drop_out",)),
    Rule("gnss_delay", "acts on GNSS that arrives late", ("gnss_drop_out", "gnss_freeze")),
    Rule("gnss_bit_flips", "does not check NCOM's checksums", ("gnss_drop_out",)),
    Rule("gnss_bit_flips_some", "does not tolerate single lost GNSS packets"),
    Rule("gnss_invalid", "acts on GNSS that is not locked", ("gnss_drop_out",)),
    Rule("nmea_invalid", "acts on NMEA without a fix", ("gnss_drop_out",)),
    Rule("both_freeze", "does not notice that all of its inputs are frozen", ("radar_freeze", "radar_counter")),
)


def diagnose(results: Iterable[CaseResult]) -> tuple[Defect, ...]:
    """Return the likely defects, more general ones first; none where no case failed."""
    driven = [result for result in results if result.verdict in (CaseVerdict.PASSED, CaseVerdict.FAILED)]
    failed = {result.case.name for result in driven if result.verdict is CaseVerdict.FAILED}
    if not failed:
        return ()
    if "nominal" in failed:
        return _of_failed_nominal(driven)
    named = [
        Defect(_name(rule, driven), (rule.case,))
        for rule in RULES
        if rule.case in failed and not failed & set(rule.unless)
    ]
    # Where failed cases only explain each other, a person must examine them.
    return tuple(named) or (Defect("no single defect explains the failed cases", tuple(sorted(failed))),)


def _name(rule: Rule, driven: Sequence[CaseResult]) -> str:
    reactions = [r.reaction for r in driven if r.case.name == rule.case and r.verdict is CaseVerdict.FAILED]
    return rule.late if rule.late and all(map(math.isfinite, reactions)) else rule.defect


def _of_failed_nominal(driven: Sequence[CaseResult]) -> tuple[Defect, ...]:
    nominal = [
        result.drive
        for result in driven
        if result.case.name == "nominal" and result.verdict is CaseVerdict.FAILED and result.drive is not None
    ]
    refused = {code for drive in nominal if not drive.taken for code in drive.refused}
    if named := [Defect(text, ("nominal",)) for code, text in REFUSED.items() if code in refused]:
        return tuple(named)
    if not any(drive.answers for drive in nominal):
        return (Defect(NOT_ANSWERING, ("nominal",)),)
    for applies, text in NOMINAL_RULES:
        if all(map(applies, nominal)):
            return (Defect(text, ("nominal",)),)
    standing, receding = (_braked(driven, name) for name in ("target_ghost", "target_ghost_receding"))
    if receding and not standing:
        return (Defect(SIGN, ("nominal", "target_ghost", "target_ghost_receding")),)
    if _braked(driven, "target_ghost_slower", -HARD_BRAKING) and not standing:
        return (Defect(RATE_UNIT, ("nominal", "target_ghost", "target_ghost_slower")),)
    return (Defect(NOT_DRIVING, ("nominal",)),)


def _braked(driven: Sequence[CaseResult], name: str, demand: float = -BRAKING_DEMAND) -> bool:
    """Whether the brain braked for a ghost in every drive of a case."""
    of_case = [result for result in driven if result.case.name == name]
    return bool(of_case) and all(result.extra_braking >= demand for result in of_case)


def _steers_too_much(drive: CaseDrive) -> bool:
    return any(abs(answer.steering) > MAX_STEERING for answer in drive.answers)


def _steers_away(drive: CaseDrive) -> bool:
    """Whether the car left its path while the brain steered away from the path."""
    distance = np.abs(drive.deviation)
    far = np.flatnonzero(distance > MAX_DEVIATION)
    if not len(far):
        far = np.flatnonzero(distance >= 0.95 * np.nanmax(distance))
    time, deviation = drive.time[: far[0] + 1], drive.deviation[: far[0] + 1]
    times = np.array([answer.time for answer in drive.answers])
    steering = np.array([answer.steering for answer in drive.answers])
    if not len(times) or float(np.nanmax(distance)) < 2.0 * MIN_DEVIATION:
        return False
    at = np.minimum(np.searchsorted(times, time), len(times) - 1)
    evaluated = (np.abs(deviation) > MIN_DEVIATION) & (np.abs(time - times[at]) < MAX_ANSWER_OFFSET)
    if not evaluated.any():
        return False
    away = np.sign(steering[at][evaluated]) == np.sign(deviation[evaluated])
    return float(np.mean(away)) > MIN_WRONG_SHARE


def _acceleration_too_large(drive: CaseDrive) -> bool:
    return any(abs(answer.acceleration) > MAX_ACCELERATION for answer in drive.answers)


def _acceleration_inverted(drive: CaseDrive) -> bool:
    """Whether the brain demanded braking at the begin of the drive, where it had to drive off, without a contact."""
    first_demands = [
        answer.acceleration for answer in drive.answers if answer.time < drive.answers[0].time + MOVE_OFF_TIME
    ]
    return float(np.median(first_demands)) < -MOVE_OFF_ACCELERATION and not drive.collision


def _acceleration_too_small(drive: CaseDrive) -> bool:
    """Whether the brain never demanded the acceleration that driving off and stopping take."""
    return all(abs(answer.acceleration) < MIN_DEMAND for answer in drive.answers)


#: defects that the nominal drives themselves show, in this order
NOMINAL_RULES: Final[tuple[tuple[Callable[[CaseDrive], bool], str], ...]] = (
    (_acceleration_too_large, ACCELERATION_LARGE),
    (_acceleration_inverted, ACCELERATION_SIGN),
    (_steers_away, STEERING_SIGN),
    (_steers_too_much, STEERING_SCALE),
    (_acceleration_too_small, ACCELERATION_SMALL),
)
