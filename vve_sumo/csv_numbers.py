"""CSV files of numbers that a user writes: how they are read, and one clear line for what is wrong with one.

The first line that is neither empty nor a comment from `#` on names the columns. Must not know what any file is about.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from vve_sumo.errors import ConfigError


class CsvNumbers:
    """A file that was read, its numbers not yet."""

    def __init__(self, file: Path, kind: str) -> None:
        """Read a file; `kind` names it in every ConfigError, also in that of a file that cannot be read."""
        self.name = f"{kind} {file}"
        try:
            text = file.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{self.name}: cannot be read: {error}") from None
        if "\0" in text:
            raise ConfigError(f"{self.name}: expected a CSV file, got binary data")
        lines = text.splitlines()
        self.comments = [line for line in lines if line.startswith("#")]
        rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
        self.header = [cell.strip() for cell in next(csv.reader([rows[0][1]]))] if rows else []
        self._rows = rows[1:]

    def numbers(self, columns: Sequence[str]) -> Iterator[tuple[str, list[float]]]:
        """Yield for every row where it stands, as an error says it, and its numbers in these columns.

        Raises ConfigError for a column that is missing and for a row without that many numbers.
        """
        missing = [column for column in columns if column not in self.header]
        if missing:
            raise ConfigError(f"{self.name}: no column {missing[0]}, expected a header with {', '.join(columns)}")
        places = [self.header.index(column) for column in columns]
        for number, line in self._rows:
            where = f"{self.name}, line {number}"
            try:
                cells = next(csv.reader([line]))
                yield where, [float(cells[place]) for place in places]
            except (ValueError, IndexError, csv.Error):
                expected = f"expected numbers under {', '.join(columns)}"
                raise ConfigError(f"{where}: {expected}, got {line[:60]!r}") from None
