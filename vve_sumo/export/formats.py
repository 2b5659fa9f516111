"""The formats that a drive or a sweep can be exported to: what each is called, what it needs, what makes its files.

To add one, write its module beside this one and enter a row in FORMATS. A maker returns the content of its files and
writes nothing. What a maker imports is imported when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vve_sumo.export.part import ExportPart

if TYPE_CHECKING:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.run import Run


@dataclass(frozen=True, slots=True)
class Format:
    """One format."""

    name: str  #: of the option, without dashes, and in Python
    summary: str  #: for the help
    ending: str  #: of its files
    of_drive: Callable[[Run], Iterable[ExportPart]]
    of_sweep: Callable[[Sweep], Iterable[ExportPart]] | None = None  #: None where a sweep has no such form
    needs: str = ""  #: extra of vve-sumo that has to be installed


def _csv(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import csv_tables

    return csv_tables.of_drive(run)


def _csv_of_sweep(sweep: Sweep) -> Iterable[ExportPart]:
    from vve_sumo.export import csv_tables

    return csv_tables.of_sweep(sweep)


def _fcd(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import fcd

    return fcd.of_drive(run)


def _commonroad(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import commonroad

    return commonroad.of_drive(run)


def _openscenario(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import openscenario

    return openscenario.of_drive(run)


def _mcap(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import mcap_file

    return mcap_file.of_drive(run)


def _osi(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import osi_traces

    return osi_traces.of_drive(run)


def _osi_mcap(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import osi_traces

    return osi_traces.mcap_of_drive(run)


def _asc(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import can_logs

    return can_logs.asc_of_drive(run)


def _blf(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import can_logs

    return can_logs.blf_of_drive(run)


def _mf4(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import mf4

    return mf4.of_drive(run)


def _rosbag2(run: Run) -> Iterable[ExportPart]:
    from vve_sumo.export import rosbag2

    return rosbag2.of_drive(run)


#: by name, in the order of the help
FORMATS: dict[str, Format] = {
    one.name: one
    for one in (
        Format("csv", "tables for pandas, R, MATLAB, Excel", ".csv", _csv, _csv_of_sweep),
        Format("fcd", "SUMO's floating car data: ego and actors at every tick", ".fcd.xml", _fcd),
        Format(
            "commonroad",
            "CommonRoad scenario (2020a): lanelets, obstacles, task",
            ".commonroad.xml",
            _commonroad,
        ),
        Format(
            "openscenario",
            "ASAM OpenSCENARIO XML 1.2: every body follows its trajectory",
            ".xosc",
            _openscenario,
            needs="openscenario",
        ),
        Format(
            "mcap", "poses, scene, sensors, signals and CAN for Foxglove and Lichtblick", ".mcap", _mcap, needs="mcap"
        ),
        Format(
            "rosbag2",
            "the ROS 2 bridge's topics as a bag in MCAP storage",
            ".ros2.mcap",
            _rosbag2,
            needs="ros2",
        ),
        Format("osi", "ASAM OSI 3.8 traces: ground truth, radar detections", ".osi", _osi, needs="osi"),
        Format("osi-mcap", "the same two as one multi-channel trace", ".mcap", _osi_mcap, needs="osi"),
        Format("mf4", "the CAN frames as ASAM MDF 4 for asammdf, CANape, MATLAB", ".mf4", _mf4, needs="mf4"),
        Format("blf", "the CAN frames as a binary log of Vector's tools", ".blf", _blf),
        Format("asc", "the CAN frames as a text log of Vector's tools", ".asc", _asc),
    )
}
