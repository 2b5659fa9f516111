"""Plots in one house style: functions on a drive, a table or a comparison that return a Figure and write nothing."""

from __future__ import annotations

from vve_sumo.plotting.car_following import headways, string_stability
from vve_sumo.plotting.comparisons import comparison
from vve_sumo.plotting.drives import drive_overview, safety_over_time
from vve_sumo.plotting.grids import distribution, heat_map
from vve_sumo.plotting.latencies import latency_over_time
from vve_sumo.plotting.latency_margins import latency_margin
from vve_sumo.plotting.pairs import paired
from vve_sumo.plotting.parameter_spaces import parameter_space
from vve_sumo.plotting.responses import response
from vve_sumo.plotting.searches import boundary
from vve_sumo.plotting.steering_margins import steering_margin
from vve_sumo.plotting.stops import gap_against_speed, stopping_distance
from vve_sumo.plotting.style import save

__all__ = [
    "boundary",
    "comparison",
    "distribution",
    "drive_overview",
    "gap_against_speed",
    "headways",
    "heat_map",
    "latency_margin",
    "latency_over_time",
    "paired",
    "parameter_space",
    "response",
    "safety_over_time",
    "save",
    "steering_margin",
    "stopping_distance",
    "string_stability",
]
