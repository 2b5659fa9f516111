"""Rig files: what they may say, and the one line that says what is wrong, before anything is opened."""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import vehicles
from tests.complaints import complaint_of
from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.rig import resolve
from vve_sumo.rig.load import load, parse, parse_json
from vve_sumo.rig.validation import arming_obstacle
from vve_sumo.vehicle.model import IDEAL

SIMULATED = REPOSITORY / "rigs" / "simulated.toml"
EXAMPLE = REPOSITORY / "rigs" / "fusion_example.toml"
DAY = datetime.date(2026, 5, 1)
WATCHDOG = {"date": DAY, "armed": True, "deceleration_mps2": 2.5, "delay_s": 0.2}
#: the same where the watchdog did not brake
ROLLED = WATCHDOG | {"armed": False, "deceleration_mps2": 0.3}
NMEA_UDP = {"kind": "nmea_udp", "velocity_sigma_mps": 0.05, "heading_sigma_deg": 0.2, "minimum_delay_ms": 20.0}
ON_CAN = {"kind": "oxts_can", "interface": "socketcan", "channel": "vcan1", "minimum_delay_ms": 10.0}
RECORDED = {"kind": "file", "file": "a.ncom"}
HEARD_BY_ALL = {"kind": "ncom_udp", "address": "0.0.0.0", "source": "127.0.0.1", "minimum_delay_ms": 10.0}
#: an approximate square of 220 m, one of its corners being the first
CORNER = (40.003, -83.020)

Change = Callable[[dict[str, Any]], object]


def simulated() -> dict[str, Any]:
    return tomllib.loads(SIMULATED.read_text(encoding="utf-8"))


def real() -> dict[str, Any]:
    table = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    table["lot"]["surveyed"] = DAY
    return table


def said(table: dict[str, Any], change: Change) -> str:
    """The one line that a changed rig is refused with."""
    change(table)
    text = complaint_of(parse, table)
    assert len(text) < 300
    return text


def put(place: str, value: object) -> Change:
    """A change: the value at a dotted place."""

    def change(table: dict[str, Any]) -> None:
        *above, key = place.split(".")
        for part in above:
            table = table.setdefault(part, {})
        table[key] = value

    return change


def test_the_twin_is_ready_and_commands_nothing_real() -> None:
    rig = load(SIMULATED)
    assert rig.car == "simulated"
    assert arming_obstacle(rig, DAY) is None
    assert rig.operator.automatic


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"vehicle": {"model": "tank"}}, "vehicle.model: no vehicle named 'tank'; known: ford_fusion, lincoln_mkz"),
        ({"vehicle": {"model": 3}}, "vehicle.model: expected a text in quotes, got 3"),
        ({"vehicle": 3}, "vehicle: expected a table, got 3"),
        ({"vehicle": {"mass_kg": "heavy"}}, "vehicle.mass_kg: expected a number, got 'heavy'"),
        (
            {"vehicle": {"steering_limit_deg": 30.0}},
            "unknown key 'vehicle.steering_limit_deg', did you mean 'steering_wheel_limit_deg'?",
        ),
        ({"simulated": {"sources": {}}}, "unknown key 'simulated.sources'"),
    ],
)
def test_what_a_rig_says_of_its_car_is_named(table: dict[str, Any], words: str) -> None:
    assert said(real(), lambda whole: whole.update(table)) == words


def test_the_example_says_what_to_fill_in_first() -> None:
    with pytest.raises(
        ConfigError, match=r"fusion_example\.toml: key 'lot\.surveyed' is missing: .*survey it"
    ) as caught:
        load(EXAMPLE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ({"address": "0.0.0.0"}, "pose: source is missing: anyone who reaches 0.0.0.0 could be the receiver"),
        ({"address": "192.168.25.1"}, "pose: source is missing: anyone who reaches 192.168.25.1"),
        ({"address": "0.0.0.0", "source": "0.0.0.0"}, "pose.source: expected the IPv4 address of one device"),
        ({"address": "0.0.0.0", "source": "239.1.1.1"}, "pose.source: expected the IPv4 address of one device"),
        ({"address": "0.0.0.0", "source": "255.255.255.255"}, "pose.source: expected the IPv4"),
        ({"address": "0.0.0.0", "source": "fe80::1"}, "pose.source: expected the IPv4"),
        ({"address": "0.0.0.0", "source": "receiver"}, "pose.source: expected an IP address in numbers"),
        ({"source": "192.168.25.44"}, "pose: source: 192.168.25.44 cannot be heard on 127.0.0.1"),
        ({"kind": "file", "file": "a.ncom", "source": "127.0.0.1"}, "unknown key 'pose.source'; kind 'file' has"),
    ],
)
@pytest.mark.parametrize("kind", ["ncom_udp", "nmea_udp"])
def test_a_port_that_others_reach_names_its_receiver(pose: dict[str, Any], words: str, kind: str) -> None:
    table = NMEA_UDP if kind == "nmea_udp" and "file" not in pose else {"kind": kind, "minimum_delay_ms": 3.0}
    assert words in said(real(), put("pose", table | pose))


