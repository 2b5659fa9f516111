"""The geometry of a camera with a lens, against the formulas computed point by point and solved by bisection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.sensors.camera_model import BrownConrady, CameraModel, KannalaBrandt, Lens

#: of a wide-angle camera with a barrel distortion, and of a fisheye camera
WIDE = BrownConrady(-0.28, 0.07, 0.0012, -0.0008, -0.01)
FISHEYE = KannalaBrandt(-0.03, 0.006, -0.002, 0.0003)
NONE = BrownConrady()


def model(lens: Lens, focal: float = 1000.0) -> CameraModel:
    return CameraModel(1280, 720, focal, 1.02 * focal, 655.5, 348.25, lens)


def seen_by_brown_conrady(x: float, y: float, lens: BrownConrady) -> tuple[float, float]:
    r2 = x**2 + y**2
    radial = 1 + lens.k1 * r2 + lens.k2 * r2**2 + lens.k3 * r2**3
    across = x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x**2)
    return across, y * radial + lens.p1 * (r2 + 2 * y**2) + 2 * lens.p2 * x * y


@given(st.floats(-20.0, 20.0), st.floats(-10.0, 10.0), st.floats(20.0, 90.0))
def test_points_are_seen_where_the_formula_says(x: float, y: float, z: float) -> None:
    across, down = seen_by_brown_conrady(x / z, y / z, WIDE)
    expected = 655.5 + 1000.0 * across, 348.25 + 1020.0 * down
    assert model(WIDE).project(np.array([[x, y, z]]))[0] == pytest.approx(expected, abs=1e-9)


@given(st.floats(0.0, 1.2), st.floats(-math.pi, math.pi))
def test_a_fisheye_sees_a_ray_as_far_out_as_its_angle_says(angle: float, around: float) -> None:
    point = np.array([[math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), math.cos(angle)]])
    k1, k2, k3, k4 = FISHEYE
    out = angle + k1 * angle**3 + k2 * angle**5 + k3 * angle**7 + k4 * angle**9
    expected = 655.5 + 1000.0 * out * math.cos(around), 348.25 + 1020.0 * out * math.sin(around)
    assert model(FISHEYE).project(point)[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("lens", [WIDE, FISHEYE, NONE])
@given(st.floats(0.0, 1279.0), st.floats(0.0, 719.0))
def test_the_ray_of_a_pixel_is_seen_in_it(lens: Lens, column: float, row: float) -> None:
    slopes = model(lens).slopes(np.array([[column, row]]))
    seen = model(lens).project(np.column_stack((slopes, [1.0])))
    assert seen[0] == pytest.approx((column, row), abs=1e-4)


def test_along_an_axis_of_symmetry_the_ray_is_the_one_that_bisection_finds() -> None:
    lens, wanted = BrownConrady(-0.2, 0.03), 0.55
    low, high = 0.0, 1.2
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle * (1 - 0.2 * middle**2 + 0.03 * middle**4) < wanted else (low, middle)
    found = model(lens).slopes(np.array([[655.5 + 1000.0 * wanted, 348.25]]))[0]
    assert found == pytest.approx((low, 0.0), abs=1e-10)


def test_behind_the_camera_nothing_is_seen() -> None:
    assert np.isnan(model(NONE).project(np.array([[0.0, 0.0, -3.0], [1.0, 1.0, 0.0]]))).all()


def test_a_pixel_that_the_lens_has_no_ray_for_is_said() -> None:
    # Beyond r = 1 / sqrt(3 · 0.5) this lens folds the picture over: it never shows more than 0.544 focal lengths.
    with pytest.raises(ValueError, match=r"no ray within 75 degrees of the axis for the pixel in column 1280, row 348"):
        model(BrownConrady(-0.5)).slopes(np.array([[700.0, 348.25], [1280.0, 348.25]]))


def test_rays_too_far_from_the_axis_are_refused() -> None:
    with pytest.raises(ValueError, match="no ray within 75 degrees"):
        model(KannalaBrandt(), focal=300.0).slopes(np.array([[0.0, 348.25]]))


def test_the_grid_is_that_of_the_pixels() -> None:
    small = CameraModel(5, 3, 4.0, 4.0, 2.0, 1.0, NONE)
    expected = [[((c - 2) / 4, (r - 1) / 4) for c in range(5)] for r in range(3)]
    assert small.grid() == pytest.approx(np.array(expected))
