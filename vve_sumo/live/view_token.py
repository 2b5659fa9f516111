"""Reads the token that a rig gives to a page of its drives, and where its certificate lies."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.rig.connections import RigView

_TOKEN: Final = re.compile(r"[A-Za-z0-9_-]{16,128}")


def token_of(view: RigView, working: Path, table: str = "view") -> str:
    """Return the token in the rig's file; empty where the rig names none, for one that is made anew.

    Raises ConfigError naming the key of the rig's `table`.
    """
    if view.token_file is None:
        return ""
    file = working / view.token_file
    try:
        token = file.read_text(encoding="ascii").strip()
    except (OSError, ValueError) as error:
        raise ConfigError(f"{table}.token_file: {file}: cannot be read: {error}") from None
    if not _TOKEN.fullmatch(token):
        raise ConfigError(f"{table}.token_file: {file}: expected 16 to 128 letters, digits, - and _")
    return token


def certificate_of(view: RigView, working: Path) -> tuple[str, ...]:
    """Return the paths of the certificate and of its key that a rig names, from `working`; empty without any."""
    named = [name for name in (view.certificate_file, view.key_file) if name is not None]
    return tuple(str(working / name) for name in named)
