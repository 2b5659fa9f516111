"""A real car's rig on simulated wires: what the file says reaches the simulated car, and no hardware is there."""

from __future__ import annotations

import contextlib
import json
import math
import re
import select
import time
from functools import cache
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
import pyproj
import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import free_port
from tests.live.terminal import desk
from vve_sumo.bus import Bus
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.errors import ConfigError
from vve_sumo.live import start_simulated_vehicle
from vve_sumo.live.pty_bus import LinkedAdapter
from vve_sumo.live.rehearsal import Rehearsal, rehearsed
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.receivers.oxts_can import FRAME
from vve_sumo.pose.receivers.port import PORT, configured, load
from vve_sumo.pose.trust import TrustGate
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.values import Fix, FixQuality

TEMPLATE = (REPOSITORY / "rigs" / "fusion_example.toml").read_text(encoding="utf-8")
SURVEYED = ("# surveyed = 2026-05-01", "surveyed = 2026-05-01")
#: keys of `[pose]` by which a receiver is on a real wire; what else a kind requires is a number
REAL_WIRE: Final = {
    "source": '"192.168.25.44"',
    "device": '"/dev/ttyUSB0"',
    "interface": '"socketcan"',
    "channel": '"can1"',
    "file": '"drive.ncom"',
}
#: one that a user wrote
TOY: Final = f"{REPOSITORY / 'tests' / 'ports' / 'toy' / 'csv_udp.py'}:make"
LIVE_KINDS: Final = [kind for kind in (*PORT.shipped, TOY) if load(kind).profile.live]
#: of kinds that differ by their wire alone, one
OF_EACH_CODEC: Final = [*{load(kind).decoder.__qualname__: kind for kind in LIVE_KINDS}.values()]


@cache
def resolved() -> ResolvedScenario:
    return resolve_by_name(SCENARIO, REPOSITORY)


def keys_of(kind: str) -> str:
    """What a rig says of a receiver of this kind on a real wire, by the keys that the kind has."""
    fields = load(kind).model_fields
    said = {key: text for key, text in REAL_WIRE.items() if key in fields}
    if "address" in fields:
        said["address"] = '"0.0.0.0"' if "source" in fields else '"192.168.25.44"'
    if "port" in fields:
        said["port"] = str(free_port())
    open_ones = [key for key, field in fields.items() if field.is_required() and key not in {*said, "kind"}]
    return "".join(f"{key} = {text}\n" for key, text in (said | dict.fromkeys(open_ones, "0.1")).items())


#: where the path begins in the lot: metres east and north of its first corner, driving east
STANDS: Final = (60.0, 100.0)
SCENARIO: Final = "small_lot_parked_car"
MATCHED: Final = '[alignment]\nkind = "matched_start"\n'


def stored() -> tuple[str, str]:
    """The change of the template to an alignment that has the path's start at STANDS, by arithmetic of its own."""
    begin = resolved().path.at(0.0)
    cosine, sine = math.cos(begin.heading), math.sin(begin.heading)
    x = begin.x - cosine * STANDS[0] + sine * STANDS[1]
    y = begin.y - sine * STANDS[0] - cosine * STANDS[1]
    lines = ['kind = "stored"', 'network = "linden"', "date = 2026-05-01", "origin = [40.0030, -83.0200]"]
    lines += [f"rotation_deg = {math.degrees(begin.heading)!r}", f"x_m = {x!r}", f"y_m = {y!r}", "residual_m = 0.0"]
    return MATCHED, "[alignment]\n" + "\n".join(lines) + "\n"


def real_rig(folder: Path, *changes: tuple[str, str], kind: str = "ncom_udp", rate: float = 100.0) -> Path:
    """The shipped template of a real car, surveyed and aligned, with passages changed."""
    text = TEMPLATE
    for old, new in (SURVEYED, *changes, stored()):
        assert old in text, old
        text = text.replace(old, new)
    begin, end = text.index("[pose]"), text.index("[mounting]")
    pose = f'[pose]\nkind = "{kind}"\nrate_hz = {rate}\nminimum_delay_ms = 3.0\n{keys_of(kind)}\n'
    file = folder / "real.toml"
    file.write_text(text[:begin] + pose + text[end:], encoding="utf-8")
    return file


def on_simulated_wires(
    folder: Path, *changes: tuple[str, str], kind: str = "ncom_udp", rate: float = 100.0
) -> Rehearsal:
    file = real_rig(folder, *changes, kind=kind, rate=rate)
    return rehearsed(rigs.load(file), file, resolved(), folder)


def car_of(found: Rehearsal):
    """What the simulated vehicle's process is told."""
    return start_simulated_vehicle._config(found.rig, 0.0, 1, None, 0.9)


@pytest.mark.parametrize("kind", LIVE_KINDS, ids=lambda kind: Path(kind).name)
def test_no_wire_is_a_real_one(kind: str, tmp_path: Path) -> None:
    rig = on_simulated_wires(tmp_path, kind=kind).rig
    assert (rig.car, rig.bus.interface, rig.bus.channel) == ("simulated", "slcan", "pty")
    assert rig.pose.kind == kind
    assert meaning.receiver_of(rig).not_simulated() == ""
    wire = json.dumps(car_of(Rehearsal(rig, ())).to_dict())
    for real in ("can0", "can1", "socketcan", "ttyUSB", "192.168", "0.0.0.0"):
        assert real not in wire, real


