"""Gap, headway, time to collision, deceleration needed: figures and analysis against SUMO's own safety device.

The device sits on the ego; it is driven once, and both tests read what it wrote.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from tests.isolated import isolated
from tests.metrics.tables import ticks_of
from tests.world.streets import ALONE, FUSION, PERIOD, demand, pose, street
from vve_sumo.metrics import following
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lead_vehicle import LeadVehicle
from vve_sumo.path import ReferencePath
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.values import EGO, Actors, Floats

LANE = -1.6  #: y of the one lane to the east [m]
TICKS = 500
REACTION = 0.5  #: before the ego would brake [s]
#: A SUMO-driven car of 7 m/s, 60 m before an ego that comes with 15 m/s, brakes late and then falls back.
LEADER = (
    '<vType id="slow" length="4.3" width="1.8" maxSpeed="7" sigma="0.7" speedDev="0" actionStepLength="0.02"/>'
    '<vehicle id="leader" type="slow" depart="0" departPos="164" departLane="0" departSpeed="7">'
    '<route edges="east"/></vehicle>'
)
DEVICE = {
    "has.ssm.device": "true",
    "device.ssm.measures": "TTC DRAC MDRAC SGAP TGAP",
    "device.ssm.thresholds": "1000 0.0001 0.0001 1000 1000",
    "device.ssm.mdrac.prt": str(REACTION),
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


class Driven(NamedTuple):
    """What a record holds of ego and actors, and what the device wrote."""

    ego: list[dict[str, float]]
    actors: list[dict[str, object]]
    reported: dict[float, dict[str, float]]  #: by time [s], by name; NaN where it has none


def closing_in(folder: str) -> Driven:
    """Drive."""
    import libsumo

    from vve_sumo.world.ego_sync import type_name
    from vve_sumo.world.world import World

    root = Path(folder)
    ego: list[dict[str, float]] = []
    actors: list[dict[str, object]] = []
    x = 100.0
    network, cars = street(root, 1), demand(root, LEADER)
    with World(network, demand=[cars], seed=3, period=PERIOD, egos=ALONE, warm_up=2 * PERIOD) as world:
        for key, value in (DEVICE | {"device.ssm.file": str(root / "ssm.xml")}).items():
            libsumo.vehicletype.setParameter(type_name(EGO), key, value)
        for tick in range(TICKS):
            speed = speed_at(tick * PERIOD)
            assert world.step({EGO: pose(tick * PERIOD, x, LANE, 0.0, speed)})[EGO].faults == ()
            rear = x - FUSION.rear_axle_to_bumper
            now = {"true_x_m": rear, "true_y_m": LANE, "true_speed_mps": speed, "s_m": rear}
            # The device's own time is that of the step's beginning.
            ego.append(now | {"time_s": libsumo.simulation.getTime() - PERIOD})
            actors += rows_of(tick, world.actors(EGO))
            x += PERIOD * speed_at((tick + 1) * PERIOD)
    return Driven(ego, actors, read(root / "ssm.xml"))


def read(file: Path) -> dict[float, dict[str, float]]:
    reported: dict[float, dict[str, float]] = {}
    for part in ElementTree.parse(file).getroot():
        assert part.attrib.get("foe", "leader") == "leader"
        series = {child.tag: child.attrib["values"].split() for child in part if "values" in child.attrib}
        for name in ("TTC", "DRAC", "MDRAC", "SGAP", "TGAP"):
            for time, value in zip(series["timeSpan"], series.get(f"{name}Span", ()), strict=False):
                reported.setdefault(round(float(time), 2), {})[name] = math.nan if value == "NA" else float(value)
    return reported


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    return isolated(closing_in, str(tmp_path_factory.mktemp("ssm")))


def seen_by(driven: Driven) -> LeadVehicle:
    ticks, actors = ticks_of(driven.ego), pa.Table.from_pylist(driven.actors, SCHEMAS["actors"])
    line = np.arange(0.0, 1000.0, 5.0)
    return DriveData(ticks, actors, ReferencePath.from_points(line, np.full_like(line, LANE)), FUSION, PERIOD).lead


def device(driven: Driven, name: str) -> Floats:
    """What the device wrote of a measure, tick by tick; NaN where it wrote nothing."""
    return np.array([driven.reported.get(round(row["time_s"], 2), {}).get(name, math.nan) for row in driven.ego])


def test_sumos_safety_device_on_the_ego_sees_what_the_figures_say(driven: Driven) -> None:
    """Tick for tick; the device writes two decimals."""
    seen = seen_by(driven)
    ttc, drac = seen.time_to_collision, seen.required_deceleration
    their_ttc, their_drac = device(driven, "TTC"), device(driven, "DRAC")
    # Where the two do not agree on whether the gap closes, it hardly does.
    differ = np.isnan(ttc) != np.isnan(their_ttc)
    assert (np.abs(seen.closing_speed[differ]) < 0.06).all()
    both = ~np.isnan(ttc) & ~np.isnan(their_ttc)
    np.testing.assert_allclose(ttc[both], their_ttc[both], atol=0.006, rtol=1e-4)
    np.testing.assert_allclose(drac[both], their_drac[both], atol=0.006)
    assert np.count_nonzero(both) > 200
    assert np.nanmax(drac) > 1.9
    assert np.nanmin(ttc) < 2.5


def test_sumos_safety_device_sees_what_the_measures_of_the_analysis_say(driven: Driven) -> None:
    seen, speed = seen_by(driven), np.array([row["true_speed_mps"] for row in driven.ego])
    gap, closing = seen.gap, seen.closing_speed
    measures = {
        "SGAP": gap,
        "TGAP": following.headway(gap, speed),
        "TTC": following.time_to_collision(gap, closing),
        "DRAC": following.required_deceleration(gap, closing),
        "MDRAC": following.required_deceleration(gap, closing, REACTION),
    }
    closes = closing > 0.06
    for name, ours in measures.items():
        theirs = device(driven, name)
        both = np.isfinite(theirs) & np.isfinite(ours) & (closes | (name in ("SGAP", "TGAP")))
        assert np.count_nonzero(both) > (480 if name in ("SGAP", "TGAP") else 200), name
        np.testing.assert_allclose(ours[both], theirs[both], atol=0.0061, rtol=1e-4, err_msg=name)
    assert np.nanmax(device(driven, "MDRAC")) > 2.5