def test_quantities_in_the_keys_of_a_kind_of_receiver_become_numbers() -> None:
    pose = NMEA_UDP | {"source": "127.0.0.1", "velocity_sigma_mps": "0.36 km/h", "heading_sigma_deg": "0.01 rad"}
    parsed = parse(real() | {"pose": pose}, EXAMPLE).pose
    assert parsed.velocity_sigma_mps == pytest.approx(0.1)  # type: ignore[attr-defined]
    assert parsed.heading_sigma_deg == pytest.approx(math.degrees(0.01))  # type: ignore[attr-defined]
    without = {key: value for key, value in pose.items() if key != "heading_sigma_deg"} | {"heading_sigma": "0.5 deg"}
    assert parse(real() | {"pose": without}, EXAMPLE).pose.heading_sigma_deg == 0.5  # type: ignore[attr-defined]
    wrong = said(real(), put("pose", pose | {"heading_sigma_deg": "3 m"}))
    assert "pose.heading_sigma_deg: expected a angle in deg, °, rad, got '3 m'" in wrong


def test_a_receiver_on_the_network_is_named_and_one_on_the_loopback_need_not_be() -> None:
    assert parse(real(), EXAMPLE).pose.source == "192.168.25.44"
    assert parse(simulated(), SIMULATED).pose.source is None
    assert (
        parse(simulated() | {"pose": simulated()["pose"] | {"source": "127.0.0.1"}}, SIMULATED).pose.source
        == "127.0.0.1"
    )


def test_the_example_with_a_survey_may_shadow_but_not_arm() -> None:
    refusal = arming_obstacle(parse(real(), EXAMPLE), DAY)
    assert refusal is not None
    assert refusal.startswith("watchdog_test is missing")
    table = real() | {"watchdog_test": WATCHDOG}
    assert arming_obstacle(parse(table, EXAMPLE), DAY) is None
    table["watchdog_test"] = ROLLED
    assert arming_obstacle(parse(table, EXAMPLE), DAY) is None, "armed or not, it was tried"
    played = real() | {"watchdog_test": WATCHDOG, "pose": {"kind": "file", "file": "a.ncom"}}
    assert "recording" in str(arming_obstacle(parse(played, EXAMPLE), DAY))


