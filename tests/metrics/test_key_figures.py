"""The figures that are shown first."""

from __future__ import annotations

import math

import pytest

from vve_sumo.metrics.key_figures import SHOWN, key_figures

DRIVE = dict.fromkeys(SHOWN, 1.25) | {
    "outcome": "stopped", "collision": False, "impact_speed_mps": 0.0, "emergency_used": False, "duration_s": 10.0,
    "ticks": 500,
}  # fmt: skip


@pytest.mark.parametrize(
    ("value", "shown"),
    [(4.2, "4.200 m/s²"), (11.99, "11.990 m/s²"), (12.0, "12 m/s² or more"), (None, "none"), (math.nan, "none")],
)
def test_a_deceleration_at_its_cap_stands_for_more(value: float | None, shown: str) -> None:
    assert key_figures(DRIVE | {"max_drac_mps2": value})["maximum DRAC"] == shown
