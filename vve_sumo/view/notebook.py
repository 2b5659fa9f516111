"""A record's or a sweep's page inside a notebook: the whole page in the cell, which needs no server and no network."""

from __future__ import annotations

from functools import cached_property
from html import escape
from pathlib import Path
from typing import Final

from vve_sumo.view.library import Library

#: of the frame in the cell [CSS pixels]
HEIGHT: Final = 720


class ShownPage:
    """A page that the cell of a notebook shows, wherever the notebook's kernel runs; `html` is the page as one file."""

    def __init__(self, folder: Path) -> None:
        """Take the page of a record or a sweep, without the kept runs; raises ConfigError as `Library` does."""
        self._folder, self._library = folder, Library([folder])

    @cached_property
    def html(self) -> str:
        """The page as one file."""
        return self._library.page()

    def __repr__(self) -> str:
        return f"<page of {self._folder}: a notebook shows it; outside of one: vve-sumo view {self._folder}>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="{HEIGHT}" frameborder="0"></iframe>'
