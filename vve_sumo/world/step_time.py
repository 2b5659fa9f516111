"""Keeps SUMO's step short enough for a live tick: refuses and thins traffic before a deadline is at risk.

Takes how long each step took; has no clock of its own and knows nothing of ticks. It removes only traffic far from
every ego, never an obstacle, a proxy or an ego.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Sequence, Set
from dataclasses import asdict, dataclass
from typing import Any, Final

import libsumo

LIMIT: Final = 0.012  #: longest step within a tick of 20 ms [s]; the rest is for the tick and the machine's jitter
RELAX_SHARE: Final = 0.6  #: below this share of the limit there is room for more traffic

#: The RANK-th longest of the last WINDOW steps is judged. Two outliers may be the machine's; a load that recurs once a
#: second, such as drivers who all act in the same step, is the traffic's.
WINDOW: Final = 150
RANK: Final = 3

SETTLING_STEPS: Final = 50  #: steps between two measures, in which the first can take effect
PROTECTED_RADIUS: Final = 250.0  #: no vehicle nearer to an ego is removed [m]; beyond the radar's range
MIN_REMOVED_SHARE: Final = 0.1  #: smallest share of the vehicles that is removed at a time


class TrafficMeasure(enum.Enum):
    """What is to be done about the traffic after a step."""

    NOTHING = enum.auto()
    REFUSE = enum.auto()  #: from now on no vehicle enters far from every ego
    THIN = enum.auto()  #: remove some vehicles that are far away
    ADMIT = enum.auto()  #: vehicles may enter again


@dataclass(slots=True)
class StepTimeSummary:
    """SUMO's step times and the measures taken, for the record."""

    limit_s: float  #: longest step allowed
    steps: int = 0  #: number of measured steps
    longest_s: float = 0.0  #: longest of all steps
    worst_s: float = 0.0  #: greatest judged value
    before_s: float = math.nan  #: judged value at the first measure; NaN if there was none
    now_s: float = math.nan  #: last judged value; NaN while too few steps were measured
    refusals: int = 0  #: how often the road was closed to departures
    refused: int = 0  #: vehicles removed at their departure while it was closed
    removed: int = 0  #: vehicles removed by thinning
    fits: bool = False  #: whether the last steps kept the limit


class StepTimeJudge:
    """Decides, from the time that steps take, which measure is due; takes none itself."""

    def __init__(self, limit: float = LIMIT) -> None:
        """Keep steps below `limit` [s]."""
        self.summary = StepTimeSummary(limit)
        self.closed = False  #: whether departures are refused
        self.share = 0.0  #: share of the vehicles that the next thinning removes
        self._times: deque[float] = deque(maxlen=WINDOW)
        self._since = 0  # steps since the last measure
        self._patience = WINDOW  # steps after a measure before the road may open again; doubles each time

    def step(self, took: float) -> TrafficMeasure:
        """Take the duration of a step [s] and return the measure that is due."""
        self._times.append(took if took >= 0.0 else math.inf)  # NaN must not count as a short step
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

    def _measure(self, judged: float) -> TrafficMeasure:
        if not judged <= self.summary.limit_s and (self._since >= SETTLING_STEPS or not self.closed):
            return self._hold_back(judged)
        if self.closed and self._since >= self._patience and judged < RELAX_SHARE * self.summary.limit_s:
            self.closed, self._since = False, 0
            self._patience *= 2
            return TrafficMeasure.ADMIT
        return TrafficMeasure.NOTHING

    def _hold_back(self, judged: float) -> TrafficMeasure:
        """Close the road to departures first; thin its traffic where that was not enough."""
        if math.isnan(self.summary.before_s):
            self.summary.before_s = judged
        measure = TrafficMeasure.THIN if self.closed else TrafficMeasure.REFUSE
        self.summary.refusals += not self.closed
        self.closed, self._since = True, 0
        # The time is about proportional to the number of vehicles.
        self.share = max(MIN_REMOVED_SHARE, 1.0 - self.summary.limit_s / judged)
        # Slow steps before the measure do not count against the remaining traffic.
        self._times.clear()
        return measure


class StepTimeBudget:
    """Limits the traffic of the running simulation so that SUMO's step fits into a live tick."""

    def __init__(self, limit: float = LIMIT) -> None:
        """Keep steps below `limit` [s]."""
        self._budget = StepTimeJudge(limit)
        self._to_stagger: dict[int, list[tuple[str, float]]] | None = None

    @property
    def fits(self) -> bool:
        """Whether enough steps were measured and kept the limit; otherwise no car is armed."""
        return self._budget.summary.fits

    @property
    def summary(self) -> dict[str, Any]:
        """The figures so far, for the record; unknown times are None."""
        values = asdict(self._budget.summary)
        return {name: None if value != value else value for name, value in values.items()}

    def step(self, took: float, egos: Sequence[tuple[float, float]], keep: Set[str]) -> None:
        """Take the duration of the last step [s]; refuse or remove traffic where it is due.

        `egos` are the egos' places, x and y [m]; `keep` are the vehicles that are not traffic. Raises SUMO's errors.
        """
        budget = self._budget
        self._stagger(budget.summary.steps, keep)
        if budget.closed:
            budget.summary.refused += _remove(_far(libsumo.simulation.getDepartedIDList(), egos, keep))
        if budget.step(took) is TrafficMeasure.THIN:
            everyone = libsumo.vehicle.getIDList()
            far = _far(everyone, egos, keep)
            budget.summary.removed += _remove(far[: math.ceil(budget.share * (len(everyone) - len(keep)))])

    def _stagger(self, step: int, keep: Set[str]) -> None:
        """Spread the times at which drivers act over the steps of their action step length, during the first steps.

        Drivers under way at the start entered in the same step and would always act in the same steps: one step in five
        or in fifty would carry all the work.
        """
        if self._to_stagger is None:
            self._to_stagger = _spread([name for name in libsumo.vehicle.getIDList() if name not in keep])
        turns = self._to_stagger.pop(step, [])
        here = set(libsumo.vehicle.getIDList()) if turns else set()
        for name, length in turns:
            if name in here:
                libsumo.vehicle.setActionStepLength(name, length, resetActionOffset=True)


def _spread(names: list[str]) -> dict[int, list[tuple[str, float]]]:
    """Return, by step from now on, the vehicles that shall act in it, each with its action step length [s]."""
    period = libsumo.simulation.getDeltaT()
    turns: dict[int, list[tuple[str, float]]] = {}
    for i, name in enumerate(names):
        length = libsumo.vehicle.getActionStepLength(name)
        steps = round(length / period)
        if steps > 1:
            turns.setdefault(i % steps, []).append((name, length))
    return turns


def _far(names: tuple[str, ...], egos: Sequence[tuple[float, float]], keep: Set[str]) -> list[str]:
    """Return the traffic beyond PROTECTED_RADIUS of every ego, farthest first."""
    distances = []
    for name in names:
        if name not in keep:
            x, y = libsumo.vehicle.getPosition(name)
            distances.append((min(math.hypot(x - ego_x, y - ego_y) for ego_x, ego_y in egos), name))
    return [name for distance, name in sorted(distances, reverse=True) if distance > PROTECTED_RADIUS]


def _remove(names: list[str]) -> int:
    for name in names:
        libsumo.vehicle.remove(name)
    return len(names)
