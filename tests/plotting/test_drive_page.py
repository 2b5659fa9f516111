"""The picture of a drive: what shows in which panel, read back from the PNG's own dots."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tests import vehicles
from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.moment import Moment, MomentMeasure
from vve_sumo.path import ReferencePath
from vve_sumo.plotting import birds_eye, drive_page, page
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.record.rows import TickRow

CAR = vehicles.FUSION.vehicle
PLAIN = {"int": 0, "float": 0.0, "bool": False, "str": ""}
PIXELS = (round(page.SIZE[1] * page.DOTS_PER_INCH), round(page.SIZE[0] * page.DOTS_PER_INCH))
SPEED, GAP, ACCELERATION, DEVIATION = range(4)
ESTIMATED = ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")


def page_of(rows: list[dict[str, Any]], actors: list[dict[str, Any]], heading: float = 0.0) -> page.DrivePage:
    """Lay rows on a straight path of 300 m with one lane, running from the map's origin along `heading`."""
    plain = {f.name: PLAIN[str(f.type)] for f in dataclasses.fields(TickRow)}
    table = [plain | {"tick": n, "time_s": 0.02 * n, "state": "engaged"} | row for n, row in enumerate(rows)]
    ticks = pa.Table.from_pylist(table, SCHEMAS["ticks"])
    usual = {"y_m": 0.0, "heading_rad": heading, "speed_mps": 0.0, "length_m": 4.0, "width_m": 2.0}
    others = pa.Table.from_pylist([usual | row for row in actors], SCHEMAS["actors"])
    s = np.arange(0.0, 301.0, 2.0)
    path = ReferencePath.from_points(s * math.cos(heading), s * math.sin(heading))
    lane = np.array([[0.0, 0.0], [300.0 * math.cos(heading), 300.0 * math.sin(heading)]])
    lead = DriveData(ticks, others, path, CAR, 0.02).lead
    return page.DrivePage("a title", "a subtitle", ticks, others, lead, path, CAR, [(lane, 3.5)])


def driving(count: int, heading: float = 0.0, begin: float = 0.0, **more: Any) -> list[dict[str, Any]]:
    """Return ticks of a car that drives along `heading` from `begin` to 200 m, braking a little."""
    rows = []
    for way in np.linspace(begin, 200.0, count).tolist():
        at = {"x_m": way * math.cos(heading), "y_m": way * math.sin(heading), "heading_rad": heading}
        motion = at | {"speed_mps": 8.0, "acceleration_mps2": -1.0}
        rows.append({**motion, **{f"true_{name}": value for name, value in motion.items()}, "s_m": way} | more)
    return rows


def painted(content: page.DrivePage, folder: Path) -> Any:
    """Return the picture's dots, rows x columns x (red, green, blue), each 0 to 1."""
    drive_page.draw(content, folder / "drive.png")
    return image.imread(folder / "drive.png")[..., :3]


def part(dots: Any, left: float, low: float, width: float, height: float) -> Any:
    """Cut a rectangle given in inches from the page's lower left corner, without its frame."""
    columns = slice(round(left * page.DOTS_PER_INCH) + 3, round((left + width) * page.DOTS_PER_INCH) - 3)
    top = page.SIZE[1] - low - height
    return dots[
        round(top * page.DOTS_PER_INCH) + 3 : round((top + height) * page.DOTS_PER_INCH) - 3,
        columns,
    ]


def curve(dots: Any, row: int) -> Any:
    """Cut one of the four panels over time."""
    pitch = (page.TOP - page.BOTTOM + page.BETWEEN) / 4
    height = pitch - page.BETWEEN
    return part(dots, page.RIGHT, page.TOP - row * pitch - height, page.RIGHT_WIDTH, height)


def street(dots: Any) -> Any:
    """Cut both windows on the virtual road, and the line between them."""
    return part(dots, page.LEFT, page.BOTTOM, page.LEFT_WIDTH, page.TOP - page.BOTTOM)


def shows(dots: Any, colour: str) -> Any:
    """Return where dots have a colour, rows x columns."""
    wanted = np.array([int(colour[n : n + 2], 16) / 255.0 for n in (1, 3, 5)])
    return np.abs(dots - wanted).max(axis=-1) < 0.02


def inked(dots: Any) -> Any:
    """Return where dots are dark and without a hue, however thin the line, rows x columns."""
    return (dots.max(axis=-1) < 0.5) & (np.ptp(dots, axis=-1) < 0.1)


