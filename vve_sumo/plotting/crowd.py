"""Points of a scatter plot: each one while they are few, quantiles along the x axis once nobody could tell them apart.

Knows numbers only.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vve_sumo.plotting.style import SeriesStyle, finite
from vve_sumo.values import Floats

#: points; more of them become bands
MAX_POINTS: Final = 1500
#: values of x that are taken as they are; of more, this many portions of equal width
PORTIONS: Final = 50
#: that a band shows: from all over 90 % to the middle
QUANTILES: Final = (0.0, 0.05, 0.5, 0.95, 1.0)
#: marks along an axis, of runs that have no place in it; closer ones would be one
MARKS: Final = 150


class Bands(NamedTuple):
    """Quantiles of y over x."""

    x: Floats  #: (n)
    y: Floats  #: (5 x n), a row for each of QUANTILES

    def middle(self) -> tuple[Floats, Floats]:
        """Return x and median of every portion."""
        return self.x, self.y[2]


def portions(x: Floats, most: int = PORTIONS) -> tuple[Floats, NDArray[np.intp]]:
    """Return the x of every portion (n), `most` of them at most, and, for every point, the number of its portion."""
    values, number = np.unique(x, return_inverse=True)
    if len(values) <= most:
        return values, number
    edges = np.linspace(values[0], values[-1], most + 1)
    number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, most - 1)
    return (edges[1:] + edges[:-1]) / 2.0, number


def bands(x: Floats, y: Floats) -> Bands:
    """Return quantiles of y over portions of x; a portion without points is left out."""
    middles, number = portions(x)
    order = np.argsort(number, kind="stable")
    held, begins = np.unique(number[order], return_index=True)
    parts: Iterator[Floats] = iter(np.split(y[order], begins[1:]))
    return Bands(middles[held], np.column_stack([np.quantile(part, QUANTILES) for part in parts]))


def crowd(axes: Axes, x: Floats, y: Floats, look: SeriesStyle, word: str) -> None:
    """Draw points (n) where both numbers are known: few of them each, many as bands of their quantiles."""
    known = finite(x, y)
    x, y = x[known], y[known]
    count = f"{len(x):,} run{'s' * (len(x) != 1)}"
    if len(x) <= MAX_POINTS:
        size = 5.0 if len(x) <= MAX_POINTS // 10 else 3.0
        style: dict[str, Any] = {"color": look.colour, "marker": look.mark, "markersize": size, "alpha": 0.75}
        axes.plot(x, y, linestyle="", markeredgewidth=0.0, label=f"{word} ({count})", **style)
        return
    at, (least, low, middle, high, most) = bands(x, y)
    axes.fill_between(at, least, most, color=look.colour, alpha=0.15, linewidth=0, label=f"all {count}")
    axes.fill_between(at, low, high, color=look.colour, alpha=0.35, linewidth=0, label="middle 90 %")
    axes.plot(at, middle, color=look.colour, label=f"{word}, median")


def thinned(x: Floats) -> Floats:
    """Return the places of marks along an axis: the known ones, one for all that would lie upon each other."""
    x = np.unique(x[np.isfinite(x)])
    if len(x) <= MARKS:
        return x
    step = (x[-1] - x[0]) / MARKS
    thin: Floats = x[np.unique(np.floor((x - x[0]) / step), return_index=True)[1]]
    return thin