@pytest.mark.parametrize(("kind", "rate"), [*product(OF_EACH_CODEC, [10.0]), ("sbf_tcp", 20.0), ("ncom_udp", 100.0)])
def test_its_fixes_are_trusted_and_come_as_often_as_the_rig_says(kind: str, rate: float, tmp_path: Path) -> None:
    """Of the car that the rehearsal starts, without a clock: its bytes by the kind's decoder and trust gate."""
    config = car_of(on_simulated_wires(tmp_path, kind=kind, rate=rate))
    receiver = configured(config.receiver)
    seeds = [np.random.SeedSequence(number) for number in (1, 2)]
    car = FaultInjectedCar(
        config.parameters, config.start(), config.lot, config.epoch, seeds[0], (), seeds[1], receiver=receiver
    )
    decoder, seconds, fixes = receiver.decoder(), receiver.settling_time + 4.0, list[Fix]()
    for number in range(1, round(seconds * 100.0) + 1):
        for arrival, data in car.step(number / 100.0, ()).packets:
            fixes += decoder.feed(data, arrival)
    # Dated as in a drive, which knows the declared delay alone and not the epoch.
    dater, trusted = FixDater(0.003, math.nan, absolute=False), list[Fix]()
    gate: TrustGate | None = None
    for fix in fixes:
        dated = dater.date(fix.time_received, fix)
        if isinstance(dated, Undated):
            continue
        gate = gate or TrustGate(receiver.profile, dater.epoch)
        if gate.step(fix.time_received, dated).trusted:
            trusted.append(fix)
    late = [fix for fix in fixes if fix.time - config.epoch > seconds - 1.0]
    assert len(late) == pytest.approx(0.95 * rate, abs=0.06 * rate + 1.0)
    assert trusted[-len(late) :] == late
    flat = pyproj.Proj("+proj=aeqd +lat_0=40.0030 +lon_0=-83.0200 +datum=WGS84")
    last = fixes[-1]
    place = flat(math.degrees(last.longitude), math.degrees(last.latitude))
    assert place == pytest.approx(STANDS, abs=0.15)
    assert last.quality is FixQuality.RTK_FIXED


@pytest.mark.parametrize("kind", LIVE_KINDS, ids=lambda kind: Path(kind).name)
def test_what_it_sends_arrives_on_the_wire_that_the_drive_opens(kind: str, tmp_path: Path) -> None:
    receiver = meaning.receiver_of(on_simulated_wires(tmp_path, kind=kind).rig)
    sent, arrived = b"".join(FRAME.pack(0x600, 8, bytes(range(8))) for _ in range(3)), b""
    with contextlib.ExitStack() as stack:
        far = None
        if receiver.far_end_first:
            far = receiver.far_end(LinkedAdapter)
        source = receiver.open(Bus)
        stack.callback(source.close)
        far = far or receiver.far_end(LinkedAdapter)
        assert far is not None
        stack.callback(far.close)
        begun = time.monotonic()
        while not arrived and time.monotonic() < begun + 20.0:
            far.send(sent)
            select.select([source], [], [], 0.05)
            arrived += b"".join(data for _stamp, data in source.receive())
    assert arrived.startswith(sent[: FRAME.size])


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
    found = rehearsed(rigs.load(file), file, resolved(), tmp_path).rig  # which refuses a car outside its lot
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
        rehearsed(rigs.load(file), file, resolved(), Path())


@pytest.mark.parametrize("kind", sorted({*PORT.shipped} - {*LIVE_KINDS}))
def test_a_recorded_receiver_is_not_rehearsed(kind: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"real\.toml: pose\.kind: .*'file' has no encoder"):
        on_simulated_wires(tmp_path, kind=kind)


def test_more_fixes_than_can_be_simulated_are_said(tmp_path: Path) -> None:
    assert "100 fixes a second, the rig says 250" in on_simulated_wires(tmp_path, rate=250.0).notes[-1]
    assert len(on_simulated_wires(tmp_path, rate=100.0).notes) == 1


def test_outputs_are_left_out_and_said(tmp_path: Path) -> None:
    output = '[[outputs]]\nkind = "esr"\ninterface = "socketcan"\nchannel = "can3"\n\n[alignment]'
    found = on_simulated_wires(tmp_path, ("[alignment]", output))
    assert found.rig.outputs == ()
    assert "left out of the rig: outputs" in found.notes[-1]
    assert re.search(r"bus socketcan:can0 is emulated", found.notes[0])


@pytest.mark.thorough
@pytest.mark.live
@pytest.mark.parametrize(("kind", "rate"), [("nmea_serial", 10.0), ("ubx_udp", 10.0), ("oxts_can", 100.0)])
def test_the_rig_of_a_real_car_is_driven_by_keys_on_simulated_wires(kind: str, rate: float, tmp_path: Path) -> None:
    """A serial line, a network or a card of the receiver, and a card of the car's bus: none is there; it stops in time.

    An OXTS unit on CAN counts as locking for 12 s at the start and 12 s more in the drive, so READY takes a while.
    """
    faster = ("speed_mps = 8.0", "speed_mps = 9.0")
    file, record = real_rig(tmp_path, faster, kind=kind, rate=rate), tmp_path / "record"
    arguments = (SCENARIO, "--rig", str(file), "--rehearse")
    with desk(*arguments, record=record, program=("-m", "vve_sumo.cli", "drive")) as at:
        at.until(lambda: "READY: E ENGAGES" in at.picture, 120.0)
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
    assert recorded["pose"]["kind"] == kind
    assert not any(real.strip('"') in json.dumps(recorded["pose"]) for real in REAL_WIRE.values())
