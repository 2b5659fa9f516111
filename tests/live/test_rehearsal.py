"""A real car's rig on simulated wires: what the file says reaches the simulated car, and no hardware is there."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Final

import pyproj
import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import free_port
from tests.live.terminal import desk
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.errors import ConfigError
from vve_sumo.live import start_simulated_vehicle
from vve_sumo.live.rehearsal import Rehearsal, rehearsed
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning

TEMPLATE = (REPOSITORY / "rigs" / "fusion_example.toml").read_text(encoding="utf-8")
SURVEYED = ("# surveyed = 2026-05-01", "surveyed = 2026-05-01")
#: `[pose]` of each kind with a real wire
RECEIVERS = {
    "ncom_udp": 'address = "0.0.0.0"\nsource = "192.168.25.44"\nport = PORT\n',
    "nmea_udp": 'address = "0.0.0.0"\nsource = "192.168.25.44"\nport = PORT\nSIGMAS',
    "nmea_tcp": 'address = "192.168.25.44"\nport = PORT\nSIGMAS',
    "nmea_serial": 'device = "/dev/ttyUSB0"\nSIGMAS',
    "oxts_can": 'interface = "socketcan"\nchannel = "can1"\n',
}
SIGMAS = "velocity_sigma_mps = 0.03\nheading_sigma_deg = 0.1\n"


#: where the path begins in the lot: metres east and north of its first corner, driving east
STANDS: Final = (60.0, 100.0)
SCENARIO: Final = "small_lot_parked_car"
MATCHED: Final = '[alignment]\nkind = "matched_start"\n'


def stored() -> tuple[str, str]:
    """The change of the template to an alignment that has the path's start at STANDS, by arithmetic of its own."""
    begin = resolve_by_name(SCENARIO, REPOSITORY).path.at(0.0)
    cosine, sine = math.cos(begin.heading), math.sin(begin.heading)
    x = begin.x - cosine * STANDS[0] + sine * STANDS[1]
    y = begin.y - sine * STANDS[0] - cosine * STANDS[1]
    lines = ['kind = "stored"', 'network = "linden"', "date = 2026-05-01", "origin = [40.0030, -83.0200]"]
    lines += [f"rotation_deg = {math.degrees(begin.heading)!r}", f"x_m = {x!r}", f"y_m = {y!r}", "residual_m = 0.0"]
    return MATCHED, "[alignment]\n" + "\n".join(lines) + "\n"


def real_rig(folder: Path, *changes: tuple[str, str], kind: str = "ncom_udp") -> Path:
    """The shipped template of a real car, surveyed and aligned, with passages changed."""
    text = TEMPLATE
    for old, new in (SURVEYED, *changes, stored()):
        assert old in text, old
        text = text.replace(old, new)
    own = RECEIVERS[kind].replace("SIGMAS", SIGMAS).replace("PORT", str(free_port()))
    begin, end = text.index("[pose]"), text.index("[mounting]")
    pose = f'[pose]\nkind = "{kind}"\nrate_hz = 100.0\nminimum_delay_ms = 3.0\n{own}\n'
    file = folder / "real.toml"
    file.write_text(text[:begin] + pose + text[end:], encoding="utf-8")
    return file


def on_simulated_wires(folder: Path, *changes: tuple[str, str], kind: str = "ncom_udp") -> Rehearsal:
    file = real_rig(folder, *changes, kind=kind)
    resolved = resolve_by_name(SCENARIO, REPOSITORY)
    return rehearsed(rigs.load(file), file, resolved, folder)


def car_of(found: Rehearsal):
    """What the simulated vehicle's process is told."""
    return start_simulated_vehicle._config(found.rig, 0.0, 1, None, 0.9)


def test_no_wire_is_a_real_one(tmp_path: Path) -> None:
    for kind in RECEIVERS:
        rig = on_simulated_wires(tmp_path, kind=kind).rig
        assert (rig.car, rig.bus.interface, rig.bus.channel) == ("simulated", "slcan", "pty")
        assert rig.pose.kind == kind
        assert meaning.receiver_of(rig).not_simulated() == ""
        wire = json.dumps(car_of(Rehearsal(rig, ())).to_dict())
        for real in ("can0", "can1", "socketcan", "ttyUSB", "192.168", "0.0.0.0"):
            assert real not in wire, (kind, real)


def test_the_twin_shows_every_change_of_the_file(tmp_path: Path) -> None:
    usual = on_simulated_wires(tmp_path)
    changed = on_simulated_wires(
        tmp_path,
        ("# mass_kg = 1690.0", "mass_kg = 2100.0\nwheelbase_m = 3.1"),
        ("forward_m = 0.0", "forward_m = 1.25"),
        ("left_m = 0.0", "left_m = -0.4"),
        ("heading_misalignment_deg = 0.0", "heading_misalignment_deg = 0.7"),
        ("# steering_wheel_bias_deg = 0.0", "steering_wheel_bias_deg = 3.0"),
        ("# brake_gain_kgm = 550.0", "brake_gain_kgm = 601.0"),
        ("margin_m = 2.0", "margin_m = 3.0"),
        kind="nmea_serial",
    )
    one, other = car_of(usual).parameters, car_of(changed).parameters
    assert (other.vehicle.mass, other.vehicle.wheelbase) == (2100.0, 3.1)
    assert one.vehicle.mass != 2100.0
    assert one.vehicle.wheelbase != 3.1
    assert (other.receiver.mounting.forward, other.receiver.mounting.left) == (1.25, -0.4)
    assert car_of(changed).receiver["kind"] == "nmea_serial"
    assert car_of(usual).receiver["kind"] == "ncom_udp"
    start = changed.rig.car_start
    assert (start.steering_wheel_bias_deg, start.heading_misalignment_deg) == (3.0, 0.7)
    assert start.gnss_delay_s == 0.003
    assert meaning.calibration_of(changed.rig).brake_gain == 601.0
    assert changed.rig.lot.margin_m == 3.0


