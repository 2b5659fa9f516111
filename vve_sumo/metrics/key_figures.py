"""The few figures of a drive that are shown first, on the screen and in a notebook: labels, values, units.

Knows a drive's summary; neither records nor how anything is shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import METRICS, PLAYBACK, label_of

#: metrics with a number and a unit, in their order
SHOWN = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2", "max_lateral_deviation_m", "max_deceleration_mps2")


def key_figures(summary: Mapping[str, Any]) -> dict[str, str]:
    """Return how a drive went, by labels; a figure that the drive has not (NaN, in a file null) is `none`."""
    hit = f"yes, at {_number(summary, 'impact_speed_mps')}" if summary["collision"] else "no"
    return {
        label_of("outcome"): str(summary["outcome"]),
        label_of("collision"): hit,
        **{label_of(name): _number(summary, name) for name in SHOWN},
        label_of("braked_for"): str(summary.get("braked_for") or "nobody"),
        **({label_of("hardest_braking_for"): hardest} if (hardest := braked_hardest_for(summary)) else {}),
        label_of("emergency_used"): emergency_layer(summary),
        label_of("duration_s"): f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks",
        **{label_of(name): _number(summary, name) for name in PLAYBACK if name in summary},
    }


def emergency_layer(summary: Mapping[str, Any]) -> str:
    """Return in words what the emergency layer did; beside a contact nobody can say that it was not needed."""
    if summary["emergency_used"]:
        return "braked"
    return "did not brake" if summary.get("collision") else "not needed"


def braked_hardest_for(summary: Mapping[str, Any]) -> str:
    """Return the actor that the car braked hardest for, where that is another than the one its last stop was for."""
    hardest = str(summary.get("hardest_braking_for") or "")
    return "" if hardest == summary.get("braked_for") else hardest


def unmet(summary: Mapping[str, Any]) -> list[str]:
    """Return the labels of the criteria that a drive did not meet, in the order of the lines in `failed`."""
    names = (str(line).partition(" is ")[0] for line in summary.get("failed") or ())
    return [label_of(name) for name in names if name in METRICS]


def _number(summary: Mapping[str, Any], name: str) -> str:
    value = summary[name]
    if value is None or value != value:
        return "none"
    cap = METRICS[name].cap
    return f"{cap:g} {unit_of(name)} or more" if value >= cap else f"{value:.3f} {unit_of(name)}"
