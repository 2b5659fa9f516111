"""What drives mean: records and sweeps' datasets read, measured, compared, drawn and reported."""

from __future__ import annotations

from vve_sumo.analysis.braking import Comfort, Stop, comfort, stop_of
from vve_sumo.analysis.comparison import Comparison, compare
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.effects import variance_explained
from vve_sumo.analysis.latency import latency_breakdown, legs_over_time
from vve_sumo.analysis.latency_margin import LatencyMargin, latency_margin_of
from vve_sumo.analysis.load import load
from vve_sumo.analysis.over_time import encroachment_of, exposure, over_time, zone_times
from vve_sumo.analysis.paired import PairedComparison, compare_each, compare_rows, compare_sweeps, compare_within
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensing import braked_for_nothing, sensor_statistics
from vve_sumo.analysis.steering_study import SteeringStudy, steering_study_of
from vve_sumo.analysis.stopping_bound import StoppingBoundCheck, stopping_bound_check, stopping_bound_checks
from vve_sumo.analysis.string_stability import headway_distribution, string_stability, time_gap_error_of
from vve_sumo.metrics.drive_columns import Motion

__all__ = [
    "Comfort",
    "Comparison",
    "LatencyMargin",
    "Motion",
    "PairedComparison",
    "Run",
    "SteeringStudy",
    "Stop",
    "StoppingBoundCheck",
    "Sweep",
    "braked_for_nothing",
    "comfort",
    "compare",
    "compare_each",
    "compare_rows",
    "compare_sweeps",
    "compare_within",
    "encroachment_of",
    "exposure",
    "headway_distribution",
    "latency_breakdown",
    "latency_margin_of",
    "legs_over_time",
    "load",
    "over_time",
    "sensor_statistics",
    "steering_study_of",
    "stop_of",
    "stopping_bound_check",
    "stopping_bound_checks",
    "string_stability",
    "time_gap_error_of",
    "variance_explained",
    "zone_times",
]