def test_a_rig_survives_its_record() -> None:
    for table in (simulated(), real() | {"watchdog_test": WATCHDOG}):
        rig = parse(table, SIMULATED)
        kept = json.loads(json.dumps(rig.model_dump(mode="json", exclude_unset=True)))
        assert parse_json(kept, SIMULATED) == rig


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("mounting.heading_misalignment_rad", 0.01), "did you mean 'heading_misalignment_deg'?"),
        (put("mounting.foward_m", 0.3), "unknown key 'mounting.foward_m', did you mean 'forward_m'?"),
        (put("limits.speed_kmh", 30.0), "did you mean 'speed_mps'?"),
        (put("limits.speed", 8.0), "did you mean 'speed_mps'?"),
        (put("lot.grade_deg", 1.0), "did you mean 'grade_percent'?"),
        (put("vehicle.wheelbase", 2.8), "did you mean 'wheelbase_m'?"),
        (put("colour", "red"), "unknown key 'colour'"),
        (
            put("watchdog_test", WATCHDOG | {"delay_ms": 200}),
            "unknown key 'watchdog_test.delay_ms', did you mean 'delay_s'?",
        ),
        (put("others", [{"kind": "esr", "interfce": "a", "channel": "b"}]), "did you mean 'interface'?"),
        (put("limits.speed_mps", float("nan")), "limits.speed_mps: "),
        (put("limits.speed_mps", float("inf")), "limits.speed_mps: "),
        (put("limits.speed_mps", "8"), "limits.speed_mps: "),
        (put("limits.stop_deceleration_mps2", -2.4), "limits.stop_deceleration_mps2: "),
        (put("limits.comfort_deceleration_mps2", 50.0), "limits.comfort_deceleration_mps2: "),
        (put("limits.comfort_acceleration_mps2", 50.0), "limits.comfort_acceleration_mps2: "),
        (put("limits.lateral_acceleration_mps2", 100.0), "limits.lateral_acceleration_mps2: "),
        (put("limits.emergency_deceleration_mps2", 9.9), "limits.emergency_deceleration_mps2: "),
        (put("limits.critical_deceleration_mps2", 9.9), "limits.critical_deceleration_mps2: "),
        (put("limits.stop_jerk_mps3", 1000.0), "limits.stop_jerk_mps3: "),
        (
            put("watchdog_test", WATCHDOG | {"armed": False, "deceleration_mps2": 9.0, "delay_s": 0.001}),
            "watchdog_test: deceleration_mps2: 9 m/s2 with armed = false, where nobody brakes; expected that of",
        ),
        (put("watchdog_test", WATCHDOG | {"deceleration_mps2": 9.9}), "watchdog_test.deceleration_mps2: "),
        (
            put("watchdog_test", WATCHDOG | {"delay_s": 0.099}),
            "watchdog_test.delay_s: 0.099 s, but dataspeed_dbw1 waits 0.1 s for a command before anything happens",
        ),
        (put("watchdog_test", WATCHDOG | {"valid_days": 0}), "watchdog_test.valid_days: "),
        (put("watchdog_test", WATCHDOG | {"records": "runs/a"}), "watchdog_test.records: "),
        (put("lot.valid_days", 36500), "lot.valid_days: "),
        (put("limits.emergency_deceleration_mps2", 3.0), "limits: emergency deceleration must not be below"),
        (put("rehearse", []), "key 'rehearse' is now 'faults'"),
        (put("car", "hardware_free"), "car: expected 'real' or 'simulated', got 'hardware_free'"),
        (put("bus.variant", "dbw1_2024"), "key 'bus.variant' is now 'drive_by_wire.settings.variant'"),
        (
            put("drive_by_wire.settings.variant", "dbw2"),
            "drive_by_wire: drive-by-wire interface dataspeed_dbw1: ",
        ),
        (
            put("drive_by_wire.settings.mode", 1),
            "drive_by_wire: drive-by-wire interface dataspeed_dbw1: ",
        ),
        (put("drive_by_wire.interface", "pacmod"), "drive_by_wire: drive-by-wire interface pacmod: unknown"),
        (put("pose.address", "localhost"), "pose.address: expected an IP address in numbers, got 'localhost'"),
        (put("pose.device", "/dev/ttyS0"), "unknown key 'pose.device'; kind 'ncom_udp' has address, clock"),
        (put("pose", {"kind": "nmea_serial"}), "key 'pose.velocity_sigma_mps' is missing"),
        (put("pose", NMEA_UDP | {"kind": "nmea_serial"}), "key 'pose.device' is missing"),
        (put("pose.adress", "127.0.0.1"), "unknown key 'pose.adress', did you mean 'address'?; kind 'ncom_udp' has"),
        (put("pose", {"port": 3000}), "key 'pose.kind' is missing"),
        (put("pose", 7), "pose: expected a table"),
        (put("pose.kind", 7), "pose.kind: expected the name of a kind of receiver"),
        (put("pose.kind", "ncom\nudp"), "pose.kind: expected the name of a kind of receiver"),
        (
            put("pose.kind", "ncom"),
            "pose.kind: receiver ncom: unknown, did you mean 'ncom_udp'?; known are file, ncom_udp, nmea_serial, "
            "nmea_tcp, nmea_udp, novatel_serial, novatel_tcp, novatel_udp, oxts_can, sbf_serial, sbf_tcp, sbf_udp, "
            "ubx_serial, ubx_udp",
        ),
        (put("pose.kind", "nowhere/mine.py:make"), "nowhere/mine.py:make: there is no file"),
        (put("pose", {"kind": "oxts_can", "interface": "pcan"}), "key 'pose.channel' is missing"),
        (put("pose", {"kind": "nmea_udp"}), "key 'pose.velocity_sigma_mps' is missing"),
        (put("pose", {"kind": "ncom_udp"}), "pose: minimum_delay_ms is missing, clock 'arrival' needs it"),
        (put("pose.rate_hz", 1000.0), "pose.rate_hz: "),
        (put("mounting.forward_m", 300.0), "mounting.forward_m: "),
        (put("vehicle.length_m", 3.0), "vehicle: length_m is less than wheelbase_m and front_overhang_m"),
        (put("vehicle.front_axle_to_mass_m", 3.0), "vehicle: front_axle_to_mass_m is not less than"),
        (put("calibration.brake_gain_kgm", 0.0), "calibration.brake_gain_kgm: "),
        (put("latency.deadline_ms", 20.0), "latency.deadline_ms: "),
        (put("lot.surveyed", "yesterday"), "lot.surveyed: "),
        (put("operator.stop_can_id", 0x800), "operator.stop_can_id: "),
        (
            put("operator.stop_can_id", 0x064),
            "operator.stop_can_id: the stop and the drive-by-wire controller (bus)",
        ),
        (lambda t: t["lot"].pop("surveyed"), "key 'lot.surveyed' is missing: a lot that nobody has surveyed"),
        (lambda t: t.pop("lot"), "key 'lot' is missing: a lot that nobody has surveyed"),
        (lambda t: t.pop("mounting"), "key 'mounting' is missing"),
    ],
)
@pytest.mark.parametrize("table", [simulated, real])
def test_wrong_keys_and_values(table: Callable[[], dict[str, Any]], change: Change, words: str) -> None:
    text = said(table(), change)
    assert words in text


