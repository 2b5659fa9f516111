"""Counts the messages of a receiver that sends several kinds of them: which came, how often and in which order.

It knows names and arrivals; it must not know what a message says.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

NOTED: Final = 200  #: newest messages of which the order is kept: some epochs
MAX_NAMES: Final = 64  #: names that are counted; a damaged line could make up any number


class Needed(NamedTuple):
    """A quantity that no fix is complete without, and the messages that may bring it."""

    what: str  #: the quantity
    names: tuple[str, ...]  #: of messages, any one of which is enough
    every_fix: bool = True  #: whether each fix needs one; otherwise now and then one is enough


class MessageCensus:
    """Notes messages with a right checksum by their names."""

    def __init__(self, needed: tuple[Needed, ...], first: tuple[str, ...] = ()) -> None:
        """Begin with no message. Where `first` is not empty, an epoch has to begin with one of these."""
        self.needed, self.first = needed, first
        self.counts: Counter[str] = Counter()
        self._newest: deque[tuple[float, str]] = deque(maxlen=NOTED)

    def note(self, name: str, received: float) -> None:
        """Count a message that arrived at `received` [s]."""
        if name in self.counts or len(self.counts) < MAX_NAMES:
            self.counts[name] += 1
            self._newest.append((received, name))

    def epoch(self) -> tuple[str, ...]:
        """Return the names of the newest whole epoch in the order of arrival; empty before there is one.

        An epoch lasts from one message that is needed to the next of the same name, and begins after the pause therein
        that is the longest in sum: a reader that was busy sees some messages late, and some epochs at once.
        """
        newest = list(self._newest)
        names = [name for need in self.needed for name in need.names]
        often = max(names, key=lambda name: self.counts[name], default="")
        places = [place for place, (_received, name) in enumerate(newest) if name == often]
        laps = [newest[begin : end + 1] for begin, end in pairwise(places)]
        if not laps:
            return ()
        lap = [name for _received, name in laps[-1][:-1]]
        alike = [one for one in laps if [name for _received, name in one[:-1]] == lap]
        pauses = [[after - before for (before, _), (after, _) in pairwise(one)] for one in alike]
        sums = [sum(column) for column in zip(*pauses, strict=True)]
        turn = (sums.index(max(sums)) + 1) % len(lap)
        return (*lap[turn:], *lap[:turn])

    def missing(self, counts: Counter[str], least: float) -> Iterator[str]:
        """Yield, in words, what of the needed messages did not come, or seldom, or at a wrong place of the epoch.

        `counts` are those of a while, by name, in which `least` of a message that every fix needs should have come.
        """
        for need in self.needed:
            came = sum(counts[name] for name in need.names)
            names = " or ".join(need.names)
            if not came:
                yield f"no {names} ({need.what})"
            elif need.every_fix and came < least:
                yield f"{names} ({need.what}) too seldom"
        epoch = self.epoch()
        if self.first and epoch and epoch[0] not in self.first:
            yield f"an epoch begins with {epoch[0]}, which carries no time: send {' or '.join(self.first)} first"
