"""What a study of delay and noise shows, as parts of the page: where the margin goes to zero.

Knows the tables of a cliff; computes none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency_margin import DELAY, NOISE, LatencyMargin, latency_margin_of
from vve_sumo.report.html import Html, folded, sub, tag
from vve_sumo.report.picture import Picture, drawn
from vve_sumo.report.tables import meanings, of_frame

if TYPE_CHECKING:
    import pandas as pd

CAPTION = (
    "Above: the mean margin over the hidden delay of the pose, a line for each noise factor, shaded down to the least "
    "of its runs, beside what would be left if speed times delay were lost. In the middle: how far off its path the "
    "car came at most; what is less than 0.01 m stands at 0.01 m. Below: the share of runs that passed."
)


def study_of(sweep: Sweep) -> LatencyMargin | None:
    """Return the cliff of a sweep that is the standard study of delay and noise; None of any other."""
    return latency_margin_of(sweep) if sorted(sweep.parameters) == sorted((DELAY, NOISE)) else None


def sentences(cliff: LatencyMargin) -> tuple[str, ...]:
    """Return what the study came to, a sentence for each noise factor."""
    return tuple(f"{line[:1].upper()}{line[1:]}." for line in cliff.verdicts())


def shown(cliff: LatencyMargin) -> Html:
    """Return the edges of the cliff as a table, and every step folded."""
    said = tag("ul", *(tag("li", line) for line in sentences(cliff)))
    edges, steps = _in_ms(cliff.edges), _in_ms(cliff.steps)
    return sub(
        "The cliff",
        said,
        of_frame(edges, "where the margin goes to zero"),
        folded("What the columns are", meanings(edges)),
        folded("Every step", of_frame(steps, "every step"), meanings(steps)),
    )


def _in_ms(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with its times in milliseconds, which delays are told in, and texts that break."""
    times = [column for column in table.columns if column.endswith("_s")]
    told = table.assign(**{column: 1000.0 * table[column] for column in times})
    told["missed"] = told["missed"].str.replace("+", ", ")
    names = {column: f"{column[:-2]}_ms" for column in times}
    told = told.rename(columns=names)
    told.attrs = {"meanings": {names.get(key, key): text for key, text in table.attrs["meanings"].items()}}
    return told


def picture(cliff: LatencyMargin) -> Picture:
    """Return the plot of a cliff."""
    from vve_sumo import plotting

    return drawn(plotting.latency_margin(cliff), "cliff", "margin over hidden delay", CAPTION)