OUTLINE = [[40.003, -83.020], [40.003, -83.018], [40.005, -83.018], [40.005, -83.020]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("lot.outline", [[lon, lat] for lat, lon in OUTLINE]), "are latitude and longitude swapped?"),
        (put("lot.outline", [*OUTLINE[:3], [-75.0, 40.005]]), "lot.outline.3: lies "),
        (put("lot.outline", [*OUTLINE[:3], [40.005, -283.0]]), "longitude -283 is no place on Earth"),
        (put("lot.outline", OUTLINE[:2]), "lot.outline: "),
        (put("lot.outline", []), "lot.outline: "),
        (
            put("lot.outline", [OUTLINE[0], OUTLINE[2], OUTLINE[1], OUTLINE[3]]),
            "lot.outline: crosses or touches itself",
        ),
        (put("lot.outline", [[40.003, -83.02], [40.003, -83.0199], [40.0031, -83.0199]]), "lot.outline: encloses"),
        (put("lot.outline", [[40.0, -83.1], [40.0, -83.0], [40.1, -83.0], [40.1, -83.1]]), "lot.outline: encloses"),
        (put("lot.holes", [[[40.1, -83.02], [40.1, -83.019], [40.101, -83.019]]]), "lot.holes[0]: does not lie inside"),
        (put("lot.holes", [[[48.1, 11.5], [48.1, 11.6], [48.2, 11.6]]]), "lot.holes.0.0: lies "),
        (put("lot.holes", [[[40.0035, -83.019], [40.0036, -83.019]]]), "lot.holes.0: "),
        (put("lot.margin_m", 50.0), None),
        (put("lot.margin_m", -1.0), "lot.margin_m: "),
    ],
)
def test_lots_that_are_none(change: Change, words: str | None) -> None:
    table = real()
    table["lot"]["outline"] = OUTLINE
    if words is None:
        change(table)
        assert parse(table, EXAMPLE).lot.margin_m == 50.0
    else:
        assert words in said(table, change)


