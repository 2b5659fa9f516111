"""Keeps SUMO's step short enough for a live tick: refuses and thins traffic before a deadline is at risk.

Takes how long each step took; has no clock of its own and knows nothing of ticks. What it takes off the street is far
from the ego and never an obstacle, a ghost or the ego.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Set
from dataclasses import asdict, dataclass
from typing import Any, Final

import libsumo

LIMIT: Final = 0.012  #: what a step may take of a tick's 20 ms [s]: the rest is the tick itself and the machine's whims
RELAX_SHARE: Final = 0.6  #: below this share of the limit there is room for more traffic

#: The third longest of so many steps is judged: two hiccups of the machine are not the traffic's, while what comes back
#: once a second (drivers who all act in the same step) is.
WINDOW: Final = 150
RANK: Final = 3

SETTLING_STEPS: Final = 50  #: steps between two measures: time for the one before to show
PROTECTED_RADIUS: Final = 250.0  #: around the ego nothing is taken off the street [m]; the radar reaches less far
MIN_REMOVED_SHARE: Final = 0.1  #: of the vehicles, taken off at a time


class Measure(enum.Enum):
    """What is to be done about the traffic after a step."""

    NOTHING = enum.auto()
    REFUSE = enum.auto()  #: from now on nobody enters the street
    THIN = enum.auto()  #: take some of those off that are far away
    ADMIT = enum.auto()  #: the street may fill again


@dataclass(slots=True)
class Summary:
    """What the street's load was and what was done about it, for the record."""

    limit_s: float  #: what a step may take
    steps: int = 0  #: measured
    longest_s: float = 0.0  #: of all steps
    worst_s: float = 0.0  #: greatest value that was judged
    before_s: float = math.nan  #: what was judged when the first measure was taken; NaN if none was
    now_s: float = math.nan  #: what was judged last; NaN while too few steps were measured
    refusals: int = 0  #: times that the street was closed to departures
    refused: int = 0  #: vehicles turned away while it was closed
    removed: int = 0  #: vehicles taken off
    fits: bool = False  #: whether the last steps kept the limit


class StepTimeJudge:
    """Judges the time that steps take; decides, and does nothing itself."""

    def __init__(self, limit: float = LIMIT) -> None:
        """Keep steps below `limit` [s]."""
        self.summary = Summary(limit)
        self.closed = False  #: whether departures are refused
        self.share = 0.0  #: of the vehicles to be taken off at the next thinning
        self._times: deque[float] = deque(maxlen=WINDOW)
        self._since = 0  # steps since the last measure
        self._patience = WINDOW  # steps with room before the street opens again; doubles each time

    def step(self, took: float) -> Measure:
        """Take the time of a step [s] and say what is to be done."""
        self._times.append(took if took >= 0.0 else math.inf)  # a NaN is no short time
        self._since += 1
        summary, judged = self.summary, self._judged()
        summary.steps += 1
        summary.longest_s = max(summary.longest_s, self._times[-1])
        summary.worst_s = max(summary.worst_s, judged)
        full = len(self._times) >= SETTLING_STEPS
        summary.now_s = judged if full else math.nan
        summary.fits = full and judged <= summary.limit_s
        return self._measure(judged)

    def _judged(self) -> float:
        longest = sorted(self._times)[-RANK:]
        return longest[0] if len(longest) == RANK else 0.0

    def _measure(self, judged: float) -> Measure:
        if not judged <= self.summary.limit_s and (self._since >= SETTLING_STEPS or not self.closed):
            return self._hold_back(judged)
        if self.closed and self._since >= self._patience and judged < RELAX_SHARE * self.summary.limit_s:
            self.closed, self._since = False, 0
            self._patience *= 2
            return Measure.ADMIT
        return Measure.NOTHING

    def _hold_back(self, judged: float) -> Measure:
        """Close the street first; thin it where that was not enough."""
        if math.isnan(self.summary.before_s):
            self.summary.before_s = judged
        measure = Measure.THIN if self.closed else Measure.REFUSE
        self.summary.refusals += not self.closed
        self.closed, self._since = True, 0
        # The time is about in proportion to the traffic.
        self.share = max(MIN_REMOVED_SHARE, 1.0 - self.summary.limit_s / judged)
        # What was slow before the measure must not be held against the traffic that is left.
        self._times.clear()
        return measure


class StepTimeBudget:
    """The traffic of the running simulation, held within what a live tick has room for."""

    def __init__(self, limit: float = LIMIT) -> None:
        """Keep steps below `limit` [s]."""
        self._budget = StepTimeJudge(limit)
        self._to_stagger: dict[int, list[tuple[str, float]]] | None = None

    @property
    def fits(self) -> bool:
        """Whether enough steps were measured on this street and they kept the limit; without it no car is armed."""
        return self._budget.summary.fits

    @property
    def summary(self) -> dict[str, Any]:
        """What was measured and done so far, for the record; times not known are None."""
        values = asdict(self._budget.summary)
        return {name: None if value != value else value for name, value in values.items()}

    def step(self, took: float, x: float, y: float, keep: Set[str]) -> None:
        """Take the time of the step just made [s]; hold the traffic back if need be.

        `x`, `y` [m] is where the ego is, `keep` the vehicles that are no traffic. Raises SUMO's errors.
        """
        budget = self._budget
        self._stagger(budget.summary.steps, keep)
        if budget.closed:
            budget.summary.refused += _remove(_far(libsumo.simulation.getDepartedIDList(), x, y, keep))
        if budget.step(took) is Measure.THIN:
            everyone = libsumo.vehicle.getIDList()
            far = _far(everyone, x, y, keep)
            budget.summary.removed += _remove(far[: math.ceil(budget.share * (len(everyone) - len(keep)))])

    def _stagger(self, step: int, keep: Set[str]) -> None:
        """Spread the moments at which drivers act over their action steps, during the first steps.

        All that were under way at the start entered in the same step and would act in the same steps for ever: one step
        in five or in fifty would carry all the work.
        """
        if self._to_stagger is None:
            self._to_stagger = _spread([name for name in libsumo.vehicle.getIDList() if name not in keep])
        turns = self._to_stagger.pop(step, [])
        here = set(libsumo.vehicle.getIDList()) if turns else set()
        for name, length in turns:
            if name in here:
                libsumo.vehicle.setActionStepLength(name, length, resetActionOffset=True)


def _spread(names: list[str]) -> dict[int, list[tuple[str, float]]]:
    """Return, by step from now on, the vehicles that are to act then, each with the length of its action step [s]."""
    period = libsumo.simulation.getDeltaT()
    turns: dict[int, list[tuple[str, float]]] = {}
    for i, name in enumerate(names):
        length = libsumo.vehicle.getActionStepLength(name)
        steps = round(length / period)
        if steps > 1:
            turns.setdefault(i % steps, []).append((name, length))
    return turns


def _far(names: tuple[str, ...], x: float, y: float, keep: Set[str]) -> list[str]:
    """Return the vehicles beyond PROTECTED_RADIUS of the ego that are traffic, farthest first."""
    distances = []
    for name in names:
        if name not in keep:
            at_x, at_y = libsumo.vehicle.getPosition(name)
            distances.append((math.hypot(at_x - x, at_y - y), name))
    return [name for distance, name in sorted(distances, reverse=True) if distance > PROTECTED_RADIUS]


def _remove(names: list[str]) -> int:
    for name in names:
        libsumo.vehicle.remove(name)
    return len(names)
