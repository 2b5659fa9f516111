"""The folder of a hunt: what was asked and by which versions, every episode on a line of its own, what was found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from vve_sumo.config_file import read_json
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError
from vve_sumo.hunt.runner import EpisodeResult
from vve_sumo.record.sweep_folder import journal_entries
from vve_sumo.sweep.dataset import refuse_mixed
from vve_sumo.sweep.journal import Journal, replace_file

QUERY: Final = "hunt.json"
EPISODES: Final = "episodes.jsonl"
FOUND: Final = "found"
REPORT: Final = "report.txt"

#: of a line, with the types of their values; what these hold is checked by reading it
_KEYS: Final[dict[str, type]] = {
    "name": str, "episode": dict, "violations": list, "margins": dict, "outcome": str, "failure": str
}  # fmt: skip


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
        file = folder / EPISODES
        entries = journal_entries(file, _KEYS, "episode")
        self.results = dict(_result(file, line, entry) for line, entry in enumerate(entries, 1))
        (folder / FOUND).mkdir(parents=True, exist_ok=True)
        replace_file(folder / QUERY, (json.dumps(query | {"versions": decisive_versions()}, indent=1) + "\n").encode())
        self._journal = Journal(file, infinite=True)  # a margin is, where a reaction never came
        self._journal.rewrite(entries)

    def _check(self, query: dict[str, Any]) -> None:
        before = read_json(self.folder / QUERY, "a hunt", "rig")
        refuse_mixed(self.folder, before.get("versions", {}), decisive_versions())
        for key, value in query.items():
            if before.get(key) != value:
                raise ConfigError(f"--resume: the hunt in {self.folder} has {key} {before.get(key)!r}, not {value!r}")

    def add(self, name: str, result: EpisodeResult) -> None:
        """Keep what came of an episode."""
        self.results[name] = result
        self._journal.add({"name": name} | result.to_dict())

    def close(self) -> None:
        """Close the file."""
        self._journal.close()


def _result(file: Path, line: int, entry: dict[str, Any]) -> tuple[str, EpisodeResult]:
    """Return name and result of an episode by its line; raises ConfigError for a damaged one."""
    try:
        return entry["name"], EpisodeResult.from_dict(entry)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        what = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:200]
        raise ConfigError(f"{file}: line {line} is no finished episode: {what}: the file was damaged") from None
