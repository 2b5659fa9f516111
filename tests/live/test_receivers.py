"""Live drives by every kind of receiver that the simulated vehicle speaks as, over the wire of each."""

from __future__ import annotations

import csv
import json
import socket
from pathlib import Path

import pytest
import shapely

from tests.commissioning.test_doctor import reported
from tests.exhaustive import with_slow
from tests.live.command_line import SIMULATED, free_port, own_rig, vve_sumo
from vve_sumo.rig import load as rigs

SIGMAS = "velocity_sigma_mps = 0.03\nheading_sigma_deg = 0.1\n"
#: keys of each kind beside those of every kind; PORT and FOLDER are the test's
KINDS = {
    "nmea_udp": f"port = PORT\n{SIGMAS}",
    "nmea_tcp": f"port = PORT\n{SIGMAS}",
    "nmea_serial": f'device = "pty:FOLDER/gnss.pty"\n{SIGMAS}',
    "oxts_can": 'interface = "slcan"\nchannel = "pty:FOLDER/oxts.pty"\n',
    "ubx_serial": 'device = "pty:FOLDER/gnss.pty"\n',
    "sbf_tcp": "port = PORT\n",
    "novatel_udp": "port = PORT\n",
}

#: messages of an epoch as the simulated vehicle sends them
ORDERS = {
    "nmea_tcp": "GGA RMC VTG HDT GST",
    "ubx_serial": "NAV-PVT NAV-RELPOSNED",
    "sbf_tcp": "PVTGeodetic PosCovGeodetic VelCovGeodetic AttEuler AttCovEuler",
}

#: one of NMEA's three wires, and the one that is a CAN bus
USUAL = ("nmea_serial", "oxts_can")


def rig_of(kind: str, folder: Path, port: int) -> Path:
    """The simulated vehicle's rig with another receiver."""
    begin, end = SIMULATED.index("[pose]"), SIMULATED.index("[mounting]")
    own = KINDS[kind].replace("PORT", str(port)).replace("FOLDER", str(folder))
    pose = f'[pose]\nkind = "{kind}"\nrate_hz = 100.0\nminimum_delay_ms = 10.0\n{own}\n'
    file = own_rig(folder)
    file.write_text(SIMULATED[:begin] + pose + SIMULATED[end:], encoding="utf-8")
    return file


def short(folder: Path) -> Path:
    """A drive of 12 s, which begins at once and has nothing in the way."""
    text = """
title = "A short drive"
duration_s = 12.0
[road]
network = "proving_ground"
[ego]
path = "proving_ground"
speed_mps = 6.0
[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0
"""
    file = folder / "short.toml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.thorough
@pytest.mark.live
@pytest.mark.parametrize("kind", with_slow([*KINDS], USUAL.__contains__))
def test_a_drive_by_its_bytes_over_its_wire(kind: str, tmp_path: Path) -> None:
    rig, record = rig_of(kind, tmp_path, free_port()), tmp_path / "record"
    done = vve_sumo("drive", str(short(tmp_path)), "--rig", str(rig), "--out", str(record), cwd=tmp_path)
    assert (record / "summary.json").exists(), done.stdout + done.stderr
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["reasons"] == []
    assert summary["outcome"] == "timeout"
    # By the truth, which the car wrote itself: it went along the path, and straight.
    with (record / "truth.csv").open(encoding="utf-8") as file:
        truth = [(float(row["x_m"]), float(row["y_m"])) for row in csv.DictReader(file)]
    line = shapely.LineString([truth[0], truth[-1]])
    assert line.length > 25.0
    assert max(line.distance(shapely.Point(place)) for place in truth) < 0.5
    assert not list(tmp_path.glob("*.pty")), "the link is gone with the car"


@pytest.mark.thorough
@pytest.mark.live
@pytest.mark.parametrize("kind", with_slow(["nmea_tcp", "oxts_can", "ubx_serial", "sbf_tcp"], USUAL.__contains__))
def test_the_doctor_finds_it_fit(kind: str, tmp_path: Path) -> None:
    """An OXTS unit on CAN is believed to be locking for its first 12 s, which the doctor waits for."""
    run = vve_sumo("doctor", str(short(tmp_path)), "--rig", str(rig_of(kind, tmp_path, free_port())), cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert reported(run, "receiver")[1].startswith(kind)
    assert reported(run, "fix")[1].startswith("locked, RTK fixed")
    assert float(reported(run, "fixes")[1].split()[0]) == pytest.approx(100.0, rel=0.1)
    if kind in ORDERS:
        assert reported(run, "messages")[1].split("; ")[1] == f"in the order {ORDERS[kind]}"
    assert float(reported(run, "reports")[1].split("brake ")[1].split(",")[0]) == pytest.approx(50.0, rel=0.1)


@pytest.mark.thorough
@pytest.mark.live
def test_a_port_that_another_program_serves_is_refused_and_nothing_is_read_from_it(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        rig = rig_of("nmea_tcp", tmp_path, other.getsockname()[1])
        assert rigs.load(rig).pose.kind == "nmea_tcp"
        run = vve_sumo("doctor", str(short(tmp_path)), "--rig", str(rig), cwd=tmp_path)
        other.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            other.accept()
    assert run.returncode == 3
    assert "is in use by another program" in reported(run, "bus")[1]
