"""Plots in one house style: functions on a drive, a table or a comparison that return a Figure and write nothing."""

from __future__ import annotations

from vve_sumo.analysis.plots.cliffs import cliff
from vve_sumo.analysis.plots.comparisons import comparison
from vve_sumo.analysis.plots.drives import drive_sheet, safety_over_time
from vve_sumo.analysis.plots.grids import distribution, heat_map
from vve_sumo.analysis.plots.latencies import latency_ledger
from vve_sumo.analysis.plots.searches import boundary
from vve_sumo.analysis.plots.stops import gap_against_speed, stopping_distance
from vve_sumo.analysis.plots.style import save

__all__ = [
    "boundary",
    "cliff",
    "comparison",
    "distribution",
    "drive_sheet",
    "gap_against_speed",
    "heat_map",
    "latency_ledger",
    "safety_over_time",
    "save",
    "stopping_distance",
]
