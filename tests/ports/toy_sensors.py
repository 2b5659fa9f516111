"""Names of the sensors of an invented make, and one of them as a scenario's table."""

from __future__ import annotations

from pathlib import Path

TOY = Path(__file__).parent / "toy"
FINDER = f"{TOY / 'range_finder.py'}:make"
LISTER = f"{TOY / 'object_list.py'}:make"
AHEAD = {"name": "ahead", "kind": FINDER, "settings": {"sigma_m": 0.05}}
