"""The mutants that may live: those of which it is argued that nobody could tell them from the module itself."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Final

ARGUED: Final = Path(__file__).parent / "equivalent.toml"


def argued(name: str, path: Path = ARGUED) -> dict[tuple[str, str, str], str]:
    """Return the key of every mutant of a module that may live, with the reason why; ValueError names a bad entry."""
    reasons: dict[tuple[str, str, str], str] = {}
    for entry in tomllib.loads(path.read_text())["equivalent"]:
        if set(entry) != {"module", "scope", "line", "changes", "reason"}:
            raise ValueError(f"{path.name}: an entry has module, scope, line, changes and reason, got {sorted(entry)}")
        if entry["module"] == name:
            for change in entry["changes"]:
                key = (entry["scope"], entry["line"], change)
                if key in reasons:
                    raise ValueError(f"{path.name}: argued twice: {name}, {key}")
                reasons[key] = entry["reason"]
    return reasons
