"""Where, along a row of places, a verdict flips: a coarse scan, then ever closer between neighbours that differ.

Knows places and verdicts; neither what stands at a place nor how a verdict comes about. Several rows are searched
together, so that there is work for several workers; what is asked depends on the verdicts alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

#: verdicts of one row, by place
Known = Mapping[int, bool]


class Ask(NamedTuple):
    """A verdict that is wanted."""

    row: int
    place: int


class Flip(NamedTuple):
    """Two neighbouring places whose verdicts differ."""

    below: int
    above: int
    good_below: bool  #: the verdict at `below`; that at `above` is the other one


def flips_of(known: Known) -> list[Flip]:
    """Return the flips between neighbouring places that are known."""
    return [Flip(low, high, known[low]) for low, high in _differing(known) if high - low == 1]


def verdict_at(known: Known, place: int) -> bool:
    """Return the verdict at a place of a row that was searched; between two alike it is taken to be theirs."""
    return known[max(at for at in known if at <= place)]


def pooled(rows: Sequence[Known]) -> list[Flip]:
    """Return where the verdict of the majority of rows flips; with half of them bad, it is bad."""
    places = sorted({flip.above for known in rows for flip in flips_of(known)})
    pairs = ((place - 1, place) for place in places)
    return [Flip(low, high, _most(rows, low)) for low, high in pairs if _most(rows, low) != _most(rows, high)]


def _most(rows: Sequence[Known], place: int) -> bool:
    return 2 * sum(verdict_at(known, place) for known in rows) > len(rows)


def scanned(count: int, scan: int) -> list[int]:
    """Return `scan` of `count` places, evenly spread, both ends among them; all of them if there are no more."""
    scan = min(scan, count)
    return sorted({round(number * (count - 1) / max(scan - 1, 1)) for number in range(scan)})


def first(rows: int, count: int, scan: int) -> list[Ask]:
    """Return what is wanted at first: `scan` of the `count` places of each row."""
    return [Ask(row, place) for row in range(rows) for place in scanned(count, scan)]


def closer(known: Sequence[Known], batch: int) -> list[Ask]:
    """Return what is wanted next: places between neighbours that differ; none once these are all next to each other.

    One place for each such pair, or more, at equal distances, as long as they are no more than `batch` over all rows.
    """
    brackets = unsettled(known)
    each = max(1, batch // max(1, len(brackets)))
    return [Ask(row, place) for row, low, high in brackets for place in _cuts(low, high, each)]


def unsettled(known: Sequence[Known]) -> list[tuple[int, int, int]]:
    """Return the row and the places of neighbours that differ and are not next to each other."""
    return [(row, low, high) for row, one in enumerate(known) for low, high in _differing(one) if high - low > 1]


def _cuts(low: int, high: int, most: int) -> list[int]:
    """Return places strictly between two, at most so many, in distances as equal as can be."""
    parts = min(most, high - low - 1) + 1
    return [low + (high - low) * number // parts for number in range(1, parts)]


def _differing(known: Known) -> list[tuple[int, int]]:
    places = sorted(known)
    return [(low, high) for low, high in itertools.pairwise(places) if known[low] != known[high]]
