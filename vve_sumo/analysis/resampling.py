"""How sure the middle of paired differences is, and whether two outcomes of pairs differ by more than chance.

Knows numbers and counts; nothing of what they were counted from. Both take the pairs for a sample: of pairs that
somebody chose, as the points of a grid, they say how much the finding hangs on single pairs.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.statistics import CONFIDENCE, Interval
from vve_sumo.values import Floats

#: resamples of a bootstrap, and the seed of their draw: the same pairs have the same interval
RESAMPLES: Final = 10_000
SEED: Final = 19790101


def bootstrap_median(values: Floats) -> Interval:
    """Return the bootstrap's percentile interval of the median of values (n), at CONFIDENCE; NaN for fewer than two.

    A resample of n values has the median that the middle order statistics of n even random numbers point to in the
    sorted values, which are drawn as such: a resample costs two numbers however many values there are. Source: Efron,
    Bootstrap methods: another look at the jackknife, 1979.
    """
    count = len(values)
    if count < 2:
        return Interval(math.nan, math.nan)
    chance, ordered, lower = np.random.default_rng(SEED), np.sort(values), (count + 1) // 2
    share = chance.beta(lower, count + 1 - lower, RESAMPLES)
    upper = share
    if count % 2 == 0:  # the next order statistic, given the one below it
        upper = share + (1.0 - share) * chance.beta(1, count - lower, RESAMPLES)
    places = [np.minimum((each * count).astype(np.intp), count - 1) for each in (share, upper)]
    medians = 0.5 * (ordered[places[0]] + ordered[places[1]])
    low, high = np.quantile(medians, (0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0))
    return Interval(float(low), float(high))


def sign_test(fewer: int, more: int) -> float:
    """Return the exact two-sided probability that chance alone parts pairs at least so unevenly; 1 for no such pairs.

    `fewer` and `more` are the pairs that differ one way and the other; those that agree say nothing. Of a truth value
    this is McNemar's test in its exact form, of numbers the sign test. Sources: McNemar, Note on the sampling error of
    the difference between correlated proportions or percentages, 1947; Dixon and Mood, The statistical sign test, 1946.
    """
    if fewer + more == 0:
        return 1.0
    from scipy.special import bdtr  # scipy.stats has the test too, and takes ten times as long to import

    return min(1.0, 2.0 * float(bdtr(min(fewer, more), fewer + more, 0.5)))
