"""What drives mean: records and sweeps' datasets read, measured, compared, drawn and reported."""

from __future__ import annotations

from vve_sumo.analysis.braking import Comfort, Stop, comfort, stop_of
from vve_sumo.analysis.certificate import Certificate, certificate, certificates
from vve_sumo.analysis.cliff import Cliff, cliff_of
from vve_sumo.analysis.comparison import Comparison, compare
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency import latency_breakdown, legs_over_time
from vve_sumo.analysis.load import load
from vve_sumo.analysis.over_time import encroachment_of, exposure, over_time, zone_times
from vve_sumo.analysis.report import write_report
from vve_sumo.analysis.run import Motion, Run
from vve_sumo.analysis.sensing import braked_for_nothing, radar_statistics

__all__ = [
    "Certificate",
    "Cliff",
    "Comfort",
    "Comparison",
    "Motion",
    "Run",
    "Stop",
    "Sweep",
    "braked_for_nothing",
    "certificate",
    "certificates",
    "cliff_of",
    "comfort",
    "compare",
    "encroachment_of",
    "exposure",
    "latency_breakdown",
    "legs_over_time",
    "load",
    "over_time",
    "radar_statistics",
    "stop_of",
    "write_report",
    "zone_times",
]