def dark(dots: Any) -> int:
    return int((dots.max(axis=-1) < 0.75).sum())


def drive_and_draw(folder: str) -> None:
    """Drive three seconds and draw them; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.plotting.drive_record import draw_drive

    resolved = altered({"duration_s": 3.0})
    draw_drive(drives.run(resolved, Path(folder), REPOSITORY))


@pytest.mark.thorough
def test_a_real_drive_fills_every_panel(tmp_path: Path) -> None:
    isolated(drive_and_draw, str(tmp_path / "record"))
    dots = image.imread(tmp_path / "record" / "drive.png")[..., :3]
    assert dots.shape == (*PIXELS, 3)
    for colour in (page.ROAD, page.EGO, page.INK):
        assert shows(street(dots), colour).sum() > 200
    for row in (SPEED, DEVIATION):
        assert shows(curve(dots, row), page.EGO).sum() > 200
    assert shows(curve(dots, ACCELERATION), page.EGO_PALE).sum() > 200
    assert not shows(curve(dots, GAP), page.OBSTACLE).any()


NO_POSE = dict.fromkeys((*ESTIMATED, *(f"true_{name}" for name in ESTIMATED), "s_m"), math.nan)
NO_TRUTH = {name: math.nan for name in NO_POSE if name.startswith("true_")} | {"lateral_deviation_m": math.nan}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "rows",
    [
        pytest.param(driving(1), id="one tick"),
        pytest.param(driving(3, **NO_POSE, lateral_deviation_m=math.nan), id="no pose at all"),
        pytest.param(driving(1, **NO_POSE), id="one tick without a pose"),
        pytest.param([*driving(2, **NO_POSE), *driving(20)], id="a pose from the third tick on"),
        pytest.param([*driving(20), *driving(2, **NO_POSE)], id="a pose that is lost"),
        pytest.param(driving(20, **NO_TRUTH, state="disarmed"), id="playback"),
        pytest.param([driving(20)[0]] * 20, id="a car that never moves"),
        pytest.param(
            driving(20, speed_mps=math.nan, acceleration_setpoint_mps2=math.nan), id="columns without a number"
        ),
        pytest.param(driving(20, contacts="gone"), id="contact with an actor that left"),
    ],
)
def test_a_poor_record_still_makes_a_picture_that_says_so(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    dots = painted(page_of(rows, []), tmp_path)
    assert dots.shape == (*PIXELS, 3)
    assert dark(street(dots)) > 50
    for row in range(4):
        assert dark(curve(dots, row)) > 20


def test_the_gap_shows_only_where_something_is_ahead(tmp_path: Path) -> None:
    """An actor stands ahead for the first and the last third of the drive; between, the curve breaks."""
    actors = [{"tick": n, "actor": "parked", "x_m": 240.0} for n in range(90) if not 30 <= n < 60]
    content = page_of(driving(90, begin=100.0), actors)
    columns = shows(curve(painted(content, tmp_path), GAP), page.OBSTACLE).any(axis=0)
    third = len(columns) // 3
    assert columns[third - third // 4 : third - 10].all()
    assert not columns[third + 10 : 2 * third - 10].any()
    assert columns[2 * third + 10 : -10].all()


@pytest.mark.thorough
def test_the_gap_at_the_end_is_drawn_between_ego_and_obstacle(tmp_path: Path) -> None:
    """Bumper at 200 m and the overhang; a 4 m box 12 m ahead. Dots between the cars, and beside them, measure it."""
    x = 200.0 + CAR.rear_axle_to_bumper + 12.0 + 2.0
    content = page_of(driving(50), [{"tick": 49, "actor": "parked", "x_m": x}])
    lower = street(painted(content, tmp_path))[-300:]
    ego, obstacle = (np.flatnonzero(shows(lower, colour).sum(axis=0) > 20) for colour in (page.EGO, page.OBSTACLE))
    metre = page.LEFT_WIDTH * page.DOTS_PER_INCH / (12.0 + 2.0 * drive_page.CLOSE_UP)
    assert (obstacle[0] - ego[-1]) / metre == pytest.approx(12.0, abs=0.4)
    assert len(obstacle) / metre == pytest.approx(4.0, abs=0.4)
    side = round(np.nonzero(shows(lower, page.EGO))[0].mean())
    beside = lower[side + round(1.2 * metre) : side + round(2.0 * metre)]
    assert np.ptp(np.flatnonzero(inked(beside).any(axis=0))) / metre == pytest.approx(12.0, abs=0.4)


@pytest.mark.thorough
@pytest.mark.parametrize("heading", [0.0, 0.8, math.pi / 2.0, 2.5, -2.0])
def test_a_straight_street_lies_along_the_page_whatever_its_direction(heading: float, tmp_path: Path) -> None:
    content = page_of(driving(100, heading), [], heading)
    height = page.LEFT_WIDTH * drive_page.FLATTEST
    whole = part(painted(content, tmp_path), page.LEFT, page.TOP - height, page.LEFT_WIDTH, height)
    rows, columns = np.nonzero(shows(whole, page.EGO))
    expected = 200.0 / (200.0 + 2.0 * birds_eye.MARGIN)
    assert np.ptp(columns) / whole.shape[1] == pytest.approx(expected, abs=0.05)
    assert np.ptp(rows) < 30


@pytest.mark.thorough
def test_a_drive_that_nobody_obeyed_shows_what_was_asked(tmp_path: Path) -> None:
    """Asked -3 m/s2 to the end, granted nothing: only a drive that engaged draws the grant."""
    asked = {"acceleration_setpoint_mps2": -3.0, "granted_acceleration_mps2": 0.0}
    places = []
    for state in ("engaged", "disarmed"):
        dots = curve(painted(page_of(driving(50, **asked, state=state), []), tmp_path), ACCELERATION)
        requested, driven = (np.nonzero(where)[0].mean() for where in (inked(dots), shows(dots, page.EGO_PALE)))
        places.append(requested > driven)
    assert places == [False, True]


@pytest.mark.thorough
def test_the_hold_at_rest_is_not_drawn(tmp_path: Path) -> None:
    still = {"true_speed_mps": 0.0, "true_acceleration_mps2": 0.0, "granted_acceleration_mps2": -1.0}
    moving = {"granted_acceleration_mps2": -1.0}
    content = page_of([*driving(50, **moving), *driving(50, **still)], [])
    columns = np.flatnonzero(inked(curve(painted(content, tmp_path), ACCELERATION)).any(axis=0))
    width = page.RIGHT_WIDTH * page.DOTS_PER_INCH
    assert columns[-1] == pytest.approx(width / 2.0, abs=8.0)


@pytest.mark.thorough
def test_the_emergency_layer_shades_its_time_in_every_panel(tmp_path: Path) -> None:
    rows = [row | {"emergency": 50 <= n < 75} for n, row in enumerate(driving(100))]
    dots = painted(page_of(rows, []), tmp_path)
    for row in range(4):
        panel = curve(dots, row)
        yellow = (panel[..., 0] - panel[..., 2] > 0.2).mean(axis=0)
        tinted = np.flatnonzero(yellow > 0.5) / panel.shape[1]
        assert tinted[0] == pytest.approx(50 / 99, abs=0.01)
        assert tinted[-1] == pytest.approx(74 / 99, abs=0.01)


@pytest.mark.thorough
def test_the_first_contact_is_marked_in_every_panel(tmp_path: Path) -> None:
    plain = painted(page_of(driving(100), []), tmp_path)
    rows = [row | {"contacts": "parked" if n >= 60 else ""} for n, row in enumerate(driving(100))]
    marked = painted(page_of(rows, []), tmp_path)
    for row in range(4):
        before, after = curve(plain, row), curve(marked, row)
        columns = np.flatnonzero((np.abs(before - after).max(axis=-1) > 0.3).sum(axis=0) > 20)
        assert columns.mean() / before.shape[1] == pytest.approx(60 / 99, abs=0.01)
    assert shows(street(marked), page.INK).sum() > shows(street(plain), page.INK).sum() + 50


coordinate = st.floats(-1e4, 1e4)
angle = st.floats(-math.pi, math.pi)


@given(x=coordinate, y=coordinate, heading=angle, width=st.floats(1.0, 1e3), height=st.floats(1.0, 1e3))
def test_a_view_keeps_lengths_and_turns_its_heading_to_the_right(
    x: float, y: float, heading: float, width: float, height: float
) -> None:
    view = birds_eye.MapWindow(x, y, heading, width, height)
    ahead = view.place(np.array([x, x + 3.0 * math.cos(heading)]), np.array([y, y + 3.0 * math.sin(heading)]))
    assert ahead == pytest.approx(np.array([[0.0, 0.0], [3.0, 0.0]]), abs=1e-6)
    right, up = view.place(*view.corners().T).T
    assert np.abs(right) == pytest.approx(width / 2.0, abs=1e-6)
    assert np.abs(up) == pytest.approx(height / 2.0, abs=1e-6)


@pytest.mark.thorough
def test_a_drive_with_a_moment_writes_every_word_on_the_page_and_none_over_another() -> None:
    """A car that drives up to another one: words of the two windows neither leave the page nor cross."""
    speed = {"true_speed_mps": 8.0, "speed_mps": 8.0}
    rows = driving(200, begin=100.0, **speed, lateral_deviation_m=0.0)
    others = [{"tick": tick, "actor": "other", "x_m": 230.0, "radar_cross_section_m2": 10.0} for tick in range(200)]
    content = page_of(rows, others)
    content = dataclasses.replace(
        content,
        moment=Moment(150, 3.0, MomentMeasure.TIME_TO_COLLISION, 2.5, "other"),
        unseen=frozenset({"other"}),
        watching=["radar"],
        criteria={"stop_gap_m": {"min": 4.5, "max": 6.5}, "max_lateral_deviation_m": {"max": 0.15}},
    )
    with mpl.rc_context(page.STYLE):
        figure = Figure(figsize=page.SIZE, dpi=page.DOTS_PER_INCH)
        renderer = FigureCanvasAgg(figure).get_renderer()
        drive_page.paint(figure, content)
        figure.draw(renderer)
        words = [text for axes in figure.axes for text in (*axes.texts, axes._left_title, axes._right_title)]
        legends = [text for axes in figure.axes if axes.get_legend() for text in axes.get_legend().get_texts()]
        boxes = {text.get_text(): text.get_window_extent(renderer) for text in (*words, *legends) if text.get_text()}
    assert {"standing vehicle", "not seen by radar"} <= {*boxes}
    assert any(word.startswith("least time to collision (TTC) 2.50 s at 3.00 s") for word in boxes)
    assert {"ego 8.0 m/s", "standing vehicle 0.0 m/s", "±0.15 m", "middle 1, 2, 3 s later"} <= {
        word.removeprefix("required: ") for word in boxes
    }
    for word, box in boxes.items():
        assert box.x0 >= 0.0, word
        assert box.y0 >= 0.0, word
        assert box.x1 <= PIXELS[1], word
    for (word, box), (other, another) in itertools.combinations(boxes.items(), 2):
        assert not box.overlaps(another), (word, other)


def test_a_deviation_nobody_asked_for_has_no_guides() -> None:
    figure = Figure(figsize=page.SIZE)
    content = page_of(driving(20, lateral_deviation_m=0.05), [])
    drive_page.paint(figure, content)
    assert len(figure.axes[-1].lines) == 1


def test_the_gap_to_another_actor_than_the_one_that_mattered_has_a_colour_of_its_own() -> None:
    """A car ahead leaves in the middle and reveals another one: orange is the second half alone, green the first."""
    lead = [{"tick": tick, "actor": "lead", "x_m": 215.0, "speed_mps": 8.0} for tick in range(50)]
    stopped = [{"tick": tick, "actor": "stopped", "x_m": 230.0} for tick in range(100)]
    content = page_of(driving(100, begin=150.0), lead + stopped)
    content = dataclasses.replace(content, moment=Moment(80, 1.6, MomentMeasure.GAP, 5.0, "stopped"))
    figure = Figure(figsize=page.SIZE)
    drive_page.paint(figure, content)
    gap = next(axes for axes in figure.axes if axes.get_title(loc="left").startswith("gap"))
    curves = {
        line.get_color(): np.asarray(line.get_ydata(), float) for line in gap.lines if len(line.get_xdata()) == 100
    }
    assert np.flatnonzero(np.isfinite(curves[page.ACTOR])).tolist() == [*range(50)]
    assert np.flatnonzero(np.isfinite(curves[page.OBSTACLE])).tolist() == [*range(50, 100)]


@pytest.mark.parametrize(
    ("summary", "words"),
    [
        (
            {"outcome": "fault", "reasons": ["off_path"], "collision": False, "passed": True, "seed": 1},
            "stopped by the gateway: the car is farther off its path than allowed · no contact · criteria met · seed 1",
        ),
        (
            {"outcome": "stopped", "braked_for": "parked_car", "stop_gap_m": 4.5, "collision": False, "passed": None},
            "came to rest 4.50 m before parked car · no contact · not judged",
        ),
    ],
)
def test_the_end_of_a_drive_is_said_in_words(summary: dict[str, Any], words: str) -> None:
    assert page.outcome_text(summary) == words
