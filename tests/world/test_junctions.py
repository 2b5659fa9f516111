"""Who gives way to whom is what sumolib reads; where ways lie is where SUMO's lanes lie."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
import sumolib

from vve_sumo.errors import ConfigError
from vve_sumo.junctions import Control, Junction, JunctionWay
from vve_sumo.world.junctions import junctions

ALL = (-1e6, -1e6, 1e6, 1e6)


@pytest.fixture(scope="module")
def side_streets(repository: Path) -> dict[str, Junction]:
    return {one.id: one for one in junctions(repository / "networks" / "side_streets.net.xml", ALL)}


def way(junction: Junction, start: str, end: str) -> JunctionWay:
    return next(one for one in junction.ways if (one.incoming, one.outgoing) == (f"{start}_0", f"{end}_0"))


def test_without_a_signal_who_goes_first_is_what_sumolib_reads(linden: Path, reference: sumolib.net.Net) -> None:
    found, compared = {one.id: one for one in junctions(linden, ALL)}, 0
    for node in reference.getNodes()[::12]:  # sumolib looks up an index by a search
        if node.getType() not in ("priority", "priority_stop", "right_before_left"):
            continue
        by_lanes = {
            (link.getFromLane().getID(), link.getToLane().getID()): link
            for link in node.getConnections()
            if link.getFromLane().allows("passenger")
        }
        expected = {
            (own, prior)
            for own, one in by_lanes.items()
            for prior, other in by_lanes.items()
            if one is not other and node.forbids(other, one)
        }
        if not expected:
            assert node.getID() not in found
            continue
        ways = found[node.getID()].ways
        lanes = [(one.incoming, one.outgoing) for one in ways]
        assert {(lanes[row], lanes[prior]) for row, one in enumerate(ways) for prior in one.prior} == expected
        compared += 1
    assert compared > 20


def test_ways_are_lines_of_sumos_length_that_meet_the_lanes(linden: Path, reference: sumolib.net.Net) -> None:
    for one in junctions(linden, ALL)[::40]:
        for own in one.ways:
            lengths = [math.hypot(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(own.points)]
            along = [sum(lengths[:row]) for row in range(len(own.points))]
            begin = reference.getLane(own.incoming).getShape()[-1][:2]
            end = reference.getLane(own.outgoing).getShape()[0][:2]
            for place, s in ((begin, own.line), (end, own.exit)):
                row = min(range(len(along)), key=lambda at: abs(along[at] - s))
                assert along[row] == pytest.approx(s, abs=1e-6)
                assert math.dist(own.points[row], place) < 0.02
            assert own.line <= 200.001


def test_a_stop_sign_a_minor_road_and_a_left_turn_are_told_apart(side_streets: dict[str, Junction]) -> None:
    stop = way(side_streets["stop"], "stop_south_to_stop", "stop_to_stop_north")
    minor = way(side_streets["minor"], "minor_south_to_minor", "minor_to_signal")
    along = way(side_streets["stop"], "west_to_stop", "stop_to_signal")
    left = way(side_streets["stop"], "west_to_stop", "stop_to_stop_north")
    assert [one.control for one in (stop, minor, along, left)] == [
        Control.STOP,
        Control.YIELD,
        Control.NONE,
        Control.YIELD,
    ]
    assert stop.ends  # the side street begins nowhere
    assert stop.speed_limit == pytest.approx(11.18, abs=0.01)
    assert left.speed_across < along.speed_across == pytest.approx(11.18, abs=0.01)


def test_at_green_a_left_turn_gives_way_to_oncoming_traffic_alone(side_streets: dict[str, Junction]) -> None:
    signal = side_streets["signal"]
    left = way(signal, "stop_to_signal", "signal_to_signal_north")
    first = {(signal.ways[row].incoming, signal.ways[row].outgoing) for row in left.prior}
    assert left.control is Control.SIGNAL
    assert first == {
        ("minor_to_signal_0", "signal_to_stop_0"),
        ("minor_to_signal_0", "signal_to_signal_north_0"),
    }
    assert way(signal, "stop_to_signal", "signal_to_minor").prior == ()


def test_only_junctions_within_the_box_are_read(repository: Path, side_streets: dict[str, Junction]) -> None:
    found = junctions(repository / "networks" / "side_streets.net.xml", (200.0, 100.0, 240.0, 200.0))
    assert found == (side_streets["stop"],)


def test_a_file_that_is_no_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        junctions(tmp_path / "none.net.xml", ALL)
