"""The stopping bound that a run set itself, beside what happened, and how its brakes answered beside their declaration.

Knows stops and the closed form of stopping; it must not know what was wrong with the car.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.analysis.brake_response import UNKNOWN, BrakeAnswer, TimeInterval, brake_answer
from vve_sumo.analysis.braking import Stop, stop_of
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.stopping_tolerance import Tolerance, tolerance

if TYPE_CHECKING:
    import pandas as pd

#: brakes that answer later or build up more slowly than declared by no more than this are as declared [s]; of nominal
#: drives the fit says 15 ms too much at most, at the lower end of its interval and on an estimated speed
LATE: Final = 0.03

#: columns of a sweep's rows that the check takes
ROW_COLUMNS: Final = ("stop_distance_m", "stop_bound_m", "stop_tolerance_m")

MEANINGS: Final = {
    "distance_m": "from the onset of the last stop to rest",
    "bound_m": "what the car as declared needs for it at most",
    "excess_m": "distance_m beyond bound_m; negative is better than promised",
    "tolerance_m": "what a sound car may take beyond bound_m; none where the car gained speed on the way",
    "held": "whether there was a stop to check, and distance_m lies within the bound and the tolerance",
    "broken": "whether there was a stop to check, and distance_m lies beyond them",
}


@dataclass(frozen=True, slots=True)
class StoppingBoundCheck:
    """What was promised of a run's last stop, and what came; NaN throughout where there was none."""

    onset_speed: float  #: [m/s]
    demand: float  #: what was granted, up to the declared deceleration, as a constant one [m/s2]
    latency: float  #: the worst from a tick to its last command frame during the stop [s]; 0 in lockstep
    brake_delay: float  #: declared dead time from frame to torque [s]
    brake_lag: float  #: declared lag of the brakes [s]
    bound: float  #: the closed form of them [m]
    distance: float  #: what the car took [m]
    terms: Tolerance  #: of what a sound car may take beyond the bound [m]; NaN where the car gained speed on the way
    answer: BrakeAnswer  #: how the brakes did answer, as far as the record tells

    @property
    def excess(self) -> float:
        """Distance beyond the bound [m]; negative is better than promised."""
        return self.distance - self.bound

    @property
    def tolerance(self) -> float:
        """What a sound car may take beyond the bound [m]."""
        return self.terms.total

    @property
    def missed(self) -> tuple[str, ...]:
        """What was not held: "distance", "reaction", "build-up".

        Where the brakes answered late together, and neither part is late for sure, it is "reaction or build-up".
        """
        declared, answer = (self.brake_delay, self.brake_lag), self.answer
        parts = zip(("reaction", "build-up"), (answer.reaction, answer.build_up), declared, strict=True)
        late = [name for name, found, promised in parts if _late(found, promised)]
        if not late and _late(answer.together, sum(declared)):
            late = ["reaction or build-up"]
        return (*(["distance"] if self.excess > self.tolerance else []), *late)

    @property
    def held(self) -> bool:
        """Whether there was a stop, it kept its bound, and its brakes did not answer late, as far as that is known."""
        return self.excess <= self.tolerance and not self.missed

    @property
    def broken(self) -> bool:
        """Whether there was a stop, and it broke its bound or its brakes answered late."""
        return bool(self.missed)


def _late(measured: TimeInterval, declared: float) -> bool:
    """Whether a part of the brakes' answer is later than tolerated, for sure; never where it is not known."""
    return measured.low > declared + LATE


#: of a stop that the closed form says nothing of
UNCHECKED: Final = Tolerance(*[math.nan] * 4)
#: of a drive without a stop
NONE: Final = StoppingBoundCheck(
    math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, UNCHECKED, UNKNOWN
)


def stopping_bound_check(run: Run) -> StoppingBoundCheck:
    """Return the stopping-bound check of a run's last stop.

    The bound is `laws.stopping_distance` of the onset's speed, the demand, the run's own worst latency plus the brakes'
    declared dead time, and their declared lag. Nothing in it was measured on the brakes: a car that answers
    late or gives less than was granted breaks it. But a loop that closes over speed makes up for what late brakes lost,
    and the distance hardly shows it. So dead time and lag are fitted to the commanded torque and judged by themselves.
    The distance may exceed the bound by `stopping_tolerance.tolerance`, and is not judged where the car gained speed.
    """
    stop = stop_of(run)
    if stop is None:
        return NONE
    latency, car = _latency(run, stop), run.vehicle
    return StoppingBoundCheck(
        stop.onset_speed,
        stop.demand,
        latency,
        car.brake_delay,
        car.brake_lag,
        stop.bound(car, latency),
        stop.distance,
        tolerance(stop, car, run.period),
        brake_answer(run, stop),
    )


def stopping_bound_checks(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the stopping-bound checks of a sweep's rows, a row each, by their index: the columns of MEANINGS.

    A sweep is driven in lockstep, so their bound has no latency in it. They judge the distance alone: rows hold no
    commanded torque to fit. A run without a stop is NaN, and neither held nor broken. Raises ConfigError where the rows
    do not have what it takes.
    """
    import pandas as pd

    missing = [column for column in ROW_COLUMNS if column not in rows]
    if missing:
        raise ConfigError(f"stopping-bound check: the rows have no column {missing[0]}: another vve-sumo drove them")
    distance, bound, tolerated = (rows[column].astype("float64") for column in ROW_COLUMNS)
    excess = distance - bound
    figures = {"distance_m": distance, "bound_m": bound, "excess_m": excess, "tolerance_m": tolerated}
    columns = {**figures, "held": excess <= tolerated, "broken": excess > tolerated}
    return described(pd.DataFrame(columns), MEANINGS)


def _latency(run: Run, stop: Stop) -> float:
    """Return the worst time from a tick of the stop to its last command frame [s]; NaN where none was taken down."""
    if not run.live:
        return 0.0
    if not run.holds("latency"):
        return math.nan
    ticks, table = run.arrow("ticks")["tick"].to_numpy(), run.arrow("latency")
    tick = table["tick"].to_numpy()
    took = table["framed_s"].to_numpy() - table["due_s"].to_numpy()
    during = took[(tick >= ticks[stop.onset]) & (tick <= ticks[stop.rest]) & np.isfinite(took)]
    return float(during.max()) if len(during) else math.nan
