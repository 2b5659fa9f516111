"""Names the likely defects of a brain from which cases failed and how: from behaviour alone.

Rules as data. Where a brain already fails without a fault, only the rules count that do without the nominal drive.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from vve_sumo.certify.cases import BRAKING_DEMAND
from vve_sumo.certify.results import CaseResult, Defect, Verdict

NOT_ANSWERING: Final = "does not answer at all"
SIGN: Final = "sign of range rate"
NOT_DRIVING: Final = "does not drive the scenario without a fault"


class Rule(NamedTuple):
    """A defect that a failed case shows, unless a case that is more general failed as well."""

    case: str
    defect: str
    unless: tuple[str, ...] = ()  #: cases that fail for a reason that explains this one, too


RULES: Final = (
    Rule("radar_invalid", "acts on radar marked invalid", ("radar_drop_out",)),
    Rule("radar_ageing", "does not check the age of the radar", ("radar_drop_out",)),
    Rule("radar_counter", "does not check the sequence of the radar", ("radar_drop_out",)),
    Rule("radar_bit_flips", "does not check the radar's CRC", ("radar_drop_out",)),
    Rule("radar_not_a_number", "takes what is not a number for a range", ("radar_drop_out",)),
    Rule("radar_drop_out", "drives on without radar"),
    Rule("radar_freeze", "takes repeated radar bytes for new ones", ("radar_drop_out", "radar_counter")),
    Rule("radar_delay", "acts on radar that arrives late", ("radar_drop_out",)),
    Rule("radar_gap", "a gap of two ticks in the radar upsets it"),
    Rule("radar_bit_flips_some", "single lost radar messages upset it", ("radar_gap",)),
    Rule("radar_delay_short", "does not reckon with the radar's age", ("radar_ageing",)),
    Rule("radar_ghost", "does not brake for a target that stands in its way"),
    Rule("radar_ghost_receding", "brakes for what drives away"),
    Rule("radar_missing", "does not make up for targets that the radar misses for half a second"),
    Rule("gnss_drop_out", "drives on without GNSS"),
    Rule("gnss_freeze", "does not check the time of the GNSS", ("gnss_drop_out",)),
    Rule("gnss_delay", "acts on GNSS that arrives late", ("gnss_drop_out", "gnss_freeze")),
    Rule("gnss_bit_flips", "does not check NCOM's checksums", ("gnss_drop_out",)),
    Rule("gnss_bit_flips_some", "single lost GNSS packets upset it"),
    Rule("gnss_invalid", "acts on GNSS that is not locked", ("gnss_drop_out",)),
    Rule("both_freeze", "does not notice that all of its inputs stand", ("radar_freeze", "radar_counter")),
)  # fmt: skip


def diagnose(results: Iterable[CaseResult]) -> tuple[Defect, ...]:
    """Return the likely defects, the ones that explain others first; none where every case passed."""
    driven = [result for result in results if result.verdict is not Verdict.NOT_APPLICABLE]
    failed = {result.case.name for result in driven if result.verdict is Verdict.FAILED}
    if not failed:
        return ()
    if "nominal" in failed:
        return _without_nominal(driven)
    named = [
        Defect(rule.defect, (rule.case,)) for rule in RULES if rule.case in failed and not failed & set(rule.unless)
    ]
    # Cases that explain each other only remain for somebody to look at.
    return tuple(named) or (Defect("no single defect explains the failed cases", tuple(sorted(failed))),)


def _without_nominal(driven: Sequence[CaseResult]) -> tuple[Defect, ...]:
    nominal = [result for result in driven if result.case.name == "nominal"]
    if not any(result.course is not None and result.course.answers for result in nominal):
        return (Defect(NOT_ANSWERING, ("nominal",)),)
    standing, receding = (_braked(driven, name) for name in ("radar_ghost", "radar_ghost_receding"))
    if receding and not standing:
        return (Defect(SIGN, ("nominal", "radar_ghost", "radar_ghost_receding")),)
    return (Defect(NOT_DRIVING, ("nominal",)),)


def _braked(driven: Sequence[CaseResult], name: str) -> bool:
    """Whether the brain braked for a ghost in every drive of a case."""
    of_case = [result for result in driven if result.case.name == name]
    return bool(of_case) and all(result.extra_braking >= -BRAKING_DEMAND for result in of_case)
