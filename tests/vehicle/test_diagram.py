"""The diagram says what the table says: read back by its lines."""

from __future__ import annotations

import re

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import TRANSITIONS, ArmingEvent
from vve_sumo.vehicle.diagram import mermaid


def test_the_arrows_of_the_diagram_are_those_of_the_table():
    head, start, *lines = mermaid().splitlines()
    assert (head, start.split()) == ("stateDiagram-v2", ["[*]", "-->", "disarmed"])
    arrows = set()
    for line in lines:
        before, after, events = re.fullmatch(r"    (\w+) --> (\w+): (.+)", line).groups()
        assert before != after
        arrows |= {(ArmingState(before), ArmingEvent(event), ArmingState(after)) for event in events.split(", ")}
    pairs = {tuple(line.split(":")[0].split(" --> ")) for line in lines}
    assert len(pairs) == len(lines), "one arrow for each pair of states"
    assert arrows == {
        (state, event, after)
        for state, row in TRANSITIONS.items()
        for event, after in row.items()
        if after is not state
    }
