"""The picture of the control structure is drawn from the hazard analysis."""

from __future__ import annotations

from xml.etree import ElementTree

from tests.conftest import REPOSITORY
from tests.safety import control_structure
from vve_sumo.safety.hazard_trace import CAR, hazard_trace

FILE = REPOSITORY / "docs" / "safety" / "control_structure.svg"
SVG = "{http://www.w3.org/2000/svg}"


def test_the_picture_is_that_of_the_analysis() -> None:
    assert FILE.read_text(encoding="utf-8") == control_structure.svg(), "run python -m tests.test_docs"


def test_every_controller_has_a_box_of_its_own_and_every_link_an_arrow() -> None:
    root, trace = ElementTree.fromstring(control_structure.svg()), hazard_trace()
    boxes = {one.get("id"): one.find(f"{SVG}rect") for one in root.iter(f"{SVG}g") if one.get("id")}
    assert set(boxes) == {CAR, *(one.id for one in trace.controllers)}
    places = {(box.get("x"), box.get("y")) for box in boxes.values() if box is not None}
    assert len(places) == len(boxes)
    assert sum(1 for _line in root.iter(f"{SVG}line")) == len(trace.links)


def test_whoever_commands_is_heard_by_somebody() -> None:
    senders = {link.from_ for link in hazard_trace().links}
    assert {one.id for one in hazard_trace().controllers} <= senders