def test_an_outline_may_go_either_way_round() -> None:
    table = real()
    table["lot"]["outline"].reverse()
    assert parse(table, EXAMPLE)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("bus.interface", "udp_multicast"), "bus.interface: anyone on the network could command a real car"),
        (put("bus.interface", "socketcand"), "bus.interface: anyone on the network could command a real car"),
        (put("bus.interface", "virtual"), "bus: no real car is on virtual:can0"),
        (put("bus.channel", "vcan0"), "bus: no real car is on socketcan:vcan0"),
        (put("bus.channel", "pty"), "bus: no real car is on socketcan:pty"),
        (put("operator.automatic", True), "operator.automatic: a real car is engaged by a person"),
        (put("car_start", simulated()["car_start"]), "car_start: "),
        (put("faults", [{"kind": "pose_lost", "at_s": 1.0}]), "faults: none is injected into a real car"),
        (
            put("pose", NMEA_UDP | {"kind": "nmea_serial", "device": "pty:/tmp/gnss"}),
            "pose.device: pty:/tmp/gnss is a simulated vehicle's line, expected the receiver's own",
        ),
        (
            put("pose", ON_CAN | {"interface": "slcan", "channel": "pty:/tmp/oxts"}),
            "pose.channel: pty:/tmp/oxts is a simulated vehicle's line, expected the receiver's own",
        ),
    ],
)
def test_what_no_real_car_is_driven_with(change: Change, words: str) -> None:
    assert words in said(real(), change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.pop("car_start"), "key 'car_start' is missing"),
        (put("bus.interface", "udp_multicast"), "bus: a simulated vehicle is on"),
        (put("bus.channel", "/dev/ttyUSB0"), "bus: a simulated vehicle is on"),
        (
            put("bus", {"interface": "socketcan", "channel": "can0"}),
            "car_start.channel: 'can0'",
        ),
        (put("car_start.channel", "can1"), "car_start.channel: the car makes its own end"),
        (
            put("pose", HEARD_BY_ALL),
            "pose.address: the simulated vehicle is heard on a loopback address only",
        ),
        (
            put("pose", ON_CAN),
            "pose.channel: the simulated vehicle emulates its adapter, expected 'pty:FILE' of interface 'slcan', got "
            "socketcan:vcan1",
        ),
        (
            put("pose", NMEA_UDP | {"kind": "nmea_serial", "device": "/dev/ttyUSB0"}),
            "pose.device: the simulated vehicle makes its own line, expected 'pty:FILE', got '/dev/ttyUSB0'",
        ),
        (
            put("pose", NMEA_UDP | {"kind": "nmea_tcp", "address": "192.168.1.4"}),
            "pose.address: the simulated vehicle is heard on a loopback address only, got '192.168.1.4'",
        ),
        (put("pose", RECORDED), "pose.kind: receiver 'file' has no encoder and no far_end to be simulated by"),
        (put("car_start.latitude_deg", 40.0036), "car_start: the car does not stand inside the lot"),
        (put("car_start.latitude_deg", 41.0), "car_start: lies 111 km from the lot"),
        (
            lambda t: t["car_start"].update(latitude_deg=-83.0186, longitude_deg=40.0041),
            "(latitude and longitude are swapped)",
        ),
        (put("faults", [{"kind": "earthquake", "at_s": 1.0}]), "faults.0: fault: kind must be one of"),
        (
            put("faults", [{"kind": "pose_lost", "at_s": 1.0, "value": 3.0}]),
            "faults.0: fault pose_lost: takes no",
        ),
        (put("faults", [{"kind": "pose_lost", "at_s": -1.0}]), "faults.0.at_s: "),
        (
            put("faults", [{"kind": "pose_lost", "at_s": 1.0, "shape": "ramp"}]),
            "faults.0: fault pose_lost: its strength does not grow: no ramp",
        ),
        (put("faults", [{"kind": "pose_lost", "at_s": 1.0, "shape": "saw"}]), "faults.0.shape: "),
        (
            put("faults", [{"kind": "pose_lost", "at_s": 1.0, "shape": "flapping"}]),
            "faults.0: fault pose_lost: shape flapping needs a positive period",
        ),
    ],
)
def test_what_no_simulated_vehicle_is_driven_with(change: Change, words: str) -> None:
    change_and_see = simulated()
    change(change_and_see)
    with pytest.raises(ConfigError) as caught:
        parse(change_and_see, Path("mine.toml"))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_measured_car_needs_a_model_whose_file_says_what_was_measured(tmp_path: Path) -> None:
    table = simulated()
    table["car_start"]["fidelity"] = "measured"
    ours = parse(table, Path("mine.toml"))
    assert resolve.model_of(ours).measured == vehicles.FUSION.measured
    table["measured"] = {"wheel_jitter": 0.001}
    changed = resolve.model_of(parse(table, Path("mine.toml"))).measured
    assert changed == dataclasses.replace(vehicles.FUSION.measured, wheel_jitter=0.001)
    del table["measured"]
    text = (REPOSITORY / "vehicles" / "ford_fusion.toml").read_text(encoding="utf-8")
    (tmp_path / "bare.toml").write_text(text[: text.index("[measured]")], encoding="utf-8")
    table["vehicle"] = {"model": "bare.toml"}
    with pytest.raises(ConfigError, match=r"car_start\.fidelity: expected 'ideal', .* got 'measured'") as caught:
        parse(table, tmp_path / "rig.toml")
    assert "\n" not in str(caught.value)
    table["car_start"]["fidelity"] = "ideal"
    assert resolve.model_of(parse(table, tmp_path / "rig.toml")).measured == IDEAL


