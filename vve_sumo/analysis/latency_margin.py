"""The latency margin: what margin a scenario leaves as delay and noise grow, and where it goes to zero.

Reads the rows of a study's sweep. It must not know how they were driven, nor where a design's delay margin comes from.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.analysis.groups import grouped
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

    from vve_sumo.analysis.dataset import Sweep

#: beside a study's rows: what it knows of the design
NOTE: Final = "study.json"
#: of a row: what the study varies
DELAY, NOISE = "ego.car.gnss_hidden_delay_s", "ego.car.noise_factor"
#: of a row: how far off its path the ego came
LATERAL: Final = "max_lateral_deviation_m"
#: a drive that ended so was stopped by its gateway or broke: where it stands says nothing of the margin
CUT_SHORT: Final = frozenset({"fault", "completed", "broken", "interrupted"})

STEPS: Final = {
    "noise_factor": "size of the receiver's noise over what it says of itself",
    "delay_s": "by which a fix is older than its epoch says",
    "runs": "finished runs",
    "judged": "of them that passed or failed; the others have an error",
    "passed_share": "of the judged runs, those that met every criterion",
    "margins": "runs that have a margin: they ended by themselves or with a contact",
    "contacts": "of them with a contact, which leaves a margin of zero or less",
    "stopped_by_gateway": "runs that the gateway stopped, without a contact: they have no margin",
    "mean_margin_m": "mean margin of these",
    "least_margin_m": "least margin of these",
    "closed_form_m": "mean margin at the least delay, minus speed times the delay beyond it",
    "lateral_deviation_m": "greatest distance from the path, of any run",
    "missed": "criteria that a run missed, joined by +",
    "stopped_for": "why the gateway stopped runs before their end, reason codes joined by +",
}
EDGES: Final = {
    "noise_factor": "size of the receiver's noise over what it says of itself",
    "zero_s": "delay at which the mean margin is zero, straight between two steps; NaN where it stays above",
    "zero_from_s": "the last step before it",
    "zero_to_s": "the first step at which nothing is left",
    "touched_from_s": "the first step at which a run has nothing left; NaN where none is so",
    "known_to_s": "the last step at which a run has a margin; beyond it all break or are stopped far off",
    "closed_form_zero_s": "the same, were speed times delay all that is lost",
    "passed_to_s": "the last step up to which every run passed; NaN where the first has one that did not",
    "failed_from_s": "the step after it: the first with a run that did not; NaN where all passed",
    "missed": "criteria that were missed there, joined by +",
    "stopped_for": "why the gateway stopped runs there, reason codes joined by +",
}


@dataclass(frozen=True, slots=True)
class LatencyMargin:
    """What a study of delay and noise came to."""

    title: str
    scenario: str
    speed: float  #: that the scenario asks for [m/s]
    steps: pd.DataFrame  #: columns of STEPS, a row for each factor and delay, both rising
    edges: pd.DataFrame  #: columns of EDGES, a row for each factor
    design_margin: float  #: delay that the steering loop bears by its design at that speed [s]; NaN for none known

    def verdicts(self) -> Iterator[str]:
        """Return a sentence for each noise factor, and one on the design's margin."""
        last = float(self.steps["delay_s"].max())
        for edge in self.edges.to_dict("records"):
            words = "; ".join((_of_margin(edge, last), *_of_the_least(edge), _of_criteria(edge)))
            yield f"noise x {edge['noise_factor']:g}: {words}"
        if math.isfinite(self.design_margin):
            yield (
                f"by its design the steering loop bears {_ms(self.design_margin)} at {self.speed:.1f} m/s, of which "
                "the pipeline's own way from pose to wheels takes a part"
            )


def _of_margin(edge: Mapping[Any, Any], last: float) -> str:
    closed = edge["closed_form_zero_s"]
    says = f"speed times delay says {_ms(closed)}" if math.isfinite(closed) else "there was no margin to begin with"
    if not math.isfinite(edge["known_to_s"]):
        return "no run has a margin"
    if not math.isfinite(edge["zero_s"]):
        beyond = ", beyond which no run has one" if edge["known_to_s"] < last else ""
        return f"the mean margin does not go to zero up to {_ms(edge['known_to_s'])}{beyond} ({says})"
    if not edge["zero_from_s"] < edge["zero_to_s"]:
        return f"the mean margin is zero from the first step on, {_ms(edge['zero_s'])}"
    between = f"between {_ms(edge['zero_from_s'])} and {_ms(edge['zero_to_s'])}"
    return f"the mean margin goes to zero at {_ms(edge['zero_s'])}, {between} ({says})"


