"""Runs of whole numbers in one array, such as the firings or the columns of pixels that bodies may meet."""

from __future__ import annotations

import numpy as np

from vve_sumo.path import Indices


def runs(begin: Indices, count: Indices) -> tuple[Indices, Indices]:
    """Return runs of whole numbers one after the other, each from its `begin` on: whose each is, and the numbers."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) + (begin - np.cumsum(count) + count)[owner]
