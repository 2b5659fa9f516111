"""How sure a share and a mean are, at 95 %.

Knows counts and numbers; nothing of what they were counted from.
"""

from __future__ import annotations

import functools
import math
from statistics import NormalDist
from typing import NamedTuple

CONFIDENCE = 0.95
#: how many standard deviations that reaches to either side
_REACH = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2.0)


class Interval(NamedTuple):
    """Where a figure lies, at CONFIDENCE."""

    low: float
    high: float


@functools.lru_cache(maxsize=4096)
def wilson(passed: int, judged: int) -> Interval:
    """Return Wilson's interval of the share that pass, of `judged` runs of which `passed` did; [0, 1] for none.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    if judged == 0:
        return Interval(0.0, 1.0)
    share, weight = passed / judged, _REACH**2 / judged
    middle = (share + weight / 2.0) / (1.0 + weight)
    half = math.sqrt(weight * (share * (1.0 - share) + weight / 4.0)) / (1.0 + weight)
    return Interval(0.0 if passed == 0 else middle - half, 1.0 if passed == judged else middle + half)


@functools.lru_cache(maxsize=4096)
def student(freedom: int) -> float:
    """Return how many standard errors Student's interval reaches to either side; NaN without a degree of freedom."""
    if freedom < 1:
        return math.nan
    from scipy.special import stdtrit  # scipy.stats has it too, and takes ten times as long to import

    return float(stdtrit(freedom, 0.5 + CONFIDENCE / 2.0))
