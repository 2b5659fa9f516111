"""The top line of a report: its word (passed, FAILED, explored …), and how the drive ended with its key figures.

Reads figures that others measured; must not know how the page looks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from vve_sumo.analysis.run import Run
from vve_sumo.drive.reasons import in_words
from vve_sumo.drive.termination import END_REASONS
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import SPACE, number
from vve_sumo.vehicle.arming import DRIVER_REASONS

#: the verdict itself
Word = Literal[
    "passed", "FAILED", "explored", "not judged", "broken off", "altered", "INCOMPLETE", "GO", "NO-GO", "not examined"
]
#: gaps that differ by less are the same to a reader [m]
SAME = 0.005


@dataclass(frozen=True, slots=True)
class ReportVerdict:
    """The verdict at the top of the page."""

    word: Word
    sentences: tuple[str, ...]  #: how the drive or the sweep ended

    @property
    def line(self) -> str:
        """The verdict and the sentences in one line."""
        return f"{self.word}: {' '.join(self.sentences)}".replace(SPACE, " ")


def figures_of(run: Run) -> dict[str, Any]:
    """Return the figures of a drive: those of its summary, or of a drive that was killed, measured up to its end."""
    if run.summary is not None and "max_speed_mps" in run.summary:
        return run.summary
    return PER_DRIVE.measure(run.data) | {
        name: value for name, value in (run.summary or {}).items() if value is not None
    }


def of_drive(run: Run, figures: Mapping[str, Any]) -> ReportVerdict:
    """Return the verdict on a drive; `figures` are those of `figures_of`."""
    outcome = figures.get("outcome")
    if outcome is None:
        return ReportVerdict("broken off", (_cut_short(run, figures), *_closest(figures)))
    if outcome in ("broken", "interrupted"):
        return ReportVerdict("broken off", (_ending(run, outcome, figures), *_closest(figures)))
    passed = figures.get("passed")
    word: Word = "not judged" if passed is None else ("passed" if passed else "FAILED")
    ending = _ending(run, outcome, figures)
    return ReportVerdict(
        word, (ending, *_hunting(figures), *_braked_for(figures, ending), *_closest(figures), *_unmet(figures))
    )


def altered(verdict: ReportVerdict, parts: Sequence[str]) -> ReportVerdict:
    """Return the verdict on a record of which `parts` are not as the drive left them, which makes it worth nothing."""
    warning = f"Changed since the drive: {', '.join(parts)}. The following is what the record says now."
    return ReportVerdict("altered", (warning, *verdict.sentences))


def _hunting(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a sentence on an approach on which the car gained speed and braked again, time after time."""
    if not figures.get("hunting"):
        return ()
    times = int(_number(figures, "hunting_reversals"))
    return (f"It was hunting on its way to rest: its acceleration changed sign {times} times.",)


def _braked_for(figures: Mapping[str, Any], ending: str) -> tuple[str, ...]:
    """Return a sentence on whom the car braked hardest for, unless the sentence `ending` names that actor."""
    actor = _named(figures)
    if not actor or actor in ending:
        return ()
    return (f"It braked hardest, with {number(_number(figures, 'max_deceleration_mps2'), 'm/s²')}, for {actor}.",)


def _named(figures: Mapping[str, Any]) -> str:
    """Return whom the car braked hardest for, or whom it stopped for; empty for nobody."""
    return str(figures.get("hardest_braking_for") or figures.get("braked_for") or "")


