"""What a column's name says of its unit, and tables that carry units and meanings with them.

Knows names only, nothing of what a column is about.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

#: ending of a column's name and the unit that it stands for; the longer one is meant where two fit
UNITS: dict[str, str] = {
    "_s": "s",
    "_s2": "s²",
    "_ms": "ms",
    "_m": "m",
    "_m2": "m²",
    "_mps": "m/s",
    "_mps2": "m/s²",
    "_mps3": "m/s³",
    "_m_s": "m/s",  # of controllers' tuning keys
    "_m_s2": "m/s²",
    "_rad": "rad",
    "_radps": "rad/s",
    "_deg": "°",
    "_nm": "N m",
    "_kg": "kg",
    "_mb": "MB",
    "_percent": "%",
    "_share": "",
}


def unit_of(column: str) -> str:
    """Return the unit that a column's name ends in; empty for a number without one, a text, a truth value."""
    return UNITS.get(ending_of(column), "")


def ending_of(column: str) -> str:
    """Return the ending of a column's name that stands for its unit; empty for none."""
    return max((ending for ending in UNITS if column.endswith(ending)), key=len, default="")


def described(frame: pd.DataFrame, meanings: Mapping[str, str]) -> pd.DataFrame:
    """Return a table whose `attrs` say of every column its unit (`units`) and what it is (`meanings`)."""
    frame.attrs["units"] = {str(name): unit_of(str(name)) for name in frame.columns}
    frame.attrs["meanings"] = {str(name): meanings.get(str(name), "") for name in frame.columns}
    return frame
