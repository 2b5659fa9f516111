"""The few figures of a drive that are shown first, on the screen and in a notebook: labels, values, units.

Knows a drive's summary; neither records nor how anything is shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import PLAYBACK, label_of

#: metrics with a number and a unit, in their order
SHOWN = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2", "max_lateral_deviation_m", "max_deceleration_mps2")


def key_figures(summary: Mapping[str, Any]) -> dict[str, str]:
    """Return how a drive went, by labels; a figure that the drive has not (NaN, in a file null) is `none`."""
    hit = f"yes, at {_number(summary, 'impact_speed_mps')}" if summary["collision"] else "no"
    return {
        label_of("outcome"): str(summary["outcome"]),
        label_of("collision"): hit,
        **{label_of(name): _number(summary, name) for name in SHOWN},
        label_of("emergency_used"): "braked" if summary["emergency_used"] else "not needed",
        label_of("duration_s"): f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks",
        **{label_of(name): _number(summary, name) for name in PLAYBACK if name in summary},
    }


def _number(summary: Mapping[str, Any], name: str) -> str:
    value = summary[name]
    return "none" if value is None or value != value else f"{value:.3f} {unit_of(name)}"
