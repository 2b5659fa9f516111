"""Runs that lack a figure: which of them still say on which side of every other run they lie.

Knows rows as a table; it must not know what is made of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vve_sumo.metrics.contacts import BEYOND
from vve_sumo.metrics.table import METRICS
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd


def contacts(rows: pd.DataFrame, figure: str) -> NDArray[np.bool_]:
    """Return which runs (n) lie beyond every value of a figure, because they touched something.

    None do of a figure that a contact leaves as it is, and of rows that do not tell.
    """
    if figure not in BEYOND or "collision" not in rows:
        return np.zeros(len(rows), bool)
    return rows["collision"].eq(True).fillna(False).to_numpy(bool)


def without_contacts(rows: pd.DataFrame, figure: str) -> Floats:
    """Return a figure of every run (n); NaN where nothing is known, and where a contact lies beyond it.

    A depth of overlap is no gap, and is in no mean of gaps.
    """
    values: Floats = rows[figure].to_numpy(np.float64, na_value=np.nan)
    return np.where(contacts(rows, figure), np.nan, values)


def with_contacts(rows: pd.DataFrame, figure: str) -> Floats:
    """Return a figure of every run (n), in which a contact counts as beyond every value; NaN where nothing is known.

    Minus infinity of a gap and a time to collision, plus infinity of a DRAC: such a value is known to one side only
    (censored), which is all that an order of the runs takes.
    """
    return np.where(contacts(rows, figure), BEYOND.get(figure, np.nan), without_contacts(rows, figure))


def ordered(rows: pd.DataFrame, figure: str) -> Floats:
    """Return a figure of every run (n) as far as an order takes it; NaN where nothing is known.

    A contact counts as `with_contacts` has it. Of a drive without a conflict a figure such as the least time to
    collision is missing because it is endless: such a run counts as that. Of a run with an error nothing is known.
    """
    values = with_contacts(rows, figure)
    if figure not in METRICS:
        return values
    driven = rows["error"].fillna("").eq("").to_numpy(bool) if "error" in rows else np.ones(len(rows), bool)
    return np.where(np.isnan(values) & driven, METRICS[figure].absent, values)


def ranked(rows: pd.DataFrame, figure: str) -> Floats:
    """Return the rank of every run (n) by a figure, from 1, the mean of the ranks of those that tie; NaN for none.

    The order is that of `ordered`.
    """
    import pandas as pd

    return np.asarray(pd.Series(ordered(rows, figure)).rank(), np.float64)
