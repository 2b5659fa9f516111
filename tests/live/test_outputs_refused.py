"""A live drive whose outgoing wire cannot be opened: one line, and no record."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from tests.live.command_line import own_rig, vve_sumo


@pytest.mark.live
def test_a_wire_that_cannot_be_opened_is_one_line_and_leaves_no_record(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        rig = own_rig(tmp_path)
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        with rig.open("a", encoding="utf-8") as table:
            table.write(f'\n[[outputs]]\nkind = "nmea"\ntcp = "{place}"\n')
        done = vve_sumo("drive", "parked_car", "--rig", str(rig), "--out", "record", cwd=tmp_path)
    assert done.returncode == 3
    assert done.stderr.strip().splitlines()[-1] == (f"vve-sumo: outputs.0: tcp {place}: is in use by another program")
    assert not (tmp_path / "record").exists()
