"""White and slowly wandering noise, with one generator for each source, so that no source changes another.

Numbers are drawn in blocks: a single draw from numpy costs ten times as much.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain, count
from typing import Final

import numpy as np

BLOCK: Final = 512


def white(seeds: np.random.SeedSequence) -> Iterator[float]:
    """Independent normal draws of standard deviation 1, without end."""
    generator = np.random.Generator(np.random.PCG64(seeds))

    def block(_: int) -> list[float]:
        drawn: list[float] = generator.standard_normal(BLOCK).tolist()
        return drawn[::-1]

    return chain.from_iterable(map(block, count()))


def wander(sigma: float, time: float, period: float, seeds: np.random.SeedSequence) -> Iterator[float]:
    """First-order Gauss-Markov noise of standard deviation `sigma` and correlation time `time` [s], stationary at once.

    x' = a x + sigma sqrt(1 - a^2) w with a = exp(-period / time) (Brown and Hwang, Introduction to Random Signals).
    Time 0 is white noise.
    """
    numbers = white(seeds)
    keep = math.exp(-period / time) if time > 0.0 else 0.0
    drive = sigma * math.sqrt(1.0 - keep * keep)
    value = sigma * next(numbers)
    for number in numbers:
        value = keep * value + drive * number
        yield value
