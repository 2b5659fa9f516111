"""Checks the hashes of a record: whether each of its parts is as its drive left it.

Knows nothing of what the rows mean: whether the summary fits to the tables is not asked here.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.record.declared import read_resolved
from vve_sumo.record.hashes import hash_file, hash_part, hash_parts, hashed_files, whole
from vve_sumo.record.layout import (
    CLOSED_ENDING,
    LIVE_SCHEMAS,
    OPTIONAL_SCHEMAS,
    PROVENANCE,
    RAW_PARTS,
    SCHEMAS,
    TICK_METRICS,
    UNHASHED,
)
from vve_sumo.record.reader import holds_table, sensor_tables
from vve_sumo.record.summary import SUMMARY_HASH_KEY, sealed

SUMMARY: Final = "summary.json"


@dataclass(frozen=True, slots=True)
class Alteration:
    """A part of a record that is not as the drive left it."""

    part: str  #: "can.log", "ticks", "summary.json", …
    why: str  #: what shows it

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.part} is not as the drive left it: {self.why}"


def parts_of(altered: Sequence[Alteration] | None) -> list[str] | None:
    """Return the names of the altered parts, each once; None for None."""
    return None if altered is None else list(dict.fromkeys(each.part for each in altered))


def parts_altered_by_hash(folder: Path) -> list[str] | None:
    """Return the names of the parts that `alterations_by_hash` finds."""
    return parts_of(alterations_by_hash(folder))


def alterations_by_hash(folder: Path) -> list[Alteration] | None:
    """Return every part of a record whose hash is not the drive's; None for a drive that never wrote hashes.

    Such a drive was cut off, or could not read back its own files.
    """
    file = folder / SUMMARY
    if not file.exists():
        finished = all((folder / f"{name}{CLOSED_ENDING}").exists() for name in SCHEMAS)
        return [Alteration(SUMMARY, "it is gone, and the drive had finished its tables")] if finished else None
    try:
        text = file.read_text(encoding="utf-8")
        summary = json.loads(text)
        whole_seal = isinstance(summary, dict) and sealed(summary) == text
    except (OSError, ValueError) as error:
        return [Alteration(SUMMARY, f"it cannot be read: {error}")]
    if not isinstance(summary, dict):
        return [Alteration(SUMMARY, "expected a table of keys")]
    found = [] if whole_seal else [Alteration(SUMMARY, f"{SUMMARY_HASH_KEY} is not the hash of it")]
    if not summary.get("record_parts_sha256") and not _hashable(folder):
        return found or None
    return [*found, *_parts(folder, summary), *_files(folder, summary)]


def is_live(folder: Path, summary: dict[str, Any]) -> bool:
    """Return whether a record is of a live drive: one of three files suffices, as each may have been altered."""
    try:
        live = "rig" in read_resolved(folder)
    except ConfigError:
        live = False
    return live or "gateway_steps" in summary or any(folder.glob("gateway.*"))


def _hashable(folder: Path) -> bool:
    """Return whether every part can be read: then the drive must have written the hashes."""
    try:
        hash_parts(folder)
    except ConfigError:
        return False
    return True


def _parts(folder: Path, summary: dict[str, Any]) -> Iterator[Alteration]:
    """Compare the hash of every part that a record of its kind has."""
    digests = table_in(summary, "record_parts_sha256")
    gateway = [name for name in LIVE_SCHEMAS if name not in UNHASHED and is_live(folder, summary)]
    optional = [name for name in OPTIONAL_SCHEMAS if name in digests or holds_table(folder, name)]
    for name in (*RAW_PARTS, *SCHEMAS, *_sensor_tables(folder), *gateway, *optional):
        if name not in digests:
            yield Alteration(name, f"{SUMMARY} has no hash of it")
        elif not _is(digests[name], hash_part, folder, name):
            yield Alteration(name, f"its hash differs from {SUMMARY}'s")
    if summary.get("record_sha256") != whole({name: str(digest) for name, digest in digests.items()}):
        yield Alteration(SUMMARY, "record_sha256 is not that of the parts")


def _files(folder: Path, summary: dict[str, Any]) -> Iterator[Alteration]:
    """Compare the hash of the bytes of every table's file and of the provenance."""
    recorded, broken = table_in(summary, "record_files_sha256"), summary.get("record_broken") or ()
    always = (*SCHEMAS, *_sensor_tables(folder))
    tables = [f"{name}{CLOSED_ENDING}" for name in (*always, *LIVE_SCHEMAS)]
    own = [name for name in recorded if name == f"{TICK_METRICS}{CLOSED_ENDING}"]
    for name in dict.fromkeys((*tables, *own, PROVENANCE, *(file.name for file in hashed_files(folder)))):
        part = name.removesuffix(CLOSED_ENDING)
        missing = not (folder / name).exists()
        needed = part in (*always, PROVENANCE) or is_live(folder, summary)
        if name in recorded:
            if not _is(recorded[name], hash_file, folder / name):
                yield Alteration(part, f"its file's hash differs from {SUMMARY}'s")
        elif not missing:
            yield Alteration(part, f"{SUMMARY} has no hash of its file")
        elif needed and part not in broken and not (folder / f"{part}.arrows").exists():
            yield Alteration(part, "it is gone")


def _sensor_tables(folder: Path) -> tuple[str, ...]:
    """Return the names of the sensors' tables; none where `scenario.json` is damaged, which its own hash shows."""
    try:
        return tuple(sensor_tables(folder))
    except ConfigError:
        return ()


def table_in(summary: dict[str, Any], key: str) -> dict[str, Any]:
    """Return a table of a summary; empty where that is gone or no table."""
    table = summary.get(key)
    return table if isinstance(table, dict) else {}


def _is(then: object, hashed: Callable[..., str], *of: Any) -> bool:
    """Return whether a hash is still the same; false for a file that cannot be read."""
    try:
        return hashed(*of) == then
    except ConfigError:
        return False
