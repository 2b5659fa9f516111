"""A scene gains junctions, stop lines and buildings from the network that was driven on, and from no other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.isolated import REPOSITORY
from tests.view.made import Made
from vve_sumo.analysis.run import Run
from vve_sumo.view.frames import Frames
from vve_sumo.view.street import with_network

POLYGONS = """<additional>
  <poly id="house" type="building.yes" shape="{0},{1} {2},{1} {2},{3}"><param key="building:levels" value="3"/></poly>
  <poly id="pond" type="water" shape="{0},{1} {2},{1} {2},{3}"/>
</additional>"""


def scene_in(record: Path, working: Path) -> dict[str, Any]:
    run = Run(record)
    return with_network(Frames(run).scene, run.resolved, working)


def test_the_network_of_the_drive_is_read(made: Made) -> None:
    scene = scene_in(made.drive, REPOSITORY)
    assert scene["network"]["junctions"]
    assert scene["buildings"] == []
    x, y = zip(*(point for lane in scene["lanes"] for point in lane["points"]), strict=True)
    for outline in scene["network"]["junctions"]:
        assert any(
            min(x) - 30.0 <= u <= max(x) + 30.0 and min(y) - 30.0 <= v <= max(y) + 30.0 for u, v in outline["points"]
        )


def test_buildings_of_the_polygon_file_beside_the_network_are_read(made: Made, tmp_path: Path) -> None:
    (tmp_path / "networks").mkdir()
    name = "linden.net.xml"
    (tmp_path / "networks" / name).write_bytes((REPOSITORY / "networks" / name).read_bytes())
    x, y = Frames(Run(made.drive)).scene["path"][0]
    (tmp_path / "networks" / "linden.poly.xml").write_text(POLYGONS.format(x, y + 12.0, x + 9.0, y + 20.0))
    (house,) = scene_in(made.drive, tmp_path)["buildings"]
    assert house["height"] == 3 * 3.1
    assert house["points"] == [[x, y + 12.0], [x + 9.0, y + 12.0], [x + 9.0, y + 20.0]]


def test_a_network_that_is_another_by_now_is_left_out(made: Made, tmp_path: Path) -> None:
    (tmp_path / "networks").mkdir()
    changed = (REPOSITORY / "networks" / "linden.net.xml").read_text(encoding="utf-8") + "<!-- changed -->\n"
    (tmp_path / "networks" / "linden.net.xml").write_text(changed, encoding="utf-8")
    assert scene_in(made.drive, tmp_path)["network"] is None
