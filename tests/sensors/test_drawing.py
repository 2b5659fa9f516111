"""How a sensor's rows are drawn: placed as complex arithmetic places them, and one clear line for what does not fit."""

from __future__ import annotations

import cmath
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drive.street import altered
from tests.sensors.scenes import FUSION
from vve_sumo import cli
from vve_sumo.errors import ConfigError
from vve_sumo.sensors.drawing import (
    Boxes,
    Cartesian,
    FieldOfView,
    Mounting,
    Points,
    Polar,
    ViewSector,
    from_dict,
    placed,
    ranges,
    to_dict,
)
from vve_sumo.sensors.port import SensorColumn, SensorSettings, drawing_of

place = st.floats(-500.0, 500.0)
angle = st.floats(-3.2, 3.2)
mounting = st.builds(Mounting, x_m=st.floats(-5.0, 5.0), y_m=st.floats(-2.0, 2.0), yaw_rad=angle)


@given(frame=mounting, x=place, y=place, heading=angle, far=st.floats(0.0, 200.0), azimuth=angle)
def test_polar_and_cartesian_rows_lie_where_complex_arithmetic_says(
    frame: Mounting, x: float, y: float, heading: float, far: float, azimuth: float
) -> None:
    origin = complex(x, y) + complex(frame.x_m, frame.y_m) * cmath.exp(1j * heading)
    expected = origin + cmath.rect(far, heading + frame.yaw_rad + azimuth)
    own = cmath.rect(far, azimuth)
    table = {"r": np.array([far]), "a": np.array([azimuth]), "u": np.array([own.real]), "v": np.array([own.imag])}
    for drawing in (
        Points(place=Polar(range="r", azimuth="a"), frame=frame),
        Points(place=Cartesian(x="u", y="v"), frame=frame),
    ):
        shapes = placed(drawing, table, x, y, heading)
        assert complex(shapes.x[0], shapes.y[0]) == pytest.approx(expected, abs=1e-9)
        assert complex(shapes.origin_x[0], shapes.origin_y[0]) == pytest.approx(origin, abs=1e-9)
        assert ranges(drawing, table) == pytest.approx([far], abs=1e-9)


@given(frame=mounting, x=place, y=place, heading=angle, turn=angle, length=st.floats(0.1, 20.0))
def test_boxes_turn_with_their_frame_and_have_their_size(
    frame: Mounting, x: float, y: float, heading: float, turn: float, length: float
) -> None:
    drawing = Boxes(place=Cartesian(x="u", y="v"), frame=frame, heading="h", length="l", width="w")
    table = {name: np.array([value]) for name, value in zip("uvhlw", (7.0, -2.0, turn, length, 1.5), strict=True)}
    shapes = placed(drawing, table, x, y, heading)
    corners = [complex(*corner) for corner in shapes.corners()[0]]
    ahead = cmath.rect(1.0, heading + frame.yaw_rad + turn)
    assert sum(corners) / 4.0 == pytest.approx(complex(shapes.x[0], shapes.y[0]), abs=1e-9)
    assert corners[0] - corners[1] == pytest.approx(length * ahead, abs=1e-9)
    assert corners[0] - corners[3] == pytest.approx(1.5j * ahead, abs=1e-9)


def test_a_drawing_is_kept_as_json() -> None:
    view = FieldOfView(frame=Mounting(x_m=1.0), sectors=[ViewSector(range_m=50.0, half_angle_rad=0.5)])
    drawing = Points(place=Polar(range="r_m", azimuth="a_rad"), actor="who", view=view)
    assert from_dict(to_dict(drawing)) == drawing
    for spoilt in ({"shape": "picture"}, to_dict(drawing) | {"extra": 1}, to_dict(drawing) | {"place": {"range": 5}}):
        with pytest.raises(ConfigError, match=r"^drawing: ") as refused:
            from_dict(spoilt)
        assert "\n" not in str(refused.value)


class Declared(SensorSettings):
    columns = (SensorColumn("range_m", "float", "a"), SensorColumn("who", "str", "b"))


@pytest.mark.parametrize(
    ("drawing", "line"),
    [
        (Points(place=Polar(range="rang_m")), "drawing: range: column 'rang_m' is not declared, expected one of kind"),
        (Points(place=Polar(range="who")), "drawing: range: column 'who' is of kind str, expected one of kind float"),
        (Points(place=Polar(range="range_m"), actor="range_m"), "drawing: actor: column 'range_m' is of kind float"),
        (
            Boxes(place=Cartesian(x="range_m", y="range_m"), heading="h_rad", length="range_m", width="range_m"),
            "drawing: heading: column 'h_rad' is not declared",
        ),
        ("points", "drawing: expected points, rays, boxes or None, got 'points'"),
        (ZeroDivisionError("one"), "drawing raised ZeroDivisionError: one"),
    ],
)
def test_a_drawing_that_does_not_fit_is_one_line(drawing: Any, line: str) -> None:
    class Wrong(Declared):
        def drawing(self, vehicle: Any, /) -> Any:
            if isinstance(drawing, Exception):
                raise drawing
            return drawing

    with pytest.raises(ConfigError) as refused:
        drawing_of(Wrong(), FUSION)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


@pytest.mark.thorough
def test_a_drive_with_such_a_sensor_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toy = Path(__file__).parents[1] / "ports" / "toy" / "range_finder.py"
    file = tmp_path / "wrong.py"
    file.write_text(toy.read_text(encoding="utf-8").replace('Polar(range="range_m")', 'Polar(range="far_m")'), "utf-8")
    sensor = f'sensors=[{{name="mine",kind="{file}:make"}}]'
    assert cli.main(["drive", "parked_car", "--set", sensor, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "sensors.mine: drawing: range: column 'far_m' is not declared, expected one of kind float" in said
    assert not (tmp_path / "out").exists()


def test_what_is_shipped_needs_no_word_in_the_record() -> None:
    """So the record of a drive without sensors of others stays what it was, byte by byte."""
    assert "drawings" not in altered({}).to_dict(Path.cwd())
