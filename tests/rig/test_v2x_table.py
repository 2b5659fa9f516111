"""The table of a real on-board unit: what makes sense is taken, each contradiction is one line that names its key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.complaints import complaint_of
from tests.rig.test_brain_tables import RADAR, foreign
from vve_sumo.rig.load import parse

UNIT = {"listen": "127.0.0.1:4716"}


@pytest.mark.parametrize(
    "table",
    [
        UNIT,
        UNIT | {"frame": "road", "ignored": [1, 4_294_967_295], "reach_m": 200.0, "stations": 5, "uncertainty_m": 2.0},
        {"listen": "192.168.1.2:4716", "sender": "192.168.1.9"},
    ],
)
def test_what_makes_sense_is_taken(table: dict[str, Any]) -> None:
    assert parse(foreign(v2x=table), Path("rig.toml")).v2x is not None


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ({}, "key 'v2x.listen' is missing"),
        ({"listen": "192.168.1.2:4716"}, "v2x: sender is missing: anyone who reaches 192.168.1.2 could put bodies"),
        ({"listen": "0.0.0.0:4716", "sender": "192.168.1.9"}, "v2x.listen: 0.0.0.0 is everyone's"),
        ({"listen": "127.0.0.1"}, "v2x.listen: expected an IPv4 address and a port"),
        (UNIT | {"frame": "map"}, "v2x.frame: expected 'lot' or 'road'"),
        (UNIT | {"ignored": [-1]}, "v2x.ignored.0"),
        (UNIT | {"stations": 0}, "v2x.stations"),
        (UNIT | {"reach_m": float("nan")}, "v2x.reach_m"),
        (UNIT | {"reach": 3.0}, "unknown key 'v2x.reach'"),
    ],
)
def test_what_does_not_is_one_line(table: dict[str, Any], line: str) -> None:
    complaint = complaint_of(parse, foreign(v2x=table))
    assert line in complaint
    assert "\n" not in complaint


def test_an_own_wire_does_not_go_where_the_unit_is_heard() -> None:
    """The ego's own CAM would put a body onto the ego."""
    outputs = [RADAR, {"kind": "cam", "udp": "127.0.0.1:4716"}]
    complaint = complaint_of(parse, foreign(v2x=UNIT, outputs=outputs))
    assert "outputs.1.udp: 127.0.0.1:4716 is where v2x listens" in complaint
