"""The words and marks of a drive's picture: what they say, and that they hide nothing of what they speak of."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Annotation, Text

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, put_scans, write
from tests.plotting.test_drive_page import driving, page_of
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.moment import Moment, MomentMeasure
from vve_sumo.plotting import drive_page, drive_record, page

TICKS = 200
BEGIN = 100.0


def painted(content: page.DrivePage, placed: bool = False) -> Figure:
    """Return the picture; `placed` where it is asked for where things stand, which takes longer."""
    with mpl.rc_context(page.STYLE):
        figure = Figure(figsize=page.SIZE, dpi=page.DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        drive_page.paint(figure, content)
        if placed:
            figure.draw_without_rendering()
    return figure


def content(*actors: dict[str, Any], main: str = "other", at: int = 150, **more: Any) -> page.DrivePage:
    """Return a page of a drive from BEGIN to 200 m in 4 s; values of actors may be functions of the tick."""
    rows = [
        {"tick": tick} | {key: value(tick) if callable(value) else value for key, value in actor.items()}
        for tick in range(TICKS)
        for actor in actors
    ]
    made = page_of(driving(TICKS, begin=BEGIN), rows)
    return dataclasses.replace(made, moment=Moment(at, at * PERIOD, MomentMeasure.GAP, 5.0, main), **more)


def panel(figure: Figure, title: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_title(loc="left").startswith(title))


def words(axes: Axes) -> dict[str, Any]:
    """Return the boxes of all words in a panel, without what they are set on."""
    renderer = axes.figure.canvas.get_renderer()  # type: ignore[attr-defined]
    return {text.get_text(): Text.get_window_extent(text, renderer) for text in axes.texts if text.get_text()}


def said(figure: Figure) -> str:
    """Return everything that stands in the picture."""
    legends = [axes.get_legend() for axes in figure.axes]
    texts = [*figure.texts, *(text for legend in legends if legend for text in legend.get_texts())]
    texts += [text for axes in figure.axes for text in (*axes.texts, axes.title, axes._left_title)]  # type: ignore[attr-defined]
    return "\n".join(text.get_text() for text in texts)


def hidden(axes: Axes) -> list[tuple[str, Any]]:
    """Return the words that lie on a body."""
    bodies = [patch.get_window_extent() for patch in axes.patches if isinstance(patch, Polygon)]
    return [(word, body) for word, box in words(axes).items() for body in bodies if box.overlaps(body)]


PARKED = {"actor": "other", "x_m": 230.0}


def test_the_time_in_which_the_radar_lost_the_actor_is_hatched_and_said_and_no_mark_crosses_the_words() -> None:
    seen = {
        "sighted": [page.FirstSighting("radar", 0.5, 100.0)],
        "lost": [(1.0, 2.5), (3.5, 3.8)],
        "distance": np.full(TICKS, 8.0),
    }
    gap = panel(painted(content(PARKED, **seen), placed=True), "gap")
    hatched = [patch.get_window_extent() for patch in gap.patches if isinstance(patch, Rectangle) and patch.get_hatch()]
    spans = [gap.transData.inverted().transform(box.get_points())[:, 0].tolist() for box in hatched]
    assert spans == [pytest.approx([1.0, 2.5]), pytest.approx([3.5, 3.8])]
    # Of several times the last one before the moment, which is at 3 s, is the one that tells.
    there = words(gap)
    assert "lost at 1.00 s, seen again at 2.50 s ▨" in there
    line = next(line for line in gap.lines if [*line.get_xdata()] == [0.5, 0.5])
    lines = [box for word, box in there.items() if word.startswith(("radar", "lost", "least distance"))]
    assert len(lines) == 3
    assert max(mark.y1 for mark in (line.get_window_extent(), *hatched)) < min(box.y0 for box in lines)


def test_what_the_radar_lost_is_read_from_the_record(tmp_path: Path) -> None:
    """Scans every two ticks; single ones miss the actor, and none from 1 s to 3 s detects it."""
    time = np.arange(0.0, 4.0, PERIOD)
    folder = write(tmp_path / "record", moving(time, 5.0 * time, np.full_like(time, 5.0)))
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + 30.0}
    put(folder, "actors", [box | {"tick": tick} for tick in range(len(time))])
    seen = [tick for tick in range(0, len(time), 2) if not 50 < tick < 150 and tick % 10]
    echo = {"actor": "parked", "range_m": 20.0, "azimuth_rad": 0.0, "range_rate_mps": 0.0, "mode": 1}
    put_scans(folder, range(0, len(time), 2), [echo | {"tick": tick} for tick in seen])
    lost = drive_record.page_of(Run(folder)).lost
    assert [pytest.approx((48 * PERIOD, 152 * PERIOD))] == [*lost]


def test_the_limit_at_which_the_gateway_stopped_the_car_is_drawn(tmp_path: Path) -> None:
    time = np.arange(0.0, 4.0, PERIOD)
    rows = moving(time, 5.0 * time, np.full_like(time, 5.0))
    settings = {"title": "t", "seed": 1, "controller": {"name": "n"}, "radar": {}}
    settings |= {"ego": {"speed_mps": 5.0, "deviation_limit_m": 0.05}}
    for number, (reasons, drawn) in enumerate(((["off_path"], [0.05, -0.05]), (["pose_stale"], []))):
        summary = {"outcome": "fault", "reasons": reasons}
        run = Run(write(tmp_path / f"record{number}", rows, summary, settings=settings))
        figure = painted(drive_record.page_of(run))
        deviation = panel(figure, "true lateral deviation")
        level = [float(line.get_ydata()[0]) for line in deviation.lines if len(line.get_xdata()) == 2]
        assert level == drawn
        assert ("the gateway stops the car beyond ±0.05 m" in said(figure)) == bool(drawn)


def test_a_required_gap_stands_only_where_there_is_a_gap() -> None:
    """The other one is ahead for the first half, and beside the path, where only the distance is drawn, after it."""
    beside = PARKED | {"y_m": lambda tick: 0.0 if tick < 100 else 6.0}
    figure = painted(content(beside, criteria={"min_gap_m": {"min": 3.0}}, distance=np.full(TICKS, 8.0)))
    bound = next(line for line in panel(figure, "gap").lines if 3.0 in np.asarray(line.get_ydata(), float))
    assert np.flatnonzero(np.isfinite(bound.get_ydata())).tolist() == [*range(100)]
    assert "required: gap ≥ 3" in said(figure)


@pytest.mark.parametrize(("x", "scaled"), [(230.0, True), (215.0, False)])
def test_an_axis_of_two_scales_says_so(x: float, scaled: bool) -> None:
    """From 100 m away the last metres are drawn larger; of a gap that never was 20 m they need not."""
    near = {"actor": "other", "x_m": lambda tick: x if scaled else 115.0 + 100.0 * tick / TICKS}
    figure = painted(content(near))
    assert panel(figure, "gap").get_yscale() == ("function" if scaled else "linear")
    assert ("last 10 m enlarged" in said(figure)) == scaled


@pytest.mark.thorough
def test_no_word_lies_on_a_body() -> None:
    """An oncoming car, with cars that stand at its side all along the road, and beside the ego."""
    row = [{"actor": f"parked{n}", "x_m": 100.0 + 6.0 * n, "y_m": side} for n in range(20) for side in (-3.0, 6.5)]
    row = [one | {"actor": f"{one['actor']}{number}"} for number, one in enumerate(row)]
    oncoming = {"actor": "other", "x_m": lambda tick: 260.0 - 0.5 * tick, "y_m": 3.5, "speed_mps": 25.0}
    figure = painted(content(*row, oncoming | {"heading_rad": np.pi}), placed=True)
    for title in ("from above", "closest at"):
        axes = panel(figure, title)
        assert sum(isinstance(patch, Polygon) for patch in axes.patches) > 10
        assert hidden(axes) == []


def test_a_small_body_has_a_pointer_that_leaves_it_and_its_neighbour_free() -> None:
    """In a window of 1 km a car is a few dots long; two stand one before the other."""
    rows = driving(TICKS, begin=-800.0)
    others = [{"tick": tick, "actor": "other", "x_m": 210.0} for tick in range(TICKS)]
    drive = dataclasses.replace(page_of(rows, others), moment=Moment(150, 3.0, MomentMeasure.GAP, 5.0, "other"))
    figure = painted(drive, placed=True)
    axes = panel(figure, "from above")
    pointers = [
        line for line in axes.lines if str(line.get_marker()) in ("v", "^") and np.isfinite(line.get_xdata()).all()
    ]
    assert sorted(str(line.get_marker()) for line in pointers) == ["^", "v"]
    boxes = [line.get_window_extent() for line in pointers]
    bodies = [patch.get_window_extent() for patch in axes.patches if isinstance(patch, Polygon)]
    assert not any(one.overlaps(other) for one in boxes for other in (*bodies, *words(axes).values()))
    assert not boxes[0].overlaps(boxes[1])
    assert not any(str(line.get_marker()) == "o" and line.get_markersize() == 13.0 for line in axes.lines)


@pytest.mark.thorough
def test_a_trace_goes_on_to_where_the_body_is_drawn() -> None:
    """The other one meets the ego in the middle and is 150 m away in the end."""
    oncoming = {"actor": "other", "x_m": lambda tick: 200.0 - 0.7 * tick, "y_m": 3.5, "speed_mps": 35.0}
    figure = painted(content(oncoming, at=50))
    axes = panel(figure, "from above")
    trace = next(line for line in axes.lines if line.get_color() == page.OBSTACLE and len(line.get_xdata()) == TICKS)
    assert np.isfinite(trace.get_xdata()[-1])


def test_an_actor_that_has_a_name_is_called_by_it_everywhere() -> None:
    unnamed, named = (painted(content(PARKED, named=names)) for names in (frozenset[str](), frozenset(["other"])))
    assert "other 0.0 m/s" in said(named)
    assert "gap 5.00 m, other" in said(named)
    assert said(named).count("standing vehicle") == 1  # the legend says once what it is
    assert "other (standing vehicle)" in said(named)
    assert "other" not in said(unnamed).replace("other traffic", "")


def test_the_scenarios_actors_and_whom_the_subtitle_names_have_names(tmp_path: Path) -> None:
    settings = {"title": "t", "seed": 1, "controller": {"name": "n"}, "radar": {}}
    settings |= {"actors": [{"id": "child", "kind": "child"}], "obstacles": [{"id": "parked"}]}
    summary = {"outcome": "stopped", "braked_for": "suv.7", "hardest_braking_for": "suv.8"}
    run = Run(write(tmp_path / "record", [{}] * 3, summary, settings=settings))
    assert drive_record.page_of(run).named >= {"child", "parked", "suv.7", "suv.8"}


def test_a_command_that_leaves_out_the_hold_at_rest_says_so() -> None:
    still = {"true_speed_mps": 0.0, "granted_acceleration_mps2": -1.0}
    assert "commanded while moving" in said(painted(page_of([*driving(50), *driving(50, **still)], [])))
    assert "commanded while moving" not in said(painted(page_of(driving(50), [])))


def test_nothing_ahead_is_not_struck_through_by_the_line_of_an_event() -> None:
    rows = [row | {"state": "stopping" if n > 90 else "engaged"} for n, row in enumerate(driving(TICKS))]
    gap = panel(painted(page_of(rows, [])), "gap")
    (none,) = (text for text in gap.texts if text.get_text() == "nothing ahead")
    assert not isinstance(none, Annotation)
    assert none.get_bbox_patch() is not None
    assert none.get_zorder() > max(line.get_zorder() for line in gap.lines)
