"""Which of the parameters that were varied matter to a figure, and so which of them a plot shows.

Knows rows and names of columns; nothing of plots, nor of how a sweep chose its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.survivors import contacts, ranked
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError, hint
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: levels of a parameter; one with more numbers than these, as a drawn one, is cut into so many portions of equal width
LEVELS: Final = 10

MEANINGS: Final = {
    "levels": "values of the parameter, or portions of its range, among the runs that have a rank",
    "runs": "runs that have a rank by the figure and the parameter, which another controller may not have",
    "contacts": "of them with a contact, which ranks beyond every value of a gap, a time to collision or a DRAC",
    "without": "runs that have neither the figure nor a contact, and so no rank",
    "explained_share": "eta squared of the ranks: sum of squares between the levels over the total one",
    "adjusted_share": "epsilon squared: the same less what as many levels would explain by chance; may be below 0",
}


class Axes(NamedTuple):
    """Which parameters a plot of a figure shows; None for one that there is none for."""

    x: str | None  #: the number that explains most
    y: str | None  #: the number that explains most of the rest
    by: str | None  #: what tells its lines or panels apart: the controller where there are several, or other texts


def variance_explained(rows: pd.DataFrame, figure: str, parameters: Sequence[str]) -> pd.DataFrame:
    """Return how much of the variance of a figure's ranks each parameter explains by itself, the greatest share first.

    The runs are ranked, so that those with a contact take part: they lie beyond every gap, and a study whose worst runs
    all collide would otherwise be one of its mild runs alone. One-way analysis of variance of the ranks, a truth value
    as 0 and 1: a row a parameter with the columns of MEANINGS. Shares of crossed parameters add up to at most 1; what
    is left is their interplay and chance. Eta squared is Pearson's correlation ratio (1905), of ranks the statistic of
    Kruskal and Wallis (1952) over the runs less one; epsilon squared is that of Kelley (1935), by which the rows are
    ordered, as many levels explain something by chance. NaN where the figure is the same in all runs, or where a
    parameter has one value. Raises ConfigError for a column that the rows have not.
    """
    missing = next((name for name in (figure, *parameters) if name not in rows), None)
    if missing is not None:
        raise ConfigError(f"no column {missing!r}; {hint(missing, map(str, rows.columns))}")
    return described(_shares(rows, ranked(rows, figure), contacts(rows, figure), parameters), MEANINGS)


def _shares(rows: pd.DataFrame, values: Floats, hit: NDArray[np.bool_], parameters: Sequence[str]) -> pd.DataFrame:
    """Return the table of `variance_explained` for any values (n), of which those `hit` had a contact."""
    import pandas as pd

    found = []
    for name in parameters:
        has = rows[name].notna().to_numpy(bool)
        known = np.isfinite(values) & has
        levels, runs, *shares = _explained(values[known], _levels(rows.loc[known, name]))
        found.append((levels, runs, int((hit & known).sum()), int((has & ~known).sum()), *shares))
    table = pd.DataFrame(found, pd.Index(list(parameters), name="parameter"), list(MEANINGS))
    order = table["adjusted_share"].fillna(table["explained_share"]).sort_values(ascending=False, kind="stable")
    return table.loc[order.index]


def chosen_axes(rows: pd.DataFrame, figure: str, parameters: Sequence[str]) -> Axes:
    """Return which parameters show a figure best: those that vary, in the order of the variance that they explain.

    Numbers that every run has become axes: the one that explains most within each value of `by`, then the one that
    explains most of what is left between the runs that have the value of both in common. Texts, such as the
    controller's name, have no order: one of them tells lines or panels apart, the controller before any other.
    """
    varied = [name for name in parameters if rows[name].nunique() > 1]
    texts = [name for name in varied if not is_number(rows[name])]
    controller = controller_of(rows)
    by = controller if controller in texts else _best(rows, figure, texts, [])
    # A key of one controller's tuning would leave the others without a place.
    numbers = [name for name in varied if is_number(rows[name]) and rows[name].notna().all()]
    x = _best(rows, figure, numbers, [by])
    return Axes(x, _best(rows, figure, [name for name in numbers if name != x], [by, x]), by)


def _best(rows: pd.DataFrame, figure: str, parameters: Sequence[str], within: Sequence[str | None]) -> str | None:
    """Return the parameter that explains most of what is left of a figure's ranks within the levels of others."""
    import pandas as pd

    if not parameters:
        return None
    left = pd.Series(ranked(rows, figure))
    levels = [_levels(rows[name]) for name in within if name is not None]
    if levels:
        left = left - left.groupby(levels).transform("mean")
    return str(_shares(rows, np.asarray(left, np.float64), contacts(rows, figure), parameters).index[0])


def is_number(column: pd.Series[Any]) -> bool:
    """Whether a column's values are numbers, which have an order and distances; truth values have neither."""
    return column.dtype.kind in "iuf"


def controller_of(rows: pd.DataFrame, but: str | None = None) -> str | None:
    """Return the column that says which controller drove a run; None where one drove them all, and for column `but`."""
    named = [name for name in rows.columns if name in ("controller", "controller.name") and name != but]
    return next((name for name in named if rows[name].nunique() > 1), None)


def _levels(column: pd.Series[Any]) -> NDArray[np.intp]:
    """Return for every run the number of its level."""
    import pandas as pd

    codes, values = pd.factorize(column, sort=is_number(column))
    if len(values) <= LEVELS or not is_number(column):
        return np.asarray(codes, np.intp)
    numbers = column.to_numpy(np.float64, na_value=np.nan)
    edges = np.linspace(float(values[0]), float(values[-1]), LEVELS + 1)
    return np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, LEVELS - 1)


def _explained(values: Floats, level: NDArray[np.intp]) -> tuple[int, int, float, float]:
    """Return levels, runs, eta squared and epsilon squared."""
    held, place = np.unique(level, return_inverse=True)
    levels, runs = len(held), len(values)
    if levels < 2:
        return levels, runs, math.nan, math.nan
    count = np.bincount(place)
    means = np.bincount(place, values - values.mean()) / count
    total, between = float(np.sum((values - values.mean()) ** 2)), float(np.sum(count * means**2))
    if not total > 1e-24 * max(1.0, float(np.max(np.abs(values)))) ** 2 * runs:  # what is left is rounding
        return levels, runs, math.nan, math.nan
    if runs == levels:
        return levels, runs, between / total, math.nan
    within = (total - between) / (runs - levels)
    return levels, runs, between / total, (between - (levels - 1) * within) / total
