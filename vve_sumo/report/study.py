"""The study of delay and noise: at which delay the margin goes to zero.

Knows the tables of a latency margin; computes none of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency_margin import DELAY, NOISE, LatencyMargin, latency_margin_of
from vve_sumo.report.picture import DrawnPlot, picture_of

if TYPE_CHECKING:
    import pandas as pd

CAPTION = (
    "Above: the mean margin over the hidden delay of the pose, a line for each noise factor, shaded down to the least "
    "of its runs, beside what would be left if speed times delay were lost. In the middle: how far off its path the "
    "car came at most; what is less than 0.01 m stands at 0.01 m. Below: the share of runs that passed."
)


def study_of(sweep: Sweep) -> LatencyMargin | None:
    """Return the latency margin of a sweep that is the standard study of delay and noise; None of any other."""
    return latency_margin_of(sweep) if sorted(sweep.parameters) == sorted((DELAY, NOISE)) else None


def sentences(margin: LatencyMargin) -> tuple[str, ...]:
    """Return the result of the study, a sentence for each noise factor."""
    lines = [*margin.verdicts()]
    if not math.isfinite(margin.design_margin):
        lines.append("nothing is known of the delay that the controller's steering bears by its design")
    return tuple(f"{line[:1].upper()}{line[1:]}." for line in lines)


def in_ms(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of the study with its times in milliseconds, as delays are given, and texts that break."""
    names = {column: f"{column[:-2]}_ms" for column in table.columns if column.endswith("_s")}
    shown = table.assign(**{column: 1000.0 * table[column] for column in names})
    shown["missed"] = shown["missed"].str.replace("+", ", ")
    shown = shown.rename(columns=names)
    shown.attrs = {"meanings": {names.get(key, key): text for key, text in table.attrs["meanings"].items()}}
    return shown


def picture(margin: LatencyMargin) -> DrawnPlot:
    """Return the plot of a latency margin."""
    from vve_sumo import plotting

    return picture_of(plotting.latency_margin(margin), "latency_margin", "margin over hidden delay", CAPTION)
