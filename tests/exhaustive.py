"""Parameters of which a few stand for all in the ordinary run, and the others are marked `thorough` or `slow`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def with_slow(
    values: Iterable[Any], usual: Callable[[Any], bool], gate: Callable[[Any], bool] = lambda value: True
) -> list[Any]:
    """Return all values as parameters.

    Those that are not `usual` are tried by `./check slow` only; of the others `./check test` tries those of the `gate`.
    """
    return [_marked(value, pytest.mark.slow) if not usual(value) else _of_usual(value, gate) for value in values]


def _of_usual(value: Any, gate: Callable[[Any], bool]) -> Any:
    return value if gate(value) else _marked(value, pytest.mark.thorough)


def _marked(value: Any, mark: pytest.MarkDecorator) -> Any:
    values = value if isinstance(value, tuple) and not hasattr(value, "_fields") else (value,)
    return pytest.param(*values, marks=mark)
