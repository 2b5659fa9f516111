"""Time to collision and deceleration needed, as the figures have them, against SUMO's own safety device on the ego."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from tests.drive.test_figures import ticks_of
from tests.isolated import isolated
from tests.world.streets import FUSION, PERIOD, demand, pose, street
from vve_sumo.drive import figures
from vve_sumo.drive.record import SCHEMAS
from vve_sumo.path import Path as Curve
from vve_sumo.values import Actors

LANE = -1.6  #: y of the one lane to the east [m]
TICKS = 500
#: A SUMO-driven car of 7 m/s, 60 m before an ego that comes with 15 m/s, brakes late and then falls back.
LEADER = (
    '<vType id="slow" length="4.3" width="1.8" maxSpeed="7" sigma="0.7" speedDev="0" actionStepLength="0.02"/>'
    '<vehicle id="leader" type="slow" depart="0" departPos="164" departLane="0" departSpeed="7">'
    '<route edges="east"/></vehicle>'
)
DEVICE = {
    "has.ssm.device": "true",
    "device.ssm.measures": "TTC DRAC",
    "device.ssm.thresholds": "1000 0.0001",
    "device.ssm.range": "150",
    "device.ssm.trajectories": "true",
}


def speed_at(time: float) -> float:
    """Speed of the ego [m/s]."""
    return 15.0 if time < 5.5 else max(5.0, 15.0 - 3.0 * (time - 5.5))


def rows_of(tick: int, seen: Actors) -> list[dict[str, object]]:
    names = ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m")
    columns = zip(seen.x, seen.y, seen.heading, seen.speed, seen.length, seen.width, strict=True)
    return [
        {"tick": tick, "actor": name} | dict(zip(names, map(float, row), strict=True))
        for name, row in zip(seen.ids, columns, strict=True)
    ]


def closing_in(folder: str) -> tuple[list[dict[str, float]], list[dict[str, object]], dict[float, tuple[str, str]]]:
    """Drive; return what a record holds of ego and actors, and what the device wrote, by time."""
    import libsumo

    from vve_sumo.world.anchor import EGO_TYPE
    from vve_sumo.world.street import World

    root = Path(folder)
    ego: list[dict[str, float]] = []
    actors: list[dict[str, object]] = []
    x = 100.0
    network, cars = street(root, 1), demand(root, LEADER)
    with World(network, demand=[cars], seed=3, period=PERIOD, vehicle=FUSION, warm_up=2 * PERIOD) as world:
        for key, value in (DEVICE | {"device.ssm.file": str(root / "ssm.xml")}).items():
            libsumo.vehicletype.setParameter(EGO_TYPE, key, value)
        for tick in range(TICKS):
            speed = speed_at(tick * PERIOD)
            world.place(pose(tick * PERIOD, x, LANE, 0.0, speed))
            assert world.step().faults == ()
            rear = x - FUSION.rear_axle_to_bumper
            now = {"true_x_m": rear, "true_y_m": LANE, "true_speed_mps": speed, "station_m": rear}
            # The device's own time is that of the step's beginning.
            ego.append(now | {"time_s": libsumo.simulation.getTime() - PERIOD})
            actors += rows_of(tick, world.actors())
            x += PERIOD * speed_at((tick + 1) * PERIOD)
    told: dict[float, tuple[str, str]] = {}
    for conflict in ElementTree.parse(root / "ssm.xml").iter("conflict"):
        assert conflict.attrib["foe"] == "leader"
        series = [conflict.find(name) for name in ("timeSpan", "TTCSpan", "DRACSpan")]
        columns = [part.attrib["values"].split() for part in series if part is not None]
        told |= {round(float(time), 2): (ttc, drac) for time, ttc, drac in zip(*columns, strict=True)}
    return ego, actors, told


def test_sumos_safety_device_on_the_ego_sees_what_the_figures_say(tmp_path: Path) -> None:
    """Tick for tick; the device writes two decimals."""
    ego, boxes, told = isolated(closing_in, str(tmp_path))
    ticks, actors = ticks_of(ego), pa.Table.from_pylist(boxes, SCHEMAS["actors"])
    line = np.arange(0.0, 1000.0, 5.0)
    seen = figures.ahead(ticks, actors, Curve.from_points(line, np.full_like(line, LANE)), FUSION)
    ttc, drac = figures.time_to_collision(seen), figures.deceleration_to_avoid(seen)
    compared = 0
    for tick, row in enumerate(ego):
        theirs = told.get(round(row["time_s"], 2), ("NA", "NA"))
        if np.isnan(ttc[tick]) or theirs[0] == "NA":
            # Where the two do not agree on whether the gap closes, it hardly does.
            assert np.isnan(ttc[tick]) == (theirs[0] == "NA") or abs(seen.closing_speed[tick]) < 0.06
            continue
        assert ttc[tick] == pytest.approx(float(theirs[0]), abs=0.006, rel=1e-4)
        assert drac[tick] == pytest.approx(float(theirs[1]), abs=0.006)
        compared += 1
    assert compared > 200
    assert np.nanmax(drac) > 1.9
    assert np.nanmin(ttc) < 2.5
