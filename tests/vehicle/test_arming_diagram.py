"""The picture says what the table says: read back from it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import pytest

from tests.conftest import REPOSITORY
from tests.vehicle.arming_diagram import svg
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import TRANSITIONS, ArmingEvent

SVG = {"": "http://www.w3.org/2000/svg"}
Box = tuple[float, float, float, float]  #: left, top, right, bottom


@pytest.fixture(scope="module")
def picture() -> ElementTree.Element:
    return ElementTree.fromstring((REPOSITORY / "docs/arming.svg").read_text(encoding="utf-8"))


def box_of(state: ElementTree.Element) -> Box:
    box = state.find("rect", SVG)
    assert box is not None
    x, y, width, height = (float(box.attrib[name]) for name in ("x", "y", "width", "height"))
    return x, y, x + width, y + height


def test_the_picture_is_that_of_the_table() -> None:
    """Which is what its arrows are drawn from, so they are read back below."""
    assert (REPOSITORY / "docs/arming.svg").read_text(encoding="utf-8") == svg(), "run python -m tests.test_docs"


def test_its_arrows_are_those_of_the_table(picture: ElementTree.Element) -> None:
    boxes = {ArmingState(group.attrib["id"]): box_of(group) for group in picture.iterfind("g[@id]", SVG)}
    found = set()
    for group in picture.iterfind("g", SVG):
        if (line := group.find("line", SVG)) is None:
            continue
        tail, head = (tuple(float(line.attrib[f"{axis}{end}"]) for axis in "xy") for end in (1, 2))
        before, after = (next(state for state, box in boxes.items() if on_edge(place, box)) for place in (tail, head))
        events = [label.text for label in group.iterfind("text/tspan", SVG)]
        assert group.findtext("title", "", SVG) == f"{before} to {after}: {', '.join(map(str, events))}"
        found |= {(before, ArmingEvent(str(event)), after) for event in events}
    assert found == {
        (state, event, after)
        for state, row in TRANSITIONS.items()
        for event, after in row.items()
        if after is not state
    }


def on_edge(place: tuple[float, ...], box: Box) -> bool:
    x, y = place
    left, top, right, bottom = box
    beside = min(abs(x - left), abs(x - right)), min(abs(y - top), abs(y - bottom))
    return left - 0.2 <= x <= right + 0.2 and top - 0.2 <= y <= bottom + 0.2 and min(beside) < 0.2


def test_the_page_shows_it_and_needs_nothing_else_to() -> None:
    assert "](arming.svg)" in (REPOSITORY / "docs/vehicle.md").read_text(encoding="utf-8")
    assert not re.search(r"https?:(?!//www\.w3\.org/2000/svg)", svg())
