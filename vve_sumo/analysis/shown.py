"""How a drive and a sweep show themselves: by functions of packages above this one, found by name when they are called.

It must not know what these make.
"""

from __future__ import annotations

import importlib
from typing import Any


def shown(function: str, *arguments: Any, **options: Any) -> Any:
    """Return what a function `module:name` of this program makes of its arguments."""
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(f"vve_sumo.{module}"), name)(*arguments, **options)
