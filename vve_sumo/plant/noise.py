"""White and slowly wandering noise, with one generator for each source, so that no source changes another.

Numbers are drawn in blocks: a single draw from numpy costs ten times as much.
"""

from __future__ import annotations

import math

import numpy as np

BLOCK = 512


class White:
    """Independent normal draws of standard deviation 1."""

    __slots__ = ("_block", "_generator")

    def __init__(self, seeds: np.random.SeedSequence) -> None:
        self._generator = np.random.Generator(np.random.PCG64(seeds))
        self._block: list[float] = []

    def draw(self) -> float:
        """The next number."""
        if not self._block:
            self._block = self._generator.standard_normal(BLOCK).tolist()
        return self._block.pop()


class Wander:
    """First-order Gauss-Markov noise of standard deviation `sigma` and correlation time `time` [s], stationary at once.

    x' = a x + sigma sqrt(1 - a^2) w with a = exp(-period / time) (Brown and Hwang, Introduction to Random Signals).
    """

    __slots__ = ("_drive", "_keep", "_value", "_white")

    def __init__(self, sigma: float, time: float, period: float, seeds: np.random.SeedSequence) -> None:
        self._white = White(seeds)
        self._keep = math.exp(-period / time)
        self._drive = sigma * math.sqrt(1.0 - self._keep * self._keep)
        self._value = sigma * self._white.draw()

    def draw(self) -> float:
        """The next number, one period later."""
        self._value = self._keep * self._value + self._drive * self._white.draw()
        return self._value
