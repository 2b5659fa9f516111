"""The folder of a hunt: what was asked, every episode on a line of its own, what was found.

A line is written whole or, where the program is killed, cut off and left out when the hunt is taken up again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.hunt.runner import EpisodeResult

QUERY: Final = "hunt.json"
EPISODES: Final = "episodes.jsonl"
FOUND: Final = "found"
REPORT: Final = "report.txt"


class HuntJournal:
    """A hunt's folder; raises ConfigError for a folder that cannot be used."""

    def __init__(self, folder: Path, query: dict[str, Any], *, resume: bool) -> None:
        """Begin a hunt in an absent or empty folder, or with `resume` take up the one that is there."""
        self.folder = folder
        begun = (folder / QUERY).is_file()
        if resume and begun:
            self._check(query)
        elif folder.exists() and any(folder.iterdir()):
            hint = "take it up with --resume, or name another" if begun else "name another"
            raise ConfigError(f"--out: {folder} is not empty; {hint}")
        self.results: dict[str, EpisodeResult] = dict(self._read())
        (folder / FOUND).mkdir(parents=True, exist_ok=True)
        (folder / QUERY).write_text(json.dumps(query, indent=1) + "\n", encoding="utf-8")
        # A line that was cut off must not be joined with the next one.
        self._file = (folder / EPISODES).open("a", encoding="utf-8")
        if self._file.tell():
            self._file.write("\n")

    def _check(self, query: dict[str, Any]) -> None:
        before = json.loads((self.folder / QUERY).read_text(encoding="utf-8"))
        for key, value in query.items():
            if before.get(key) != value:
                raise ConfigError(f"--resume: the hunt in {self.folder} has {key} {before.get(key)!r}, not {value!r}")

    def _read(self) -> Iterator[tuple[str, EpisodeResult]]:
        file = self.folder / EPISODES
        if not file.is_file():
            return
        with file.open(encoding="utf-8") as lines:
            for line in lines:
                try:
                    data = json.loads(line)
                    yield data["name"], EpisodeResult.from_dict(data)
                except (ValueError, KeyError):
                    continue  # cut off, or empty

    def add(self, name: str, result: EpisodeResult) -> None:
        """Keep what came of an episode."""
        self.results[name] = result
        self._file.write(json.dumps({"name": name} | result.to_dict()) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
