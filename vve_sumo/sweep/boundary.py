"""Finds where a verdict flips along a row of places: a coarse scan, then bisection between neighbours that differ.

Knows places and verdicts; neither what a place means nor how a verdict is found. Several rows are searched together, so
that there is work for several workers; the queries depend on the verdicts alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

#: verdicts of one row, by place
Known = Mapping[int, bool]


class VerdictQuery(NamedTuple):
    """A query for the verdict at a place of a row."""

    row: int
    place: int


class Flip(NamedTuple):
    """Two neighbouring places whose verdicts differ."""

    below: int
    above: int
    good_below: bool  #: the verdict at `below`; at `above` it is the opposite


def flips_of(known: Known) -> list[Flip]:
    """Return the flips between neighbouring places that are known."""
    return [Flip(low, high, known[low]) for low, high in _differing(known) if high - low == 1]


def verdict_at(known: Known, place: int) -> bool:
    """Return the verdict at a place of a searched row; between two equal verdicts it is assumed to be equal."""
    return known[max(at for at in known if at <= place)]


def pooled(rows: Sequence[Known]) -> list[Flip]:
    """Return where the verdict of the majority of rows flips; a tie counts as bad."""
    places = sorted({flip.above for known in rows for flip in flips_of(known)})
    pairs = ((place - 1, place) for place in places)
    return [
        Flip(low, high, _majority(rows, low)) for low, high in pairs if _majority(rows, low) != _majority(rows, high)
    ]


def _majority(rows: Sequence[Known], place: int) -> bool:
    return 2 * sum(verdict_at(known, place) for known in rows) > len(rows)


def scanned(count: int, scan: int) -> list[int]:
    """Return `scan` of `count` places, evenly spread, both ends among them; all of them if there are no more."""
    scan = min(scan, count)
    return sorted({round(number * (count - 1) / max(scan - 1, 1)) for number in range(scan)})


def first(rows: int, count: int, scan: int) -> list[VerdictQuery]:
    """Return the first queries: `scan` of the `count` places of each row."""
    return [VerdictQuery(row, place) for row in range(rows) for place in scanned(count, scan)]


def closer(known: Sequence[Known], batch: int) -> list[VerdictQuery]:
    """Return the next queries: places between neighbours that differ; none once all such neighbours are adjacent.

    Each pair gets one place, or several at equal distances while all rows together have no more than `batch`.
    """
    brackets = unsettled(known)
    each = max(1, batch // max(1, len(brackets)))
    return [VerdictQuery(row, place) for row, low, high in brackets for place in _cuts(low, high, each)]


def unsettled(known: Sequence[Known]) -> list[tuple[int, int, int]]:
    """Return the row and the places of neighbours that differ and are not adjacent."""
    return [(row, low, high) for row, one in enumerate(known) for low, high in _differing(one) if high - low > 1]


def _cuts(low: int, high: int, count: int) -> list[int]:
    """Return at most `count` places strictly between two, as evenly spread as possible."""
    parts = min(count, high - low - 1) + 1
    return [low + (high - low) * number // parts for number in range(1, parts)]


def _differing(known: Known) -> list[tuple[int, int]]:
    places = sorted(known)
    return [(low, high) for low, high in itertools.pairwise(places) if known[low] != known[high]]
