"""What stands along the street on its way from a file to a sensor; wires that cannot carry the sensor."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import REPOSITORY
from tests.drive.street import altered
from tests.sensors.scenes import actors
from vve_sumo.drive.assembly import sensors_of
from vve_sumo.drive.resolved_scenario import ResolvedScenario, resolve_scenario
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import ConfigError
from vve_sumo.rig.load import parse as parse_rig
from vve_sumo.scenario.load import parse
from vve_sumo.values import PointCloud

ROOF = {"name": "roof", "kind": "lidar", "settings": {"ideal": True}}
FRONT = {"name": "front", "kind": "camera"}


def with_house(folder: Path, sensors: list[dict[str, Any]]) -> ResolvedScenario:
    """`parked_car` with a house whose front is 8 m to the left of where the drive begins."""
    at = altered({}).path.at(0.0)
    ahead, left = (
        np.array([np.cos(at.heading), np.sin(at.heading)]),
        np.array([-np.sin(at.heading), np.cos(at.heading)]),
    )
    corners = [np.array([at.x, at.y]) + a * ahead + b * left for a, b in ((-10, 8), (20, 8), (20, 18), (-10, 18))]
    shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in corners)
    shutil.copy(REPOSITORY / "networks" / "linden.net.xml", folder / "linden.net.xml")
    poly = (
        f'<additional><poly id="h" type="building" shape="{shape}"><param key="height" value="7"/></poly></additional>'
    )
    (folder / "linden.poly.xml").write_text(poly, encoding="utf-8")
    file = REPOSITORY / "scenarios" / "parked_car.toml"
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    table["road"]["network"] = str(folder / "linden.net.xml")
    table["sensors"] = sensors
    return resolve_scenario("parked_car", parse(table, file), file, REPOSITORY)


def test_a_lidar_meets_the_house_beside_the_street_and_the_record_names_its_file(tmp_path: Path) -> None:
    resolved = with_house(tmp_path, [ROOF])
    assert "buildings" in resolved.to_dict(REPOSITORY)["files_sha256"]
    roof, at = sensors_of(resolved)["roof"], resolved.path.at(0.0)
    for tick in range(8):
        roof.step(0.02 * tick, pose_at_rest(at.x, at.y, at.heading), actors([]))
    assert isinstance(roof.output, PointCloud)
    points = roof.output.points()
    wall = points[points[:, 2] > -1.5]
    assert len(wall) > 500
    assert wall[:, 1] == pytest.approx(8.0, abs=0.01)


def test_where_no_sensor_sees_it_the_file_is_not_read(tmp_path: Path) -> None:
    resolved = with_house(tmp_path, [])
    assert "buildings" not in resolved.files
    assert resolved.street().buildings == ()


def test_a_camera_knows_the_lane_in_which_the_drive_begins() -> None:
    resolved = altered({"sensors": [FRONT | {"settings": {"ideal": True}}]})
    front, at = sensors_of(resolved)["front"], resolved.path.at(20.0)
    for tick in range(3):
        front.step(0.02 * tick, pose_at_rest(at.x, at.y, at.heading), actors([]))
    seen: Any = front.output
    assert seen.lane_known
    assert 2.5 < seen.lane_left + seen.lane_right < 4.5


@pytest.mark.parametrize(
    ("output", "sensors", "said"),
    [
        ('kind = "vlp16"\nudp = "127.0.0.1:2368"', [ROOF], "kind 'vlp16' needs sensor: name the scenario's lidar"),
        ('kind = "vlp16"\nsensor = "front"\nudp = "127.0.0.1:2368"', [FRONT], "'front' serves no points"),
        (
            'kind = "vlp16"\nsensor = "roof"\nudp = "127.0.0.1:2368"',
            [ROOF | {"settings": {"channels_deg": [-1.0, 1.0]}}],
            "'vlp16' cannot carry sensor 'roof': channels_deg: a VLP-16 has .*, got",
        ),
        ('kind = "sense"\nudp = "127.0.0.1:2368"', [ROOF], "kind 'sense' needs sensor: name the scenario's sensor"),
        (
            'kind = "sense"\nsensor = "roof"\nudp = "127.0.0.1:2368"',
            [ROOF | {"settings": {"azimuth_step_deg": 0.05}}],
            "'sense' cannot carry sensor 'roof': a turn has 115200 rays, expected 100000 at most",
        ),
        ('kind = "mobileye"\nsensor = "front"\nudp = "127.0.0.1:9"', [FRONT], "goes out on a CAN bus"),
    ],
)
def test_a_wire_that_cannot_carry_the_sensor_is_one_line(output: str, sensors: list[dict[str, Any]], said: str) -> None:
    file = REPOSITORY / "rigs" / "simulated.toml"
    text = file.read_text(encoding="utf-8") + f"\n[[outputs]]\n{output}\n"
    with pytest.raises(ConfigError, match=said) as refused:
        altered({"sensors": sensors}).with_rig(parse_rig(tomllib.loads(text), file), REPOSITORY)
    assert "\n" not in str(refused.value)
