"""One file of an export, before it is written."""

from __future__ import annotations

from typing import NamedTuple


class ExportPart(NamedTuple):
    """The content of one file of an export."""

    name: str  #: what the file's name has before its ending; empty for the file that the export is named for
    content: bytes
    head: str = ""  #: what a convention puts before the file's name, which an underscore then joins
