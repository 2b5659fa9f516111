"""How real people are drawn on the page: the area, the warning and who is gone, against the record's own tables."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.drive.street import recorded
from tests.drive.test_people import anna, changes, walk_file
from tests.live.patience import until
from tests.view.conftest import serving
from tests.view.feed import sample
from tests.view.made import taken_apart
from tests.view.spaces import frame, straight
from tests.view.spaces import opened as opened_space
from tests.view.test_page import opened
from vve_sumo.analysis.run import Run
from vve_sumo.live.view_feed import mark_of
from vve_sumo.people.person import Person
from vve_sumo.people.presence import Presence
from vve_sumo.people.reports import PositionReport, decode
from vve_sumo.people.setup import PersonSetup
from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
from vve_sumo.view.declared_camera import CameraFile
from vve_sumo.view.frames import Frames
from vve_sumo.view.live_frame import LiveFrames
from vve_sumo.view.server import PageServer, replay_server

#: of 32-bit numbers in a map of a few kilometres [m]
EXACT = 5e-4
#: how often colours of the page's theme stand on the street's canvas, a pixel a count
COUNT = """(names) => { const canvas = document.querySelector('.street canvas');
  const style = getComputedStyle(document.documentElement);
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d', { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
  return names.map((name) => { const hex = style.getPropertyValue(`--${name}`).trim().slice(1);
    const [r, g, b] = [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16));
    let count = 0;
    for (let at = 0; at < data.length; at += 4) count += data[at] === r && data[at + 1] === g && data[at + 2] === b;
    return count; }); }"""
#: draw the frame that is shown with its people changed, and their bodies where they are
REDRAW = """(change) => { const view = vveSumo.shown.views[0];
  const people = view.frame.people.map((one) => ({ ...one, ...change }));
  const { id, x, y } = view.frame.actors, own = (at) => people.find((one) => one.id === id[at]);
  const moved = { x: x.map((value, at) => own(at)?.x ?? value), y: y.map((value, at) => own(at)?.y ?? value) };
  const actors = { ...view.frame.actors, ...moved };
  view.street.draw({ ...view.frame, actors, people }); return view.street.zoom; }"""


@pytest.fixture(scope="module")
def vague(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of a drive towards somebody whose phone says where they are every eight seconds alone."""
    above = tmp_path_factory.mktemp("vague")
    walk = walk_file(above, (0.0, 12.0, 0.0))
    person = anna(walk, simulated={"walk": walk, "accuracy_m": 4.0, "period_s": 8.0})
    return recorded(tmp_path_factory, changes(person, duration_s=25.0), above / "record")


@pytest.fixture(scope="module")
def people(vague: Path) -> dict[float, dict[str, Any]]:
    """The rows of the record's table of people by drive time, read without the program."""
    rows = pq.read_table(vague / "people.parquet").to_pylist()
    assert {row["presence"] for row in rows} == {"area", "warning", "gone"}
    return {round(row["time_s"], 6): row for row in rows}


@pytest.fixture(scope="module")
def page_server(vague: Path) -> Iterator[PageServer]:
    with serving(replay_server([vague])) as server:
        yield server


def test_every_tick_has_the_person_of_the_record(vague: Path, people: dict[float, dict[str, Any]]) -> None:
    head, columns = taken_apart(Frames(Run(vague)).packed())
    bodies = {row["tick"]: row for row in pq.read_table(vague / "actors.parquet").to_pylist() if row["actor"] == "anna"}
    ticks = pq.read_table(vague / "ticks.parquet").to_pydict()
    shown = 0
    for tick, time, (begin, end) in zip(
        ticks["tick"], ticks["time_s"], pairwise(columns["person_first"].tolist()), strict=True
    ):
        row = people.get(round(time, 6))
        assert end - begin == (row is not None)
        if row is None:
            continue
        shown += 1
        assert head["texts"]["person"][columns["person_code"][begin]] == "anna"
        assert head["texts"]["presence"][columns["person_presence"][begin]] == row["presence"]
        for name, column in (("x", "x_m"), ("y", "y_m"), ("radius", "radius_m"), ("age", "age_s")):
            assert columns[f"person_{name}"][begin] == pytest.approx(row[column], abs=EXACT, nan_ok=True)
        body = bodies.get(tick)
        for name in ("length", "width"):
            side = math.nan if body is None else body[f"{name}_m"]
            assert columns[f"person_{name}"][begin] == pytest.approx(side, abs=EXACT, nan_ok=True)
    assert shown > 400


