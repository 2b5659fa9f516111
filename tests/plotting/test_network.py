"""The picture of a network holds every edge's name, in letters that can be read and searched, none over another."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import sumolib

from tests.conftest import REPOSITORY
from vve_sumo.cli import dispatch
from vve_sumo.geometry import overlap
from vve_sumo.plotting import network
from vve_sumo.world.network import Roads

STREET = REPOSITORY / "networks" / "signal_street.net.xml"


def drawn(file: Path) -> list[network.DrawnEdge]:
    return [
        network.DrawnEdge(edge.getID(), edge.getName(), shape, edge.getLaneNumber(), True)
        for edge, shape in Roads(file).shapes()
    ]


def test_every_edge_has_its_name_in_the_picture(tmp_path: Path, capsys) -> None:
    out = tmp_path / "street.svg"
    assert dispatch.main(["network", "picture", "signal_street", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    names = {edge.getID() for edge in sumolib.net.readNet(str(STREET)).getEdges()}
    texts = [re.sub(r"[←→]", "", text).strip() for text in re.findall(r">([^<>]*[←→][^<>]*)</text>", out.read_text())]
    assert set(texts) == names
    assert len(texts) == len(names)
    assert f"{len(names)} edges drawn" in said
    assert "no room" not in said


def test_names_stand_on_the_right_of_their_edges_and_on_no_other() -> None:
    edges = drawn(STREET)
    scale = network._scale(edges, 1660.0)
    labels, unnamed = network._labels(edges, scale)
    assert not unnamed
    boxes = [network._box(label, scale) for label in labels]
    assert not any(overlap(one, other) for i, one in enumerate(boxes) for other in boxes[:i])
    by_name = {edge.name: edge for edge in edges}
    for label in labels:
        edge = by_name[label.text.strip("←→ ")]
        (x, y), (end_x, end_y) = edge.shape[0], edge.shape[-1]
        # The cross product of driving direction and way to the name is negative on the right.
        assert (end_x - x) * (label.y - y) - (end_y - y) * (label.x - x) < 0.0
        assert -0.5 * math.pi - 1e-6 <= math.remainder(label.angle, math.tau) <= 0.5 * math.pi + 1e-6
        assert label.size >= network.SMALLEST


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["signal_street", "--out", "a.jpg"], ".png, .svg, .pdf"),
        (["signal_street", "--out", "no/a.png"], "expected an existing folder"),
        (["linden", "Nowhere Road", "--out", "a.png"], "has 'Nowhere Road' in its name"),
    ],
)
def test_what_cannot_be_drawn_is_refused(arguments: list[str], words: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert dispatch.main(["network", "picture", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_street_is_drawn_with_what_is_around_it() -> None:
    edges = drawn(REPOSITORY / "networks" / "linden.net.xml")
    part = network.around_street(edges, "kingry")
    assert 0 < len(part) < 0.2 * len(edges)
    assert any("Kingry" in edge.street for edge in part)
    assert network.around_street(edges, "nowhere") == []
