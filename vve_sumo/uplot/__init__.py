"""uPlot 1.6.32, the one library that the pages of reports and of drives carry: script, style sheet and licence."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Final

SCRIPT: Final = "uPlot.iife.min.js"
STYLE: Final = "uPlot.min.css"
LICENCE: Final = "uPlot.LICENSE.txt"


@cache
def read(name: str) -> str:
    """Return the text of one of the library's files."""
    return (resources.files(__package__) / name).read_text(encoding="utf-8")
