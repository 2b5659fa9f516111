"""Parameters of which a few stand for all in the ordinary run, and the others are marked `slow`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def with_slow(values: Iterable[Any], usual: Callable[[Any], bool]) -> list[Any]:
    """Return all values as parameters; those that are not `usual` are tried by `./check slow` only."""
    return [value if usual(value) else _slow(value) for value in values]


def _slow(value: Any) -> Any:
    values = value if isinstance(value, tuple) and not hasattr(value, "_fields") else (value,)
    return pytest.param(*values, marks=pytest.mark.slow)
