"""The delay margins of a steering loop: as predicted, and as drives with more and more delay measured them.

Reads the folder of a study's search. It must not know how the drives were driven, nor how a margin is predicted.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd

    from vve_sumo.analysis.dataset import Sweep

#: beside a study's rows: what is predicted
NOTE: Final = "study.json"
#: what the search varied
SPEED, MASS = "ego.speed_mps", "ego.car.mass_factor"
OBSERVER, DELAY = "controller.tuning.cdob_time_constant_s", "ego.car.steering_delay_s"

MARGINS: Final = {
    "speed_mps": "of the car at the step",
    "mass_factor": "true over declared mass",
    "observer_s": "time constant of the observer that bears delay; 0 for none",
    "predicted_s": "delay at which the loop becomes unstable by its closed form; infinite where none does",
    "measured_s": "the same by drives, in the middle of two steps; NaN where every drive was stable, or none",
    "stable_to_s": "the greatest delay below it whose drive was stable",
    "unstable_from_s": "the next step, whose drive was not; NaN where every drive was stable",
    "difference_percent": "measured over predicted margin, less 100 %",
}

#: predicted margin [s] at a speed [m/s], with a mass factor and an observer's time constant [s]
Predict = Callable[[float, float, float], float]


@dataclass(frozen=True, slots=True)
class SteeringStudy:
    """What a study of a steering loop's delay came to."""

    title: str
    margins: pd.DataFrame  #: columns of MARGINS, a row for each speed, mass factor and observer, all rising
    greatest: float  #: delay that was tried at most [s]
    reason: str = ""  #: why nothing is predicted; empty where it is

    def verdicts(self) -> Iterator[str]:
        """Return a sentence on the loop without and one on the loop with the observer, and why nothing is predicted."""
        for observed, rows in self.margins.groupby(self.margins["observer_s"] > 0.0):
            word = "with the observer" if observed else "without an observer"
            measured = rows["measured_s"].dropna()
            bears = f"{_ms(measured.min())} to {_ms(measured.max())}" if len(measured) else "no measured margin"
            stable = int((rows["unstable_from_s"].isna() & rows["stable_to_s"].notna()).sum())
            beyond = f"; stable at all delays up to {_ms(self.greatest)} in {stable} of {len(rows)}" if stable else ""
            apart = rows["difference_percent"].abs().max()
            off = f"; at most {apart:.1f} % from the closed form" if math.isfinite(apart) else ""
            yield f"{word}: {bears}{beyond}{off}"
        if self.reason:
            yield self.reason


def keep_prediction(sweep: Sweep, predict: Predict, reason: str) -> None:
    """Write beside a study's rows what is predicted for each of its lines [s], or why nothing is."""
    lines = [_line(values) for values in _values(sweep)]
    predicted = [None if reason or not math.isfinite(margin := predict(*line)) else margin for line in lines]
    endless = [not reason and math.isinf(predict(*line)) for line in lines]
    note = {"predicted_delay_margin_s": predicted, "endless": endless, "reason": reason}
    (sweep.folder / NOTE).write_text(json.dumps(note) + "\n", encoding="utf-8")


def steering_study_of(sweep: Sweep) -> SteeringStudy:
    """Return the margins of a study's folder; raises ConfigError where it is none, or goes on."""
    import pandas as pd

    note, greatest = _noted(sweep.folder / NOTE), float(sweep.plan["spec"]["parameters"][DELAY]["to"])
    rows = []
    for number, line in enumerate(_boundaries(sweep)):
        speed, mass, observer = _line(line["values"])
        predicted = note["predicted_delay_margin_s"][number]
        margin = math.inf if note["endless"][number] else math.nan if predicted is None else predicted
        first = next((flip for flip in line["flips"] if flip["meets"] < flip["fails"]), None)
        stable, unstable = (first["meets"], first["fails"]) if first else (math.nan, math.nan)
        if first is None and line["meets_first"]:
            stable = greatest
        measured = 0.5 * (stable + unstable) if line["meets_first"] else math.nan
        apart = 100.0 * (measured / margin - 1.0) if math.isfinite(margin) else math.nan
        rows.append((speed, mass, observer, margin, measured, stable, unstable, apart))
    frame = pd.DataFrame(rows, columns=list(MARGINS)).sort_values(["observer_s", "mass_factor", "speed_mps"])
    return SteeringStudy(sweep.title, described(frame.reset_index(drop=True), MARGINS), greatest, str(note["reason"]))


def _boundaries(sweep: Sweep) -> list[dict[str, Any]]:
    found = sweep.search_result
    if found is None or found.get("along") != DELAY or found["search"] != "boundary":
        raise ConfigError(
            f"{sweep.folder}: no finished study of a steering loop: its drives were not searched by {DELAY}"
        )
    return list(found["boundaries"])


def _values(sweep: Sweep) -> list[dict[str, Any]]:
    return [line["values"] for line in _boundaries(sweep)]


def _line(values: dict[str, Any]) -> tuple[float, float, float]:
    return float(values[SPEED]), float(values[MASS]), float(values[OBSERVER])


def _noted(file: Path) -> dict[str, Any]:
    try:
        note: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        note["predicted_delay_margin_s"], note["endless"], note["reason"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{file}: not what a study of a steering loop writes: {error}") from None
    return note


def _ms(seconds: float) -> str:
    return f"{1000.0 * seconds:.0f} ms"
