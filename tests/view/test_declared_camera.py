"""What a declared camera is: where it looks on the car, and one clear line for what is wrong with its file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vve_sumo.errors import ConfigError
from vve_sumo.sensors.camera_model import BrownConrady, KannalaBrandt
from vve_sumo.view.camera_pictures import plane_of
from vve_sumo.view.declared_camera import CameraFile, CameraMount, find_camera, load_camera


def test_a_camera_that_looks_ahead_has_its_axes_along_the_cars() -> None:
    mount = CameraMount(2.0, 0.5, 1.3)
    found = mount.camera_points(np.array([[12.0, 0.5, 1.3], [12.0, 1.5, 1.3], [12.0, 0.5, 0.3]]))
    assert found == pytest.approx(np.array([[0.0, 0.0, 10.0], [-1.0, 0.0, 10.0], [0.0, 1.0, 10.0]]))


@pytest.mark.parametrize(
    ("turned", "axis"),
    [
        ({"yaw": 0.3}, (math.cos(0.3), math.sin(0.3), 0.0)),
        ({"pitch": 0.2}, (math.cos(0.2), 0.0, -math.sin(0.2))),
        ({"yaw": math.pi / 2, "pitch": 0.2}, (0.0, math.cos(0.2), -math.sin(0.2))),
        ({"roll": 1.0}, (1.0, 0.0, 0.0)),
    ],
)
def test_the_axis_points_where_the_angles_say(turned: dict[str, float], axis: tuple[float, ...]) -> None:
    axes = CameraMount(0.0, 0.0, 1.0, **turned).axes()
    assert axes[2] == pytest.approx(axis)
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_a_camera_that_rolls_has_its_right_side_down() -> None:
    right = CameraMount(0.0, 0.0, 1.0, roll=0.1).axes()[0]
    assert right == pytest.approx((0.0, -math.cos(0.1), -math.sin(0.1)))


def test_a_file_is_read_with_what_it_leaves_out(tmp_path: Path) -> None:
    file = tmp_path / "roof.toml"
    file.write_text('focal_x_px = 900.0\nlens = "kannala_brandt"\ndistortion = [0.01]\nz_m = 1.6\npitch_deg = 3.0\n')
    camera = load_camera(file)
    assert (camera.name, camera.rate, camera.mount.z) == ("roof", 15.0, 1.6)
    assert camera.mount.pitch == pytest.approx(math.radians(3.0))
    model = camera.model
    assert (model.columns, model.rows, model.focal_y) == (1280, 720, 900.0)
    assert (model.centre_x, model.centre_y) == (639.5, 359.5)
    assert model.lens == KannalaBrandt(0.01)
    assert camera.to_dict()["pitch_deg"] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "key 'focal_x_px' is missing"),
        ("focal_x_px = -3.0", "focal_x_px"),
        ("focal_x_px = nan", "focal_x_px"),
        ("focal_x_px = 700.0\nfov_deg = 3", "fov_deg"),
        ('focal_x_px = 700.0\nlens = "kannala_brandt"\ndistortion = [0.0, 0.0, 0.0, 0.0, 0.0]', "at most 4 numbers"),
        ("focal_x_px = 600.0\ndistortion = [-0.9]", "the lens has no ray within 75 degrees of the axis"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "front.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_camera(file)
    assert str(file) in str(raised.value)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_camera_of_the_drive_is_found_by_its_name() -> None:
    own = {"rows_px": 480, "field_of_view_deg": 52.0, "z_m": 1.25, "yaw_deg": 4.0}
    sensors = [{"name": "roof", "kind": "lidar"}, {"name": "front", "kind": "camera", "settings": own}]
    resolved = {"settings": {"sensors": sensors}}
    camera = find_camera("front", resolved)
    assert camera.model.focal_x == pytest.approx(640.0 / math.tan(math.radians(26.0)))
    assert (camera.model.rows, camera.mount.z) == (480, 1.25)
    assert camera.mount.yaw == pytest.approx(math.radians(4.0))
    with pytest.raises(ConfigError, match=r"--camera roof: expected a camera of the drive .*the drive has front"):
        find_camera("roof", resolved)
    with pytest.raises(ConfigError, match="the drive has none"):
        find_camera("front", {"settings": {"sensors": []}})


def test_the_plane_of_a_pinhole_is_its_picture() -> None:
    plane = plane_of(CameraFile(columns_px=64, rows_px=64, focal_x_px=80.0).camera("small"))
    assert (plane.columns, plane.rows) == (64, 64)
    assert (plane.left, plane.right) == pytest.approx((-0.4, 0.4))
    assert plane.lookup[0, 0] == pytest.approx((0.5 / 64, 0.5 / 64))
    assert plane.lookup[63, 63] == pytest.approx((63.5 / 64, 63.5 / 64))


def test_the_plane_of_a_lens_holds_every_ray_and_is_nowhere_coarser_than_the_picture() -> None:
    camera = CameraFile(columns_px=320, rows_px=180, focal_x_px=150.0, distortion=[-0.2, 0.03]).camera("wide")
    assert camera.model.lens == BrownConrady(-0.2, 0.03)
    plane = plane_of(camera)
    assert plane.lookup.min() > 0.0
    assert plane.lookup.max() < 1.0
    assert np.diff(plane.lookup[..., 0], axis=1).min() * plane.columns >= 1.0
    assert np.diff(plane.lookup[..., 1], axis=0).min() * plane.rows >= 1.0
