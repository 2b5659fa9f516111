"""From the record of a drive to its picture: reads what the page is made of, and writes `drive.png`.

Draws nothing itself.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.drive.run import Drive
from vve_sumo.metrics.moment import Moment, moment_of
from vve_sumo.plotting.drive_page import draw
from vve_sumo.plotting.page import DrivePage, said

PICTURE = "drive.png"
#: an actor that no scan within this time of the moment detected is drawn as not seen [s]; a radar misses single scans
SCANS_AROUND: Final = 0.3


def page_of(run: Run) -> DrivePage:
    """Return what the page of a drive shows, from its record alone; a killed drive is shown up to its last tick."""
    moment = moment_of(run.data)
    roads = zip(*(run.arrow("roads")[name].to_pylist() for name in ("x_m", "y_m", "width_m")), strict=True)
    return DrivePage(
        title=run.title,
        subtitle=f"killed: the record ends at {run.time[-1]:.2f} s" if run.summary is None else said(run.summary),
        ticks=run.arrow("ticks"),
        actors=run.arrow("actors"),
        lead=run.lead,
        path=run.path,
        vehicle=run.vehicle,
        lanes=[(np.column_stack((x, y)), width) for x, y, width in roads],
        approach=run.data.approach,
        moment=moment,
        unseen=_unseen(run, moment) if moment else frozenset(),
        asked={name: bound for name, bound in (run.resolved["settings"].get("criteria") or {}).items() if bound},
    )


def _unseen(run: Run, moment: Moment) -> frozenset[str]:
    """Return the actors that the radar did not detect in any scan around the moment."""
    readings, detections = run.arrow("readings"), run.arrow("sensor_radar")
    near = np.abs(readings["measured_s"].to_numpy() - moment.time) <= SCANS_AROUND
    near &= np.array([name == "radar" for name in readings["sensor"].to_pylist()], bool)
    scans = readings["tick"].to_numpy()[near]
    rows = np.flatnonzero(np.isin(detections["tick"].to_numpy(), scans))
    return frozenset(run.data.actor_rows.names) - frozenset(detections["actor"].take(rows).to_pylist())


def draw_drive(drive: Drive) -> FilePath:
    """Write `drive.png` into the record of a drive and return its place."""
    file = drive.folder / PICTURE
    draw(page_of(Run(drive.folder)), file)
    return file