def _of_the_least(edge: Mapping[Any, Any]) -> list[str]:
    """Say where a run has nothing left, unless the mean has nothing left by then either."""
    touched, zero = edge["touched_from_s"], edge["zero_to_s"]
    sooner = math.isfinite(touched) and not touched >= zero
    return [f"from {_ms(touched)} on a run has nothing left"] if sooner else []


def _of_criteria(edge: Mapping[Any, Any]) -> str:
    if not math.isfinite(edge["failed_from_s"]):
        return "every run passed"
    missed = f" ({edge['missed'].replace('+', ', ')})" if edge["missed"] else ""
    stopped = f", the gateway stops for {edge['stopped_for'].replace('+', ', ')}" if edge["stopped_for"] else ""
    return f"from {_ms(edge['failed_from_s'])} on not every run passes{missed}{stopped}"


def _ms(time: float) -> str:
    return f"{1000.0 * time:.0f} ms"


def latency_margin_of(sweep: Sweep, *, design_margin: float | None = None) -> LatencyMargin:
    """Return the latency margins that a study's dataset shows, finished or not.

    `design_margin` [s] is laid beside it; left out, it is the one that the study noted beside its rows. Raises
    ConfigError where the sweep varied something else, or the note cannot be read.
    """
    if sorted(sweep.parameters) != sorted((DELAY, NOISE)):
        varied = ", ".join(sweep.parameters) or "nothing"
        raise ConfigError(f"{sweep.folder}: no study of delay and noise: it varied {varied}")
    ego = sweep.plan["table"].get("ego")
    if ego is None:
        raise ConfigError(f"{sweep.folder}: no study of delay and noise: its scenario says nothing of the ego")
    speed = float(ego["speed_mps"])
    steps = steps_of(sweep.rows(), speed)
    margin = _noted(sweep.folder / NOTE) if design_margin is None else design_margin
    return LatencyMargin(sweep.title, sweep.scenario, speed, steps, edges_of(steps, speed), margin)


def keep_design_margin(folder: Path, margin: float) -> None:
    """Write the design's margin [s], or that there is none, beside a study's rows."""
    note = {"design_delay_margin_s": margin if math.isfinite(margin) else None}
    (folder / NOTE).write_text(json.dumps(note) + "\n", encoding="utf-8")


def _noted(file: Path) -> float:
    """Return the design's margin that a study's note tells [s]; NaN where it knows none, or there is no note."""
    try:
        margin = json.loads(file.read_text(encoding="utf-8"))["design_delay_margin_s"]
    except FileNotFoundError:
        return math.nan
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{file}: not what a study writes: {error}") from None
    if not (margin is None or isinstance(margin, float)):
        raise ConfigError(f"{file}: design_delay_margin_s: expected a number of seconds or null, got {margin!r}")
    return math.nan if margin is None else margin


def margins(rows: pd.DataFrame) -> Floats:
    """Return what each run had left [m]: the gap at rest, or the least where it did not end at rest.

    A contact leaves zero or less, as deep as the boxes came to overlap. A car that the gateway stopped for another
    reason shows no margin: to stand far off is no merit, and nobody knows what it would have left. NaN for that, where
    nothing was ahead, and where the run has an error. The margin of a run depends on that run alone.
    """
    stop, least = (rows[name].to_numpy(np.float64, na_value=np.nan) for name in ("stop_gap_m", "min_gap_m"))
    touched = rows["collision"].eq(True).fillna(False).to_numpy(bool)
    cut = rows["outcome"].isin(CUT_SHORT).to_numpy(bool) | rows["outcome"].isna().to_numpy(bool)
    free = np.where(np.isfinite(stop), stop, least)
    left: Floats = np.where(touched, np.fmin(np.fmin(stop, least), 0.0), np.where(cut, np.nan, free))
    return left


