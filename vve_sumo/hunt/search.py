"""Chooses the episodes of a search, batch by batch: by chance, then near those that came closest to a violation.

The episodes of a batch depend on the seed and on the results of the batches before alone, so that a search that was cut
off is taken up where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from random import Random
from typing import Final

from vve_sumo.hunt import draw
from vve_sumo.hunt.episode import Episode
from vve_sumo.hunt.runner import EpisodeResult

#: episodes of a batch; they share a road and its nominal drive
BATCH: Final = 240
#: batches that are drawn by chance alone before the search is guided
BLIND: Final = 2
#: share of a guided batch that are neighbours of the closest
GUIDED: Final = 0.6
#: closest episodes that are kept of each invariant
ELITE: Final = 24


class Search:
    """A search in progress."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._number = 0
        self._elite: dict[str, list[tuple[float, Episode]]] = {}

    def batch(self) -> list[Episode]:
        """Return the episodes of the next batch."""
        number = self._number
        random = Random(f"{self._seed} {number}")
        road, seed = draw.ROADS[number % len(draw.ROADS)], draw.SEEDS[number // len(draw.ROADS) % len(draw.SEEDS)]
        episodes = []
        for _ in range(BATCH):
            near = self._near(random) if number >= BLIND and random.random() < GUIDED else None
            episodes.append(near or draw.episode(random, road, seed))
        return [replace(episode, road=road, seed=seed) for episode in episodes]

    def _near(self, random: Random) -> Episode | None:
        elite = [found for found in self._elite.values() if found]
        if not elite:
            return None
        return draw.mutated(random.choice(random.choice(elite))[1], random)

    def learn(self, results: Sequence[EpisodeResult]) -> None:
        """Take in the results of the batch, in the order of its episodes."""
        self._number += 1
        for result in results:
            for invariant, margin in result.margins.items():
                if margin < 1.0 and invariant not in result.broken:
                    self._elite.setdefault(invariant, []).append((margin, result.episode))
        for invariant, found in self._elite.items():
            found.sort(key=lambda one: one[0])
            self._elite[invariant] = found[:ELITE]
