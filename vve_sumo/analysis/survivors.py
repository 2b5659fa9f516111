"""Runs that lack a figure: which of them still say on which side of every other run they lie.

Knows rows as a table; it must not know what is made of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: figures that a collision leaves at zero or below, whatever was measured afterwards: the car that drives through an
#: obstacle has no gap to it at rest, and the gap to what stands behind it is another one
BELOW_ZERO_AFTER_COLLISION: Final = ("stop_gap_m",)


def with_collisions(rows: pd.DataFrame, figure: str) -> Floats:
    """Return a figure of every run (n), in which a run with a collision counts as far below every other.

    That is minus infinity for a figure of BELOW_ZERO_AFTER_COLLISION that is not itself 0 or less; the figure is
    left-censored there. Other figures are as they are. NaN where nothing is known.
    """
    values: Floats = rows[figure].to_numpy(np.float64, na_value=np.nan)
    if figure not in BELOW_ZERO_AFTER_COLLISION or "collision" not in rows:
        return values
    hit = rows["collision"].eq(True).fillna(False).to_numpy(bool)
    return np.where(hit & ~(values <= 0.0), -np.inf, values)
