"""A file with a line of JSON for every finished piece of work, and how such files survive a kill.

A line is on the disk before its piece of work counts as finished. A line that a kill cut short has no end, and never
counted. Knows nothing of what the lines mean.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any


class Journal:
    """A journal that is written; `rewrite` opens it."""

    def __init__(self, file: Path, *, infinite: bool = False) -> None:
        """With `infinite`, entries may hold numbers that JSON does not know, as Python writes them."""
        self._file, self._infinite = file, infinite
        self._out, self._length = -1, 0

    def rewrite(self, entries: Iterable[Any]) -> None:
        """Replace the content, whole or not at all."""
        data = b"".join(map(self._line, entries))
        replace_file(self._file, data)
        self.close()
        self._out, self._length = os.open(self._file, os.O_WRONLY | os.O_APPEND), len(data)

    def add(self, entry: Any) -> None:
        """Append an entry; after that, a kill does not lose it. Raises OSError where the disk cannot be written."""
        line = self._line(entry)
        try:
            _write_all(self._out, line)
            os.fdatasync(self._out)
        except OSError:
            os.ftruncate(self._out, self._length)
            raise
        self._length += len(line)

    def _line(self, entry: Any) -> bytes:
        return json.dumps(entry, separators=(",", ":"), allow_nan=self._infinite).encode() + b"\n"

    def close(self) -> None:
        """Close the file."""
        if self._out >= 0:
            os.close(self._out)
        self._out = -1


def replace_file(file: Path, data: bytes) -> None:
    """Write a file atomically: after a crash of process or machine, it has either its new or its former content."""
    temporary = file.with_name(f".{file.name}.tmp")
    try:
        out = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            _write_all(out, data)
            os.fsync(out)
        finally:
            os.close(out)
        temporary.replace(file)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(file.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk: its renamed, new and deleted files."""
    there = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(there)
    finally:
        os.close(there)


def _write_all(out: int, data: bytes) -> None:
    while data:
        data = data[os.write(out, data) :]