def steps_of(rows: pd.DataFrame, speed: float) -> pd.DataFrame:
    """Return the table of STEPS over rows of a study at a speed [m/s]."""
    frame = rows.assign(margin_m=margins(rows)).sort_values([NOISE, DELAY], kind="stable")
    steps = grouped(frame, [NOISE, DELAY], ["margin_m", LATERAL]).rename(
        columns={NOISE: "noise_factor", DELAY: "delay_s", "margin_m_count": "margins", "collisions": "contacts"}
    )
    steps["lateral_deviation_m"] = steps[f"greatest_{LATERAL}"]
    first = steps.groupby("noise_factor")[["delay_s", "mean_margin_m"]].transform("first")
    # The first that is there counts: where the least delay has no margin, its own delay must go with it.
    at = steps["delay_s"].where(steps["mean_margin_m"].notna()).groupby(steps["noise_factor"]).transform("first")
    steps["closed_form_m"] = first["mean_margin_m"] - speed * (steps["delay_s"] - at)
    groups = [group for _values, group in frame.groupby([NOISE, DELAY], sort=False)]
    steps["missed"], steps["stopped_for"] = [*map(_missed, groups)], [*map(_stopped_for, groups)]
    return described(steps[list(STEPS)].reset_index(drop=True), STEPS)


def _missed(rows: pd.DataFrame) -> str:
    met = [name for name in rows.columns if name.startswith("meets_")]
    return "+".join(name.removeprefix("meets_") for name in met if rows[name].eq(False).any())


def _stopped_for(rows: pd.DataFrame) -> str:
    fault_reasons = rows["reasons"][rows["outcome"].eq("fault").fillna(False).to_numpy(bool)]
    return "+".join(dict.fromkeys(reason for reasons in fault_reasons for reason in reasons.split("; ")))


def edges_of(steps: pd.DataFrame, speed: float) -> pd.DataFrame:
    """Return the table of EDGES over that of STEPS, at a speed [m/s]."""
    import pandas as pd

    rows = [_edge(float(str(factor)), group, speed) for factor, group in steps.groupby("noise_factor")]
    return described(pd.DataFrame(rows, columns=list(EDGES)), EDGES)


def _edge(factor: float, steps: pd.DataFrame, speed: float) -> dict[str, Any]:
    delay, margin = steps["delay_s"].to_numpy(np.float64), steps["mean_margin_m"].to_numpy(np.float64)
    passed = (steps["passed_share"] == 1.0) & (steps["judged"] == steps["runs"])
    known, spent = np.isfinite(margin), steps["least_margin_m"].to_numpy(np.float64) <= 0.0
    zero, before, after = zero_of(delay[known], margin[known])
    failed = next((number for number, good in enumerate(passed) if not good), len(delay))
    return {
        "noise_factor": factor,
        "zero_s": zero,
        "zero_from_s": before,
        "zero_to_s": after,
        "touched_from_s": delay[spent][0] if spent.any() else math.nan,
        "known_to_s": delay[known][-1] if known.any() else math.nan,
        "closed_form_zero_s": _closed(delay[known], margin[known], speed),
        "passed_to_s": delay[failed - 1] if failed else math.nan,
        "failed_from_s": delay[failed] if failed < len(delay) else math.nan,
        **{name: steps[name].iloc[failed] if failed < len(delay) else "" for name in ("missed", "stopped_for")},
    }


def _closed(delay: Floats, margin: Floats, speed: float) -> float:
    return float(delay[0] + margin[0] / speed) if len(delay) and margin[0] > 0.0 and speed > 0.0 else math.nan


def zero_of(delay: Sequence[float] | Floats, margin: Sequence[float] | Floats) -> tuple[float, float, float]:
    """Return where a margin [m] over rising delays [s] first goes to zero, and the steps on either side [s].

    Straight between the two; all three are the first delay where nothing is left from the start, and NaN where the
    margin stays above zero.
    """
    if len(delay) and not margin[0] > 0.0:
        return (float(delay[0]),) * 3
    for (at, left), (then, rest) in pairwise(zip(delay, margin, strict=True)):
        if not rest > 0.0:
            return float(at + (then - at) * left / (left - rest)), float(at), float(then)
    return math.nan, math.nan, math.nan
