"""The metrics of an invented lab: the name of their file and theirs."""

from __future__ import annotations

from pathlib import Path

TOY = Path(__file__).parent / "toy"
COMFORT = f"{TOY / 'lateral_comfort.py'}:make"
PEAK, HARD, COURSE = "max_lateral_acceleration_mps2", "hard_turn", "lateral_acceleration_mps2"
