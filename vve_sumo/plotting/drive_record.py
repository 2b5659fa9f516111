"""From the record of a drive to `drive.png`: reads the tables and the streets that the picture's page is made of.

Draws nothing itself.
"""

from __future__ import annotations

from pathlib import Path as FilePath

from vve_sumo.drive.resolved_scenario import PERIOD, ResolvedScenario
from vve_sumo.drive.run import Drive
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.plotting.drive_page import bounds, draw
from vve_sumo.plotting.page import DrivePage, said
from vve_sumo.record.reader import read_table
from vve_sumo.record.roads import roads_table
from vve_sumo.world.network import lane_shapes

PICTURE = "drive.png"


def draw_drive(resolved: ResolvedScenario, drive: Drive) -> FilePath:
    """Write `drive.png` into the record of a drive and return its place."""
    ticks, actors = read_table(drive.folder, "ticks"), read_table(drive.folder, "actors")
    data = DriveData(ticks, actors, resolved.path, resolved.vehicle, PERIOD, roads_table(resolved.lanes))
    page = DrivePage(
        title=resolved.scenario.title,
        subtitle=said(drive.summary),
        ticks=ticks,
        actors=actors,
        lead=data.lead,
        path=resolved.path,
        vehicle=resolved.vehicle,
        lanes=lane_shapes(resolved.network.path, bounds(ticks)),
        approach=data.approach,
    )
    file = drive.folder / PICTURE
    draw(page, file)
    return file
