"""The intersections that are read of a network are those that sumolib reads."""

from __future__ import annotations

from pathlib import Path

import pytest
import sumolib

from vve_sumo.errors import ConfigError
from vve_sumo.world.intersections import intersections


def test_links_and_lanes_are_sumolibs(linden: Path, reference: sumolib.net.Net) -> None:
    found = {one.signal: one for one in intersections(linden)}
    assert list(found) == sorted(signal.getID() for signal in reference.getTrafficLights())
    for signal in reference.getTrafficLights():
        one = found[signal.getID()]
        links = sorted((index, start.getID(), end.getID()) for start, end, index in signal.getConnections())
        assert sorted((link.index, link.incoming, link.outgoing) for link in one.links) == links
        for lane in (*one.incoming, *one.outgoing):
            known = reference.getLane(lane.id)
            assert lane.points == tuple(point[:2] for point in known.getShape())
            assert (lane.edge, lane.width) == (known.getEdge().getID(), pytest.approx(known.getWidth()))
            assert (lane.use == "vehicle") is known.allows("passenger")
        directions = {
            (link.getFromLane().getID(), link.getToLane().getID()): link.getDirection()
            for lane in one.incoming
            for link in reference.getLane(lane.id).getOutgoing()
        }
        assert all(directions[link.incoming, link.outgoing] == link.direction for link in one.links)


@pytest.mark.parametrize("name", ["proving_ground", "test_track"])
def test_a_network_without_signals_has_none(repository: Path, name: str) -> None:
    assert intersections(repository / "networks" / f"{name}.net.xml") == ()


def test_a_file_that_is_no_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        intersections(tmp_path / "none.net.xml")
