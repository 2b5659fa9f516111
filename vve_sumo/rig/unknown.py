"""The mark of what a rig file leaves open, and the refusal of a file in which it stands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

#: stands for a value that nobody has found out yet
UNKNOWN: Final = "TO BE FILLED IN"


def first_unknown(table: Mapping[str, Any], stem: str = "") -> str | None:
    """Return the first key of a parsed TOML table, in its order, whose value is still unknown; None for none."""
    for key, value in table.items():
        if _is_unknown(value):
            return f"{stem}{key}"
        if isinstance(value, Mapping) and (inner := first_unknown(value, f"{stem}{key}.")) is not None:
            return inner
    return None


def _is_unknown(value: Any) -> bool:
    return any(map(_is_unknown, value)) if isinstance(value, list) else bool(value == UNKNOWN)
