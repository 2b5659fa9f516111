"""A minute of a real radar: the tracks that a Denso on a Toyota reported, and how the car moved (comma2k19, MIT).

It reads the recording and takes smooth motion out of it; what that means for the virtual radar is the tests' to say.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vve_sumo.values import Floats

#: longer without a report, and it is another track [s]
BREAK = 0.12


class Track(NamedTuple):
    """One target as it was reported, in order."""

    time: Floats  #: of the report's arrival [s]
    ahead: Floats  #: [m]
    aside: Floats  #: left positive [m]
    rate: Floats  #: opening positive [m/s]


def rows(file: Path) -> list[dict[str, float]]:
    """Return the rows of a table of numbers."""
    with file.open(encoding="utf-8") as lines:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def read_tracks(shared_data: Path) -> list[Track]:
    """Return every target's unbroken stretches of reports."""
    reports = rows(shared_data / "drives" / "comma2k19" / "tidy_radar_tracks.csv")
    reports.sort(key=lambda row: (row["track_addr"], row["t"]))
    new = [
        after["new_track"] == 1.0 or after["track_addr"] != before["track_addr"] or after["t"] - before["t"] > BREAK
        for before, after in pairwise(reports)
    ]
    edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(reports)]
    columns = np.array([(row["t"], row["x_fwd"], row["y_left"], row["v_rel"]) for row in reports]).T
    return [Track(*columns[:, begin:end]) for begin, end in pairwise(edges)]


def windows(tracks: Sequence[Track], count: int) -> Iterator[Track]:
    """Give stretches of so many reports, each half over the one before; away from the ends of the recording."""
    for track in tracks:
        for begin in range(0, len(track.time) - count + 1, count // 2):
            cut = Track(*(column[begin : begin + count] for column in track))
            if cut.time[0] > 0.6 and cut.time[-1] < 59.0:
                yield cut


def remover(count: int, degree: int) -> Floats:
    """Return the matrix that takes from so many equally spaced values the polynomial nearest to them."""
    basis = np.linalg.qr(np.vander(np.arange(count) - 0.5 * count, degree + 1))[0]
    return np.eye(count) - basis @ basis.T
