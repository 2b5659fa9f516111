"""The wires that lockstep opens know the virtual road's map: its places lead back to Earth."""

from __future__ import annotations

import socket
import tomllib
from pathlib import Path

import pyproj
import pytest

from tests.conftest import REPOSITORY
from tests.live.stage import free_ports
from tests.wire.test_outputs import sample
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.live.external_lockstep import open_link
from vve_sumo.rig.load import parse

pytest.importorskip("osi3", reason="needs the extra osi")


def test_a_view_of_lockstep_has_the_projection_and_the_offset_of_the_map() -> None:
    from osi3.osi_sensorview_pb2 import SensorView

    table = tomllib.loads((REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8"))
    resolved = resolve_by_name("parked_car", REPOSITORY)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(10.0)
        view = {"kind": "osi_view", "udp": f"127.0.0.1:{end.getsockname()[1]}"}
        (table["brain"]["port"],) = free_ports(1)
        table["outputs"].append(view)
        link = open_link(parse(table, Path("rig.toml")), resolved, b"")
        try:
            link.send(sample(0.0))
            truth = SensorView.FromString(end.recv(65_535)).global_ground_truth
        finally:
            link.close()
    x, y = (shift := truth.proj_frame_offset.position).x, shift.y
    assert resolved.map_frame.offset != (0.0, 0.0)
    longitude, latitude = pyproj.Proj(truth.proj_string)(100.0 + x, 200.0 + y, inverse=True, radians=True)
    assert (latitude, longitude) == pytest.approx(resolved.map_frame.to_geodetic(100.0, 200.0), abs=1e-12)
