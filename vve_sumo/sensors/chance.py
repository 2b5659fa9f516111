"""What chance does to a radar: a stream of its own for every actor, and errors that hold on from scan to scan.

Must not know what is measured, or what the units of an error are.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import NDArray

#: Draws made at once for an actor: one by one they would cost several times as much.
BLOCK = 8

#: What chance adds to one actor in one scan: uniform in [0, 1), and standard normal for range, azimuth and range rate.
Draw = tuple[float, float, float, float]


class _NamedSeed(ISeedSequence):
    """The state of a stream from the drive's seed and a name; a fraction of the cost of a SeedSequence."""

    def __init__(self, seed: bytes, name: str) -> None:
        self._digest = hashlib.blake2b(name.encode(), key=seed).digest()

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        """The first words of the digest, the same on machines of either byte order."""
        return np.frombuffer(self._digest, "<u8", n_words).astype(dtype)


def stream(seed: bytes, name: str) -> np.random.Generator:
    """The stream of random numbers that belongs to a name alone."""
    # numpy's own stubs know no seed but SeedSequence; at run time its interface suffices.
    return np.random.Generator(np.random.PCG64(_NamedSeed(seed, name)))  # type: ignore[arg-type]


class Luck:
    """What chance does to one actor: first-order Gauss-Markov errors of variance 1, and a fresh uniform each time.

    Errors a period apart are correlated by `correlation`, errors farther apart by the according power of it: one who
    was not looked at for a while comes back with errors that know little of the old ones.
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
