"""Writes a record's `summary.json`, which contains a hash of its own content."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

#: key of the hash over all other keys of a summary
SUMMARY_HASH_KEY = "summary_sha256"


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write a record's `summary.json` with the hash of its content; NaN and infinity become null."""
    half = folder / "summary.half"
    half.write_text(sealed(_finite(summary)), encoding="utf-8")
    half.replace(folder / "summary.json")


def sealed(summary: dict[str, Any]) -> str:
    """Return a summary as the text of its file, with the hash over all its other keys."""
    unsealed = {key: value for key, value in summary.items() if key != SUMMARY_HASH_KEY}
    seal = hashlib.sha256(_spelt(unsealed).encode()).hexdigest()
    return _spelt(unsealed | {SUMMARY_HASH_KEY: seal})


def _spelt(summary: dict[str, Any]) -> str:
    return json.dumps(summary, indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not (-float("inf") < value < float("inf")):
        return None
    return value