def _unmet(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a sentence with every criterion that the drive did not meet, what came and what was expected."""
    if figures.get("passed") is not False:
        return ()
    lines = [_in_words(str(line)) for line in figures.get("failed") or ()]
    return (f"Not met: {'; '.join(lines)}.",) if lines else ()


def _in_words(line: str) -> str:
    key, found, rest = line.partition(" is ")
    return f"{label_of(key)}{found}{rest} {unit_of(key)}".rstrip() if found else line


def _cut_short(run: Run, figures: Mapping[str, Any]) -> str:
    speed = run.motion.speed
    known = speed[~(speed != speed)]
    moving = f", with the car at {number(float(known[-1]), 'm/s')}" if len(known) else ""
    ended = f"The record ends after {number(float(run.time[-1]), 's')}{moving}"
    also = f" It hit {_hit(run, figures)}." if figures.get("collision") else ""
    return f"{ended}: the drive was killed or still goes on, and it has not been judged.{also}"


def _ending(run: Run, outcome: str, figures: Mapping[str, Any]) -> str:
    """Return how the drive ended, as a sentence."""
    why = "; ".join(in_words(code) for code in figures.get("reasons") or ()) or "for no stated reason"
    text = str(figures.get("text") or "").removesuffix(".")
    at = number(_number(figures, "duration_s"), "s")
    hit = _hit(run, figures)
    sentences = {
        "stopped": _rest(run, figures),
        "arrived": f"The car drove to the end of its path{_gap_at_rest(run, figures)}.",
        "contact": f"The car hit {hit}{_after_contact(figures, at)}.",
        "driver_has_control": "The driver took over.",
        "fault": f"The gateway stopped the car: {why}.",
        "timeout": f"The scenario's time ran out after {at}.",
        "completed": f"The scenario ended the drive after {at}: {why}.",
        "played": f"A recorded drive of {at} was sent through the pipeline; no car executed the commands.",
        "interrupted": f"The drive was ended {_place_of_the_stop(figures)} after {at}.",
        "broken": f"The simulation broke after {at}: {text or why}.",
    }
    also = f" It hit {hit}." if figures.get("collision") and outcome != "contact" else ""
    return sentences.get(outcome, f"The drive ended: {outcome}.") + also


def _after_contact(figures: Mapping[str, Any], at: str) -> str:
    """Return what ended a drive after its contact: the scenario's end trigger, the driver, or that the car stopped."""
    codes: Sequence[str] = figures.get("reasons") or ()
    if not END_REASONS.isdisjoint(codes[:1]):
        return f"; the scenario ended the drive after {at}: {in_words(codes[0])}"
    return "; then the driver took over" if not DRIVER_REASONS.isdisjoint(codes) else " and then stopped"


def _place_of_the_stop(figures: Mapping[str, Any]) -> str:
    by_page = "stop_asked_by_page" in (figures.get("reasons") or ())[:1]
    return "over the page in a browser" if by_page else "from the keyboard"


def _rest(run: Run, figures: Mapping[str, Any]) -> str:
    gap = _number(figures, "stop_gap_m")
    if math.isnan(gap):
        return "The car came to rest with no object ahead."
    return f"The car came to rest {number(gap, 'm')} before {_ahead_at_rest(run)}."


def _gap_at_rest(run: Run, figures: Mapping[str, Any]) -> str:
    gap = _number(figures, "stop_gap_m")
    return "" if math.isnan(gap) else f" and stands {number(gap, 'm')} before {_ahead_at_rest(run)}"


def _ahead_at_rest(run: Run) -> str:
    """Return what the gap at rest is to: the nearest in the strip then, whom the car may never have followed."""
    return next(iter(run.data.strip_lead.actor[-1:]), "") or "the object ahead"


def _hit(run: Run, figures: Mapping[str, Any]) -> str:
    """Return the actors of the first contact, and the impact speed where that is known."""
    names = next((names for names in run.arrow("ticks")["contacts"].to_pylist() if names), "")
    speed = _number(figures, "impact_speed_mps")
    at = "" if math.isnan(speed) else f" at {number(speed, 'm/s')}"
    return f"{' and '.join(names.split('+')) or 'something'}{at}"


def _closest(figures: Mapping[str, Any]) -> tuple[str, ...]:
    gap, rest, ttc = (_number(figures, name) for name in ("min_gap_m", "stop_gap_m", "min_ttc_s"))
    if math.isnan(gap):
        if actor := _named(figures):
            return (f"The car was on a collision course with {actor}, which never was in its path.",)
        return ("No object was ever in the car's way.",)
    time = "" if math.isnan(ttc) else f"; the minimum time to collision was {number(ttc, 's')}"
    if gap < 0.0:
        return (f"Along its path the car came {number(-gap, 'm')} into the object ahead{time}.",)
    if abs(rest - gap) < SAME:
        return (f"The car was never closer to an object in its path{time}.",)
    return (f"The smallest gap to an object in the car's path was {number(gap, 'm')}{time}.",)


def _number(figures: Mapping[str, Any], name: str) -> float:
    value = figures.get(name)
    return math.nan if value is None else float(value)
