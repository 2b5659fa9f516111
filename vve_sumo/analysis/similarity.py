"""How alike two sampled signals are, and how much later one of them is.

Plain arrays in, numbers out; must not know what the signals are of.
"""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.values import Floats

#: a signal that varies less than this about its mean is flat: the rest is rounding
FLAT = 1e-9
#: a shift is looked for no further than this share of the signals' length
MAX_SHIFT_SHARE = 0.25
#: two signals whose correlation is below this at every shift are not one signal shifted
MIN_CORRELATION = 0.5


def rms(values: Floats) -> float:
    """Return the root mean square of values, one or more."""
    return math.sqrt(float(np.mean(values * values)))


def theil_u(one: Floats, other: Floats) -> float:
    """Return Theil's U1 of two equally long signals: RMS of the difference over the sum of both RMS, within 0 to 1.

    0 means alike, 1 opposite, or that one of them is 0 throughout; NaN of no points. It is the coefficient of Theil,
    "Economic Forecasts and Policy" (1961), which takes both alike, and not his later U2, which has no upper bound and
    one of the two as the truth (told apart by Bliemel, Journal of Marketing Research 10(4), 1973).
    """
    if not len(one):
        return math.nan
    scale = rms(one) + rms(other)
    return rms(other - one) / scale if scale > 0.0 else 0.0


def pearson(one: Floats, other: Floats) -> float:
    """Return the correlation coefficient of two equally long signals; NaN where one of them is flat."""
    if len(one) < 2:
        return math.nan
    a, b = one - one.mean(), other - other.mean()
    if not (rms(a) > FLAT and rms(b) > FLAT):
        return math.nan
    return float(np.clip(np.dot(a, b) / math.sqrt(np.dot(a, a) * np.dot(b, b)), -1.0, 1.0))


def shift_of(one: Floats, other: Floats, step: float, farthest: float) -> float:
    """Return how much later `other` is than `one`, positive for later, in the unit of `step`.

    That is the shift up to `farthest` at which the correlation of what then overlaps is greatest, refined by the
    parabola through it and its two neighbours. NaN where there is no such summit: it lies at the bound, it is below
    ALIKE, or a signal is flat. Points that are NaN in either take no part.
    """
    reach = min(round(farthest / step), int(MAX_SHIFT_SHARE * len(one)))
    likeness = np.array([_overlapping(one, other, lag) for lag in range(-reach, reach + 1)], np.float64)
    if not np.isfinite(likeness).all() or reach < 1:
        return math.nan
    best = int(np.argmax(likeness))
    if not (0 < best < len(likeness) - 1 and likeness[best] >= MIN_CORRELATION):
        return math.nan
    left, middle, right = likeness[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return float((best - reach + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)) * step)


def _overlapping(one: Floats, other: Floats, lag: int) -> float:
    """Correlation of one[i] with other[i + lag]."""
    end = len(one) - abs(lag)
    a, b = one[max(0, -lag) :][:end], other[max(0, lag) :][:end]
    both = np.isfinite(a) & np.isfinite(b)
    return pearson(a[both], b[both])
