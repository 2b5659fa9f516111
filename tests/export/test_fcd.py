"""FCD files as SUMO's own schema, library and tools read them."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import sumolib
import xmlschema

from tests.export.made import ACTORS, HEADING, ROADS, TICKS, TIME, X, Y, away, box_at, record, with_roads
from vve_sumo.analysis import Run
from vve_sumo.export.write import export

sumo = pytest.importorskip("sumo", reason="SUMO's tools and schemas come with eclipse-sumo")
CENTIMETRE = 0.01
SCHEMA = Path(sumo.SUMO_HOME) / "data" / "xsd" / "fcd_file.xsd"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(record(tmp_path_factory.mktemp("fcd") / "mine", {"outcome": "timeout"}))


@pytest.fixture(scope="module")
def file(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (file,) = export(run, "fcd", tmp_path_factory.mktemp("out"))
    return file


def test_it_is_named_after_the_record_and_valid_by_sumos_schema(file: Path) -> None:
    assert file.name == "mine.fcd.xml"
    xmlschema.XMLSchema(str(SCHEMA)).validate(str(file))


def test_sumolib_reads_every_body_within_a_centimetre(run: Run, file: Path) -> None:
    steps = list(sumolib.xml.parse(str(file), "timestep"))
    assert [float(step.time) for step in steps] == pytest.approx(TIME.tolist(), abs=1e-9)
    ahead = run.vehicle.rear_axle_to_bumper
    for tick, step in enumerate(steps):
        found = {one.id: one for one in step.getChildList()}
        wanted = {"ego": (X[tick] + ahead * math.cos(HEADING[tick]), Y[tick] + ahead * math.sin(HEADING[tick]))}
        directions = {"ego": HEADING[tick]}
        for actor in (actor for actor in ACTORS if not away(actor, tick)):
            row = box_at(actor, tick)
            half, directions[actor] = 0.5 * row["length_m"], row["heading_rad"]
            wanted[actor] = (row["x_m"] + half * math.cos(row["heading_rad"]),
                             row["y_m"] + half * math.sin(row["heading_rad"]))  # fmt: skip
        assert set(found) == set(wanted)
        for name, (x, y) in wanted.items():
            assert math.hypot(float(found[name].x) - x, float(found[name].y) - y) < CENTIMETRE
            # SUMO's angle is that of a compass: its sine points east, its cosine north.
            angle, heading = math.radians(float(found[name].angle)), directions[name]
            assert 0.0 <= angle <= math.tau
            assert math.hypot(math.sin(angle) - math.cos(heading), math.cos(angle) - math.sin(heading)) < 1e-4
        assert {one.id for one in step.person or []} == {"walker"}
        assert float(found["walker"].speed) == 1.5


def test_sumos_trace_exporter_takes_it(file: Path, tmp_path: Path) -> None:
    tool = Path(sumo.SUMO_HOME) / "tools" / "traceExporter.py"
    out = tmp_path / "trace.gpx"
    arguments = ["-i", str(file), "--persons", "--orig-ids", "--gpx-output", str(out)]
    subprocess.run([sys.executable, str(tool), *arguments], check=True, capture_output=True, timeout=60)
    tracks = {track.findtext("name"): len(track.findall(".//trkpt")) for track in ElementTree.parse(out).iter("trk")}
    assert tracks == dict.fromkeys(("ego", *ACTORS), TICKS) | {"lorry.7": TICKS - 20}


def test_a_car_that_rolls_back_has_no_negative_speed(tmp_path: Path) -> None:
    (file,) = export(Run(record(tmp_path / "back", {"outcome": "timeout"}, speed=-0.5)), "fcd", tmp_path)
    speeds = [float(one.speed) for step in sumolib.xml.parse(str(file), "timestep") for one in step.vehicle]
    assert min(speeds) == 0.0


def test_lanes_and_positions_are_those_that_sumolib_measures(tmp_path: Path) -> None:
    (file,) = export(Run(with_roads(tmp_path / "mine")), "fcd", tmp_path)
    xmlschema.XMLSchema(str(SCHEMA)).validate(str(file))
    lines = {road["lane"]: [*zip(road["x_m"], road["y_m"], strict=True)] for road in ROADS}
    for step in sumolib.xml.parse(str(file), "timestep"):
        found = {one.id: one for one in step.getChildList()}
        ego = found["ego"]
        assert ego.lane == ":bend_0_0"  # which overlaps with none of the others
        at = sumolib.geomhelper.polygonOffsetWithMinimumDistanceToPoint((float(ego.x), float(ego.y)), lines[ego.lane])
        assert float(ego.pos) == pytest.approx(at, abs=CENTIMETRE)
        assert (found["parked"].lane, found["parked"].pos) == ("", None)  # beside every lane
        x = float(found["walker"].x)
        assert found["walker"].edge == (":bend_c0" if abs(x) <= 10.0 else "")
        if found["walker"].edge:
            assert float(found["walker"].pos) == pytest.approx(10.0 + x, abs=CENTIMETRE)


@pytest.mark.thorough
def test_sumos_plot_of_trajectories_finds_every_vehicle(tmp_path: Path) -> None:
    """The tool wants a lane of every vehicle."""
    (file,) = export(Run(with_roads(tmp_path / "mine")), "fcd", tmp_path)
    tool, out = Path(sumo.SUMO_HOME) / "tools" / "plot_trajectories.py", tmp_path / "t.csv"
    arguments = ["-t", "ts", "--blind", "--csv-output", str(out), "-o", str(tmp_path / "t.png"), str(file)]
    subprocess.run([sys.executable, str(tool), *arguments], check=True, capture_output=True, timeout=120)
    rows = [line for line in out.read_text().splitlines() if line[:1].isdecimal()]
    assert len(rows) == 3 * TICKS - 20  # ego, parked, and the lorry while it is there