def test_lot_limits_and_geofence_are_those_of_the_file(tmp_path: Path) -> None:
    file = real_rig(tmp_path)
    real = rigs.load(file)
    twin = on_simulated_wires(tmp_path).rig
    assert twin.lot == real.lot
    assert meaning.limits_of(twin) == meaning.limits_of(real)
    assert meaning.mounting_of(twin) == meaning.mounting_of(real)
    assert meaning.vehicle_of(twin) == meaning.vehicle_of(real)
    assert meaning.frame_of(twin).projection == meaning.frame_of(real).projection


def test_it_stands_where_the_stored_alignment_has_the_start(tmp_path: Path) -> None:
    start = on_simulated_wires(tmp_path).rig.car_start
    flat = pyproj.Proj("+proj=aeqd +lat_0=40.0030 +lon_0=-83.0200 +datum=WGS84")
    assert flat(start.longitude_deg, start.latitude_deg) == pytest.approx(STANDS, abs=0.01)
    assert start.heading_deg == pytest.approx(90.0, abs=0.01)


@pytest.mark.thorough
def test_without_an_alignment_it_stands_where_a_search_lays_the_path(tmp_path: Path) -> None:
    file = real_rig(tmp_path)
    file.write_text(file.read_text(encoding="utf-8").replace(stored()[1], MATCHED), encoding="utf-8")
    resolved = resolve_by_name(SCENARIO, REPOSITORY)
    found = rehearsed(rigs.load(file), file, resolved, tmp_path).rig  # which refuses a car outside its lot
    assert found.alignment.kind == "matched_start"
    start = found.car_start
    flat = pyproj.Proj("+proj=aeqd +lat_0=40.0030 +lon_0=-83.0200 +datum=WGS84")
    x, y = flat(start.longitude_deg, start.latitude_deg)
    # A path of 75 m in the middle of a lot of 340 m x 222 m is far from every edge.
    assert 40.0 < x < 300.0
    assert 40.0 < y < 182.0


def test_an_external_controller_is_not_rehearsed(tmp_path: Path) -> None:
    brain = '[brain]\nkind = "external"\n[[outputs]]\nkind = "ncom"\nudp = "127.0.0.1:5001"\n\n[alignment]'
    with pytest.raises(ConfigError, match=r"brain\.kind of .* is 'external'"):
        on_simulated_wires(tmp_path, ("[alignment]", brain))


def test_a_simulated_rig_is_not_rehearsed() -> None:
    file = REPOSITORY / "rigs" / "simulated.toml"
    with pytest.raises(ConfigError, match="is simulated already"):
        rehearsed(rigs.load(file), file, resolve_by_name(SCENARIO, REPOSITORY), Path())


def test_a_recorded_receiver_is_not_rehearsed(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(RECEIVERS, "file", 'file = "drive.ncom"\n')
    with pytest.raises(ConfigError, match=r"real\.toml"):
        on_simulated_wires(tmp_path, kind="file")


def test_outputs_are_left_out_and_said(tmp_path: Path) -> None:
    output = '[[outputs]]\nkind = "esr"\ninterface = "socketcan"\nchannel = "can3"\n\n[alignment]'
    found = on_simulated_wires(tmp_path, ("[alignment]", output))
    assert found.rig.outputs == ()
    assert "left out of the rig: outputs" in found.notes[-1]
    assert re.search(r"bus socketcan:can0 is emulated", found.notes[0])


@pytest.mark.thorough
@pytest.mark.live
def test_the_rig_of_a_real_car_is_driven_by_keys_on_simulated_wires(tmp_path: Path) -> None:
    """An NMEA receiver on a serial line, a bus that is a card: neither is there, and the car stops before the other."""
    file, record = real_rig(tmp_path, ("speed_mps = 8.0", "speed_mps = 9.0"), kind="nmea_serial"), tmp_path / "record"
    arguments = (SCENARIO, "--rig", str(file), "--rehearse")
    with desk(*arguments, record=record, program=("-m", "vve_sumo.cli", "drive")) as at:
        at.shows("READY: E ENGAGES")
        assert "no hardware is opened" in at.text
        at.press("e")
        at.shows("ENGAGED AND HELD: G GOES")
        at.press("g")
        assert at.ends(120.0) == 0, at.text[-3000:]
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["rehearsal"] is True
    assert summary["outcome"] == "stopped"
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    recorded = json.loads((record / "scenario.json").read_text(encoding="utf-8"))["rig"]
    assert (recorded["car"], recorded["bus"]["channel"]) == ("simulated", "pty")
    assert recorded["pose"]["device"].startswith("pty:")
