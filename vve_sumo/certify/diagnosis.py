"""Names the likely defects of a brain from which cases failed and how: from behaviour alone.

Rules as data. Where a brain already fails without a fault, the nominal drive itself is looked at, and the ghosts.
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
RATE_UNIT: Final = "unit of range rate: km/h where m/s are meant?"
NOT_DRIVING: Final = "does not drive the scenario without a fault"
STEERING_SIGN: Final = "sign of steering: left is positive"
STEERING_SCALE: Final = "steering too large: degrees, or the angle of the steering wheel?"
ACCELERATION_SIGN: Final = "sign of acceleration: braking is negative"
ACCELERATION_SMALL: Final = "acceleration too small by a factor: in g?"
ACCELERATION_LARGE: Final = "acceleration too large: percent of a pedal, or a force?"
MIRRORED: Final = "azimuth is mirrored: sign of azimuth, left is positive (on an ESR's bus right)"

#: what the gateway made of setpoints that it did not take
REFUSED: Final = {
    "setpoint_lifetime": "the lifetime of its setpoints is beyond 0.1 s",
    "setpoint_replayed": "the sequence of its setpoints does not count up",
    "setpoint_unasked": "its setpoints answer a sequence or a time that no radar datagram has",
    "setpoint_late": "its setpoints answer radar datagrams of long ago",
    "setpoint_crc": "the CRC of its setpoints is wrong",
    "setpoint_length": "its setpoints have another length",
    "setpoint_magic": "its setpoints do not begin with VVES",
    "setpoint_version": "its setpoints are of another version",
    "setpoint_kind": "its setpoints are of another kind of datagram",
    "setpoint_not_finite": "its setpoints hold what is not a number",
    "setpoint_forged": "its setpoints are not signed with the rig's key",
}

#: road-wheel angles beyond this are no car's [rad]
GREATEST_STEERING: Final = 0.9
#: accelerations beyond this are no car's [m/s2]
GREATEST_ACCELERATION: Final = 15.0
#: who brakes for something asks for more than this at least once [m/s2]
LEAST_BRAKING: Final = 1.0
#: a brain that wants to drive off asks for more [m/s2]
MOVING_OFF: Final = 0.3
#: a drive begins with driving off, for so long at least [s]
DRIVING_OFF: Final = 1.0
#: of the path, from which on steering is looked at [m]
ASIDE: Final = (0.1, 3.0)
#: of the steering beyond what the way takes is to the wrong side
WRONG_WAY: Final = 0.8


class Rule(NamedTuple):
    """A defect that a failed case shows, unless a case that is more general failed as well."""

    case: str
    defect: str
    unless: tuple[str, ...] = ()  #: cases that fail for a reason that explains this one, too
    late: str = ""  #: the defect where the reaction came, but too late


_BLIND: Final = ("radar_drop_out",)

RULES: Final = (
    Rule("radar_invalid", "acts on radar marked invalid", _BLIND),
    Rule("radar_ageing", "does not check the age of the radar", _BLIND),
    Rule("radar_counter", "does not check the sequence of the radar", _BLIND),
    Rule("radar_bit_flips", "does not check the radar's CRC", _BLIND),
    Rule("radar_not_a_number", "takes what is not a number for a range", _BLIND),
    Rule("radar_drop_out", "drives on without radar"),
    Rule("radar_freeze", "takes repeated radar bytes for new ones", ("radar_drop_out", "radar_counter")),
    Rule("radar_delay", "acts on radar that arrives late", _BLIND),
    Rule("radar_gap", "a gap of two ticks in the radar upsets it"),
    Rule("radar_bit_flips_some", "single lost radar messages upset it", ("radar_gap",)),
    Rule("radar_delay_short", "does not reckon with the radar's age", ("radar_ageing",)),
    Rule("radar_ghost", "does not brake for a target that stands in its way", (), "reacts late to a target"),
    Rule("radar_ghost_receding", "brakes for what drives away"),
    Rule("radar_ghost_slower", "brakes hard for what hardly comes nearer: unit of range rate?"),
    Rule(
        "radar_bend_in_way",
        "does not brake for a target in a bend: azimuth mirrored, or its way taken for straight",
        ("radar_ghost", "radar_bend_mirrored", "radar_rows_beside"),
        "reacts late to a target in a bend",
    ),
    Rule("radar_bend_mirrored", MIRRORED),
    Rule("radar_rows_beside", "brakes for what stands beside its way: unit of azimuth?", ("radar_bend_mirrored",)),
    Rule("radar_passing_left", "brakes for what passes on the left"),
    Rule("radar_passing_right", "brakes for what is passed on the right", ("radar_rows_beside",)),
    Rule("radar_missing", "does not make up for targets that the radar misses for half a second"),
    Rule("sensor_drop_out", "drives on without its sensor"),
    Rule("sensor_freeze", "does not check whether its sensor's scans are new", ("sensor_drop_out",)),
    Rule("esr_error", "acts on an ESR that reports an error", ("sensor_drop_out",)),
    Rule("ars408_error", "acts on an ARS408 that reports an error", ("sensor_drop_out",)),
    Rule("gnss_drop_out", "drives on without GNSS"),
    Rule("gnss_freeze", "does not check the time of the GNSS", ("gnss_drop_out",)),
    Rule("gnss_delay", "acts on GNSS that arrives late", ("gnss_drop_out", "gnss_freeze")),
    Rule("gnss_bit_flips", "does not check NCOM's checksums", ("gnss_drop_out",)),
    Rule("gnss_bit_flips_some", "single lost GNSS packets upset it"),
    Rule("gnss_invalid", "acts on GNSS that is not locked", ("gnss_drop_out",)),
    Rule("nmea_invalid", "acts on NMEA without a fix", ("gnss_drop_out",)),
    Rule("both_freeze", "does not notice that all of its inputs stand", ("radar_freeze", "radar_counter")),
)


def diagnose(results: Iterable[CaseResult]) -> tuple[Defect, ...]:
    """Return the likely defects, the ones that explain others first; none where no case failed."""
    driven = [result for result in results if result.verdict in (CaseVerdict.PASSED, CaseVerdict.FAILED)]
    failed = {result.case.name for result in driven if result.verdict is CaseVerdict.FAILED}
    if not failed:
        return ()
    if "nominal" in failed:
        return _without_nominal(driven)
    named = [
        Defect(_name(rule, driven), (rule.case,))
        for rule in RULES
        if rule.case in failed and not failed & set(rule.unless)
    ]
    # Cases that explain each other only remain for somebody to look at.
    return tuple(named) or (Defect("no single defect explains the failed cases", tuple(sorted(failed))),)


def _name(rule: Rule, driven: Sequence[CaseResult]) -> str:
    reactions = [r.reaction for r in driven if r.case.name == rule.case and r.verdict is CaseVerdict.FAILED]
    return rule.late if rule.late and all(map(math.isfinite, reactions)) else rule.defect


def _without_nominal(driven: Sequence[CaseResult]) -> tuple[Defect, ...]:
    nominal = [
        result.course
        for result in driven
        if result.case.name == "nominal" and result.verdict is CaseVerdict.FAILED and result.course is not None
    ]
    refused = {code for course in nominal if not course.taken for code in course.refused}
    if named := [Defect(text, ("nominal",)) for code, text in REFUSED.items() if code in refused]:
        return tuple(named)
    if not any(course.answers for course in nominal):
        return (Defect(NOT_ANSWERING, ("nominal",)),)
    for shows, text in _OF_DRIVES:
        if all(map(shows, nominal)):
            return (Defect(text, ("nominal",)),)
    standing, receding = (_braked(driven, name) for name in ("radar_ghost", "radar_ghost_receding"))
    if receding and not standing:
        return (Defect(SIGN, ("nominal", "radar_ghost", "radar_ghost_receding")),)
    if _braked(driven, "radar_ghost_slower", -HARD_BRAKING) and not standing:
        return (Defect(RATE_UNIT, ("nominal", "radar_ghost", "radar_ghost_slower")),)
    return (Defect(NOT_DRIVING, ("nominal",)),)


def _braked(driven: Sequence[CaseResult], name: str, demand: float = -BRAKING_DEMAND) -> bool:
    """Whether the brain braked for a ghost in every drive of a case."""
    of_case = [result for result in driven if result.case.name == name]
    return bool(of_case) and all(result.extra_braking >= demand for result in of_case)


def _steers_too_much(course: CaseDrive) -> bool:
    return any(abs(answer.steering) > GREATEST_STEERING for answer in course.answers)


def _steers_away(course: CaseDrive) -> bool:
    """Whether the car left its path, and the brain steered away from the path while it did."""
    aside = np.abs(course.deviation)
    far = np.flatnonzero(aside > ASIDE[1])
    if not len(far):
        far = np.flatnonzero(aside >= 0.95 * np.nanmax(aside))
    time, deviation = course.time[: far[0] + 1], course.deviation[: far[0] + 1]
    times = np.array([answer.time for answer in course.answers])
    steering = np.array([answer.steering for answer in course.answers])
    if not len(times) or float(np.nanmax(aside)) < 2.0 * ASIDE[0]:
        return False
    at = np.minimum(np.searchsorted(times, time), len(times) - 1)
    looked_at = (np.abs(deviation) > ASIDE[0]) & (np.abs(time - times[at]) < ASIDE[0])
    if not looked_at.any():
        return False
    away = np.sign(steering[at][looked_at]) == np.sign(deviation[looked_at])
    return float(np.mean(away)) > WRONG_WAY


def _asks_too_much(course: CaseDrive) -> bool:
    return any(abs(answer.acceleration) > GREATEST_ACCELERATION for answer in course.answers)


def _asks_backwards(course: CaseDrive) -> bool:
    """Whether the brain asked for braking at the beginning of the drive, when it had to drive off, and came to rest."""
    begun = [answer.acceleration for answer in course.answers if answer.time < course.answers[0].time + DRIVING_OFF]
    return float(np.median(begun)) < -MOVING_OFF and not course.collision


def _asks_too_little(course: CaseDrive) -> bool:
    """Whether the brain never asked for as much as either driving off or stopping takes."""
    return all(abs(answer.acceleration) < LEAST_BRAKING for answer in course.answers)


#: what the nominal drive itself shows, in this order
_OF_DRIVES: Final[tuple[tuple[Callable[[CaseDrive], bool], str], ...]] = (
    (_asks_too_much, ACCELERATION_LARGE),
    (_asks_backwards, ACCELERATION_SIGN),
    (_steers_away, STEERING_SIGN),
    (_steers_too_much, STEERING_SCALE),
    (_asks_too_little, ACCELERATION_SMALL),
)