def test_every_change_is_an_event(vague: Path, people: dict[float, dict[str, Any]]) -> None:
    before, wanted = "gone", []
    times = set(np.round(pq.read_table(vague / "ticks.parquet")["time_s"].to_numpy(), 6).tolist())
    for time in sorted(times & people.keys()):
        presence = people[time]["presence"]
        if presence != before:
            wanted.append((time, presence))
        before = presence
    events = [one for one in Frames(Run(vague)).scene["events"] if one["kind"] == "person"]
    assert [event["time"] for event in events] == pytest.approx([time for time, _ in wanted], abs=1e-3)
    for event, (_, presence) in zip(events, wanted, strict=True):
        assert event["text"].startswith("anna: ")
        assert ("warning" in event["text"]) == (presence == "warning")
        assert ("gone" in event["text"]) == (presence == "gone")


@pytest.mark.thorough
def test_the_page_draws_the_area_the_warning_and_nothing_of_who_is_gone(
    browser: Any, page_server: PageServer, people: dict[float, dict[str, Any]]
) -> None:
    """The circle's rim is as long as its radius says; a warning has the colour of alarms; who is gone is not there."""
    near = {
        name: [time for time, row in people.items() if row["presence"] == name and time > 1.0]
        for name in ("area", "warning")
    }
    unknown = [time for time, row in people.items() if math.isnan(row["x_m"]) and time > max(near["area"][0], 1.0)]
    with opened(browser, page_server.address) as page:
        page.evaluate("() => { vveSumo.shown.views[0].street.northUp = true; }")
        until(lambda: bool(page.evaluate("vveSumo.shown.records[0].frames.details !== null")))
        for name, colour in (("area", "person"), ("warning", "false")):
            time = near[name][len(near[name]) // 2]
            page.evaluate("(time) => vveSumo.shown.seek(time)", time)
            frame = page.evaluate("vveSumo.shown.views[0].frame")
            assert [(one["id"], one["presence"]) for one in frame["people"]] == [("anna", name)]
            assert frame["people"][0]["radius"] == pytest.approx(people[round(frame["t"], 6)]["radius_m"], abs=EXACT)
            counts = {}
            for radius in (0.01, 5.0, 10.0):
                # Everybody is brought beside the ego, so that the whole circle is in sight.
                at = {"x": frame["ego"]["x"] + 1.0, "y": frame["ego"]["y"] + 0.5, "radius": radius}
                zoom = page.evaluate(REDRAW, at)
                counts[radius] = page.evaluate(COUNT, [colour])[0]
            # A line is as wide as 2.5 pixels, of which the outer ones may be mixed with what is below.
            for small, large in ((0.01, 5.0), (5.0, 10.0)):
                grown = (counts[large] - counts[small]) / (2.0 * math.pi * (large - small) * zoom)
                assert 0.5 < grown < 3.5, (name, small, large, counts, zoom)
        page.evaluate("(time) => vveSumo.shown.seek(time)", unknown[0])
        assert page.evaluate("vveSumo.shown.views[0].frame.people[0].x") is None
        assert page.evaluate(COUNT, ["person"]) == [0]
        assert page.locator(".events .kind-person").count() >= 3
        assert "holds the person" in page.locator(".legend").inner_text()


@pytest.mark.thorough
def test_an_area_is_not_drawn_as_a_solid_body(
    browser: Any, page_server: PageServer, people: dict[float, dict[str, Any]]
) -> None:
    area = next(time for time, row in people.items() if row["presence"] == "area" and time > 1.0)
    with opened(browser, page_server.address) as page:
        page.evaluate("(time) => vveSumo.shown.seek(time)", area + 0.5)
        until(lambda: bool(page.evaluate("vveSumo.shown.records[0].frames.details !== null")))
        ego = page.evaluate("vveSumo.shown.views[0].frame.ego")
        near = {"x": ego["x"] + 8.0 * math.cos(ego["heading"]), "y": ego["y"] + 8.0 * math.sin(ego["heading"])}
        colours = ["seen", "outside", "missed", "occluded"]
        page.evaluate(REDRAW, near)
        as_area = sum(page.evaluate(COUNT, colours))
        page.evaluate(REDRAW, near | {"presence": "exact"})
        # As a body it has the size with which it entered: a filled box.
        assert sum(page.evaluate(COUNT, colours)) > 2 * as_area


def test_a_live_frame_has_people_and_their_changes(vague: Path) -> None:
    resolved = json.loads((vague / "scenario.json").read_text(encoding="utf-8"))
    person = Person(PersonSetup.from_dict(resolved["people"][0]))
    rows = {
        round(row["received_s"], 6): row["datagram"]
        for row in pq.read_table(vague / "people_reports.parquet").to_pylist()
    }
    frames = LiveFrames(resolved, lambda status: str(status["state"]))
    events, presences = [], []
    waiting = sorted(rows.items())
    for tick in range(800):
        now = 0.02 * tick
        while waiting and waiting[0][0] <= now:
            received, datagram = waiting.pop(0)
            report = decode(datagram)
            assert isinstance(report, PositionReport)
            person.receive(received, report)
        state = person.step(now)
        presences.append(state.presence)
        events += frames.take(replace(sample(tick), people=(mark_of(state),)))
        frame = frames.frame()
        assert frame is not None
        json.dumps(frame, allow_nan=False)
        (shown,) = frame["people"]
        assert (shown["id"], shown["presence"]) == ("anna", state.presence.name.lower())
        if state.body is None:
            assert shown["length"] is None
        else:
            assert shown["length"] == pytest.approx(state.body.length, abs=1e-3)
            assert (shown["x"], shown["y"]) == pytest.approx((state.x, state.y), abs=1e-3)
            assert shown["radius"] == pytest.approx(state.radius, abs=1e-3)
    changes_seen = [two for one, two in pairwise([Presence.GONE, *presences]) if one != two]
    assert set(changes_seen) == {Presence.AREA, Presence.WARNING, Presence.GONE}
    assert len([event for event in events if event["kind"] == "person"]) == len(changes_seen)


@pytest.mark.thorough
def test_the_circle_lies_on_the_ground_in_three_dimensions_but_not_in_a_cameras_pictures() -> None:
    person = {"id": "anna", "presence": "area", "x": 12.0, "y": 0.0, "radius": 3.0}
    nobody = person | {"x": None, "y": None, "radius": None}
    with opened_space() as space:
        space.make(straight(), "above")
        pictures = [space.picture(frame(people=people)).astype(int) for people in ([], [person], [nobody])]
        changed = np.abs(pictures[1] - pictures[0]).max(axis=2) > 40
        rows, columns = np.nonzero(changed)
        assert changed.sum() > 100
        # A circle from above: about as wide as high.
        assert np.ptp(columns) == pytest.approx(np.ptp(rows), rel=0.35)
        green = pictures[1][changed][:, 1].astype(float) - pictures[1][changed][:, 0]
        assert np.median(green) > 40
        assert np.array_equal(pictures[0], pictures[2])
    camera = CameraFile(columns_px=320, rows_px=200, focal_x_px=300.0).camera("front")
    with CameraPictures.of_scene(straight(), camera, SceneAppearance(dressed=False)) as drawn:
        assert drawn.drawn(frame(people=[])) == drawn.drawn(frame(people=[person]))