def on_socketcan(channel: str, car_end: str | None, *, automatic: bool) -> dict[str, Any]:
    table = simulated()
    table["bus"].update(interface="socketcan", channel=channel)
    table["operator"]["automatic"] = automatic
    if car_end:
        table["car_start"]["channel"] = car_end
    return table


@pytest.mark.parametrize(("channel", "car_end"), [("vcan0", None), ("can0", "can1"), ("can0", "vcan1")])
def test_a_simulated_vehicle_may_be_on_vcan_or_on_a_card_of_its_own(channel: str, car_end: str | None) -> None:
    table = on_socketcan(channel, car_end, automatic=False)
    assert parse(table, SIMULATED).bus.interface == "socketcan"


@pytest.mark.parametrize(("channel", "car_end"), [("can0", "can1"), ("can0", "vcan1"), ("vcan0", "can1")])
def test_nobody_but_a_person_engages_over_a_cable(channel: str, car_end: str) -> None:
    words = f"operator.automatic: a wrong cable on socketcan:{channel} would make it engage a real car"
    assert said(on_socketcan(channel, car_end, automatic=True), lambda table: None).startswith(words)


@pytest.mark.parametrize("car_end", [None, "vcan0", "vcan1"])
def test_the_program_may_engage_by_itself_where_both_ends_are_virtual(car_end: str | None) -> None:
    assert parse(on_socketcan("vcan0", car_end, automatic=True), SIMULATED).operator.automatic


CAN1 = {"interface": "socketcan", "channel": "can1"}


@pytest.mark.parametrize(
    ("pose", "others", "words"),
    [
        (CAN1, [{"kind": "esr", **CAN1}], "esr and oxts_can (pose) share identifiers 0x500 to 0x540 on socketcan:can1"),
        (CAN1, [{"kind": "ars408", **CAN1}], "ars408 and oxts_can (pose) share identifiers 0x600 to 0x60E"),
        (None, [{"kind": "oxts_can", **CAN1}, {"kind": "esr", **CAN1}], "others.1: esr and oxts_can (others.0) share"),
        (None, [{"kind": "esr", **CAN1}, {"kind": "esr", **CAN1}], "others.1: esr and esr (others.0) share"),
        (None, [{"kind": "esr", **CAN1}, {"kind": "ars408", **CAN1}], None),
        (CAN1, [{"kind": "esr", "interface": "socketcan", "channel": "can2"}], None),
    ],
)
def test_identifiers_that_collide_on_one_bus(pose: dict[str, str] | None, others: list, words: str | None) -> None:
    table = real() | {"others": others}
    if pose:
        table["pose"] = {"kind": "oxts_can", "minimum_delay_ms": 5.0, **pose}
    if words is None:
        assert parse(table, EXAMPLE)
    else:
        assert words in said(table, lambda _table: None)


def test_a_receiver_of_a_labs_own_may_count_its_channels(tmp_path: Path) -> None:
    """python-can's Kvaser and PCAN drivers take a number."""
    (tmp_path / "counted.py").write_text(
        "from pydantic import Field\n"
        "from vve_sumo.pose.receivers.ncom_udp import NcomUdp\n\n\n"
        "class Counted(NcomUdp):\n"
        "    channel: int = Field(default=0, description='number of the card')\n\n\n"
        "def make():\n"
        "    return Counted\n",
        encoding="utf-8",
    )
    table = simulated()
    table["pose"] |= {"kind": f"{tmp_path / 'counted.py'}:make", "channel": 3}
    assert parse(table, EXAMPLE).pose.channel == 3
