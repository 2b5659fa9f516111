"""Random numbers of a radar: one stream per actor, and errors that are correlated from scan to scan.

Must not know what is measured, or the units of an error.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import NDArray

#: Draws made at once for an actor; single draws would cost several times as much.
BLOCK = 8

#: Random numbers of one actor in one scan: uniform in [0, 1), and standard normal for range, azimuth and range rate.
Draw = tuple[float, float, float, float]


class _NamedSeed(ISeedSequence):
    """Seeds a stream from the drive's seed and a name, at a fraction of the cost of a SeedSequence."""

    def __init__(self, seed: bytes, name: str) -> None:
        self._digest = hashlib.blake2b(name.encode(), key=seed).digest()

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        """The first words of the digest, the same on machines of either byte order."""
        return np.frombuffer(self._digest, "<u8", n_words).astype(dtype)


def stream(seed: bytes, name: str) -> np.random.Generator:
    """The stream of random numbers of a name, which depends on seed and name only."""
    # numpy's stubs accept a SeedSequence only; at run time its interface suffices.
    return np.random.Generator(np.random.PCG64(_NamedSeed(seed, name)))  # type: ignore[arg-type]


class CorrelatedNoise:
    """Random numbers of one actor: first-order Gauss-Markov errors of variance 1, and a fresh uniform each time.

    Errors a period apart are correlated by `correlation`, errors farther apart by the corresponding power of it: after
    a long time without a scan, an actor's errors are nearly independent of the old ones.
    """

    def __init__(self, source: np.random.Generator, correlation: float, period: int) -> None:
        self._draws = _draws(source)
        self._correlation, self._period = correlation, period
        self._errors, self._time = (0.0, 0.0, 0.0), -math.inf

    def at(self, time: int) -> Draw:
        """Draw for a scan at a time later than the last one, in the period's unit."""
        chance, *fresh = next(self._draws)
        keep = self._correlation ** ((time - self._time) / self._period)
        renew = math.sqrt(1.0 - keep * keep)
        first, second, third = (keep * old + renew * new for old, new in zip(self._errors, fresh, strict=True))
        self._errors, self._time = (first, second, third), time
        return chance, first, second, third


def _draws(source: np.random.Generator) -> Iterator[Draw]:
    while True:
        yield from zip(source.random(BLOCK).tolist(), *source.standard_normal((3, BLOCK)).tolist(), strict=True)
