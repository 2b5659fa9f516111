"""How a file that is wrong is refused: in one line that names the file, whatever kind of file it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vve_sumo.errors import ConfigError


def complaint_of(parse: Callable[[dict[str, Any], Path], Any], table: dict[str, Any]) -> str:
    """Return the one line with which a table is refused, without the file's name."""
    with pytest.raises(ConfigError) as caught:
        parse(table, Path("mine.toml"))
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("mine.toml: ")
    return text.removeprefix("mine.toml: ")


def message(call: Callable[[], Any]) -> str:
    """Return the text of the ConfigError that a call raises."""
    with pytest.raises(ConfigError) as caught:
        call()
    return str(caught.value)
