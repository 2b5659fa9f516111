"""Shipped interfaces against public descriptions of their wires, read by an independent decoder.

The DBC files of PACMod and Raptor are read by cantools and are no part of this repository; of the ULC the public source
is a C struct, which ctypes lays out.
"""

from __future__ import annotations

import ctypes
import math
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import cantools
import pytest

from vve_sumo import dbc
from vve_sumo.values import EXTENDED, Frame
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.interface import ActuationCommand, Gear, InterfaceConfig, load
from vve_sumo.vehicle.pacmod.interface import MAPPING as PACMOD
from vve_sumo.vehicle.raptor.interface import MAPPING as RAPTOR
from vve_sumo.vehicle.ulc.interface import MAPPING as ULC

ON_THE_CAR = {"command_timeout_s": 0.1, "when_commands_stop": "releases"}
SHIPPED = {
    "as_pacmod.dbc": (PACMOD.with_name("pacmod3.dbc"), InterfaceConfig("pacmod3", {"brake_nm": 3412.0, **ON_THE_CAR})),
    "New_Eagle_DBW_3.4.dbc": (
        RAPTOR.with_name("raptor.dbc"),
        InterfaceConfig("new_eagle_raptor", {"brake_nm": 5000.0, **ON_THE_CAR}),
    ),
}
#: Of a Motorola signal of three bits that does not lie in a row, our file has the two low ones.
PARTS = {("AcceleratorRequest", "TYPE"), ("SteeringRequest", "TYPE"), ("BrakeRequest", "TYPE")}
VALUES = 2_000  # of the tests that every change has to pass; a hundred thousand of the exhaustive one


@cache
def public(file: Path) -> cantools.database.Database:
    return cantools.database.load_file(file, strict=False)


def described(file: Path, identifier: int):
    """The public description of a message of ours."""
    wanted = identifier & ~EXTENDED
    (message,) = (one for one in public(file).messages if one.frame_id == wanted)
    assert message.is_extended_frame is bool(identifier & EXTENDED)
    return message


def counterpart(message, own: dbc.Signal, size: int):
    """The public signal in the same bits, whatever it is called; of cases of a multiplexed one, any."""
    start = own.shift if own.order == "little" else None
    for signal in message.signals:
        if signal.length != own.length or (signal.byte_order == "little_endian") is not (own.order == "little"):
            continue
        if start is None:
            first = 8 * size - own.shift - own.length  # bits before its most significant one, in order of sending
            there = signal.start // 8 * 8 + 7 - signal.start % 8
            if first == there:
                yield signal
        elif signal.start == start:
            yield signal


@pytest.mark.parametrize("name", SHIPPED)
def test_every_signal_is_described_as_ours_is(shared_data, name):
    file = shared_data / "dbc" / name
    for message in dbc.read(SHIPPED[name][0]).values():
        there = described(file, message.id)
        assert there.length == message.size
        for signal in message.signals.values():
            if (message.name, signal.name) in PARTS:
                continue
            found = list(counterpart(there, signal, message.size))
            assert found, f"{message.name}.{signal.name} has no counterpart"
            assert any(
                (one.scale, one.offset, one.is_signed) == (signal.scale, signal.offset, signal.signed) for one in found
            ), f"{message.name}.{signal.name}"


def compare_values(file: Path, ours: Path, chance: random.Random, count: int) -> int:
    """Read random frames by both descriptions; return how many values were compared."""
    compared = 0
    messages = list(dbc.read(ours).values())
    while compared < count:
        message = chance.choice(messages)
        there, data = described(file, message.id), chance.randbytes(message.size)
        mine = message.decode(data)
        for signal in message.signals.values():
            if (message.name, signal.name) in PARTS:
                continue
            for one in counterpart(there, signal, message.size):
                if one.multiplexer_ids is not None and (one.scale, one.is_signed) != (signal.scale, signal.signed):
                    continue  # another case of the same bits
                # cantools reads one case of a multiplexed message at a time: the bits are the same in all.
                raw = _raw(there, one, data)
                assert mine[signal.name] == pytest.approx(raw * one.scale + one.offset, rel=1e-12, abs=1e-12)
                compared += 1
    return compared


def _raw(message, signal, data: bytes) -> int:
    plain = cantools.database.Message(
        message.frame_id, "one", message.length, [_alone(signal)], is_extended_frame=message.is_extended_frame
    )
    return int(plain.decode(data, scaling=False, decode_choices=False, allow_truncated=False)["alone"])


@cache
def _alone_cached(start: int, length: int, order: str, signed: bool):
    return cantools.database.Signal(
        "alone",
        start,
        length,
        order,
        conversion=cantools.database.conversion.BaseConversion.factory(is_float=False),
        raw_initial=None,
        is_signed=signed,
    )


def _alone(signal):
    return _alone_cached(signal.start, signal.length, signal.byte_order, signal.is_signed)


@pytest.mark.parametrize("name", SHIPPED)
def test_random_frames_are_read_as_the_public_description_does(shared_data, name):
    assert compare_values(shared_data / "dbc" / name, SHIPPED[name][0], random.Random(1), VALUES) >= VALUES


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_a_hundred_thousand_values_are_read_as_the_public_description_does(shared_data, name):
    assert compare_values(shared_data / "dbc" / name, SHIPPED[name][0], random.Random(2), 100_000) >= 100_000


def commands(chance: random.Random, facts) -> ActuationCommand:
    braking = chance.random() < 0.5
    return ActuationCommand(
        chance.uniform(0.0, facts.brake_torque_limit) if braking else 0.0,
        0.0 if braking else chance.random(),
        chance.uniform(-1.0, 1.0) * facts.wheel_angle_limit,
        chance.uniform(0.2, facts.wheel_rate_limit),
        chance.choice([Gear.NONE, Gear.PARK, Gear.DRIVE, Gear.NEUTRAL, Gear.REVERSE]),
        enable=chance.random() < 0.8,
        clear=chance.random() < 0.2,
    )


def by_name(file: Path, frames: tuple[Frame, ...]) -> dict[str, float]:
    """All signals of a step, as the public description reads them."""
    said = {}
    for frame in frames:
        message = described(file, frame.id)
        said |= message.decode(frame.data, decode_choices=False) | {f"#{message.name}": frame.data}
    return said


def crc8(data: bytes) -> int:
    """SAE J1850 bit by bit: 0x1D, begun with 0xFF, inverted at the end."""
    value = 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ 0x1D) & 0xFF if value & 0x80 else value << 1
    return value ^ 0xFF


def test_the_checksum_is_that_of_the_catalogue():
    """CRC-8/SAE-J1850 of "123456789" is 0x4B (Koopman; reveng's catalogue)."""
    assert crc8(b"123456789") == 0x4B


@pytest.mark.parametrize("count", [200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_raptors_requests_say_what_was_commanded(shared_data, count):
    file = shared_data / "dbc" / "New_Eagle_DBW_3.4.dbc"
    interface, chance = load(SHIPPED["New_Eagle_DBW_3.4.dbc"][1]), random.Random(3)
    for number in range(count):
        command = commands(chance, interface.facts)
        said = by_name(file, interface.encode(command))
        assert said["AKit_AccelReqType"] == 0
        assert said["AKit_BrakeCtrlReqType"] == 1
        assert said["AKit_SteeringReqType"] == 1
        assert said["AKit_AccelPdlReq"] == pytest.approx(100.0 * command.throttle, abs=0.0501)
        assert said["AKit_BrakePcntTorqueReq"] == pytest.approx(command.brake_torque / 50.0, abs=0.0501)
        assert said["AKit_SteeringWhlAngleReq"] == pytest.approx(math.degrees(command.wheel_angle), abs=0.0501)
        rate = said["AKit_SteeringWhlAngleVelocityLim"]
        assert 10.0 <= rate <= max(math.degrees(command.wheel_rate), 10.0) + 1e-6
        assert rate > math.degrees(command.wheel_rate) - 10.0
        assert said["AKit_PrndStateReq"] == {Gear.NONE: 0, Gear.PARK: 1, Gear.REVERSE: 2, Gear.NEUTRAL: 3}.get(
            command.gear, 4
        )
        for enable in ("GlobalByWireEnblReq", "AccelPdlEnblReq", "SteerCtrlEnblReq", "BrakeCtrlEnblReq"):
            assert said[f"AKit_{enable}"] == command.enable
        assert said["AKit_PrndCtrlEnblReq"] == command.enable
        for ignore in ("Akit_AccelPdlIgnoreDriverOvrd", "AKit_SteeringWhlIgnoreDriverOvrd"):
            assert said[ignore] == 0
        for counter in ("GlobalEnbl", "AccelPdl", "Steer", "Brake", "Prnd"):
            assert said[f"AKit_{counter}RollingCntr"] == number % 16
        for message in ("GlobalEnbl", "AccelPdlRequest", "SteeringRequest", "BrakeRequest", "PrndRequest"):
            data = said[f"#AKit_{message}"]
            assert data[7] == crc8(data[:7])


@pytest.mark.parametrize("count", [200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_pacmods_commands_say_what_was_commanded(shared_data, count):
    file = shared_data / "dbc" / "as_pacmod.dbc"
    interface, chance = load(SHIPPED["as_pacmod.dbc"][1]), random.Random(4)
    for number in range(count):
        command = commands(chance, interface.facts)
        said = {frame.id: described(file, frame.id).decode(frame.data, decode_choices=False)
                for frame in interface.encode(command)}  # fmt: skip
        assert said[0x100]["ACCEL_CMD"] == pytest.approx(command.throttle, abs=5.01e-4)
        assert said[0x104]["BRAKE_CMD"] == pytest.approx(command.brake_torque / 3412.0, abs=5.01e-4)
        assert said[0x12C]["POSITION"] == pytest.approx(command.wheel_angle, abs=5.01e-4)
        assert command.wheel_rate - 1.001e-3 <= said[0x12C]["ROTATION_RATE"] <= command.wheel_rate + 1e-9
        gears = {Gear.NONE: 7, Gear.PARK: 0, Gear.REVERSE: 1, Gear.NEUTRAL: 2, Gear.DRIVE: 3}
        assert said[0x128]["SHIFT_CMD"] == gears[command.gear]
        for identifier in (0x100, 0x104, 0x12C, 0x128):
            assert said[identifier]["ENABLE"] == command.enable
            assert said[identifier]["CLEAR_OVERRIDE"] == command.clear
            assert said[identifier]["IGNORE_OVERRIDES"] == 0
        whole = said[0x080]
        assert whole["COUNTER"] == number % 16
        assert whole["COMPLEMENT"] == 15 - number % 16
        assert (whole["SANITY_CHECK_REQUIRED"], whole["CLEAR_FAULTS"]) == (1, 0)


class UlcCommand(ctypes.LittleEndianStructure):
    """MsgUlcCmd of dataspeed_ulc_can (reference: revyos-ros/dbw_ros-release, release/humble/dataspeed_ulc_can)."""

    _pack_ = 1
    _fields_ = (
        ("lon", ctypes.c_int16), ("yaw", ctypes.c_int16),
        ("curvature", ctypes.c_uint8, 1), ("from_park", ctypes.c_uint8, 1), ("shift", ctypes.c_uint8, 1),
        ("steer", ctypes.c_uint8, 1), ("pedals", ctypes.c_uint8, 1), ("clear", ctypes.c_uint8, 1),
        ("acceleration", ctypes.c_uint8, 1), ("coast", ctypes.c_uint8, 1),
        ("five", ctypes.c_uint8), ("six", ctypes.c_uint8), ("wdc", ctypes.c_uint8),
    )  # fmt: skip


class UlcReport(ctypes.LittleEndianStructure):
    """MsgUlcReport of the same source."""

    _pack_ = 1
    _fields_ = (
        ("speed_ref", ctypes.c_int16, 13), ("timeout", ctypes.c_uint16, 1), ("pedals", ctypes.c_uint16, 1),
        ("mode", ctypes.c_uint16, 1), ("speed", ctypes.c_int16, 13), ("override", ctypes.c_uint16, 1),
        ("steering", ctypes.c_uint16, 1), ("steering_mode", ctypes.c_uint16, 1), ("accel_ref", ctypes.c_int8),
        ("accel", ctypes.c_int8), ("angle", ctypes.c_uint8, 7), ("coasting", ctypes.c_uint8, 1),
        ("rate", ctypes.c_uint8, 6), ("steering_preempted", ctypes.c_uint8, 1), ("preempted", ctypes.c_uint8, 1),
    )  # fmt: skip


def test_the_ulcs_command_is_the_public_struct():
    interface, chance = load(InterfaceConfig("dataspeed_ulc", {"variant": "dbw1_2024"})), random.Random(5)
    for number in range(1000):
        wanted = ActuationCommand(
            0.0, 0.0, 0.1, 1.0, Gear.NONE, chance.random() < 0.5, chance.random() < 0.5, chance.uniform(-9.0, 4.0)
        )
        (data,) = (frame.data for frame in interface.encode(wanted) if frame.id == 0x076)
        said = UlcCommand.from_buffer_copy(data)
        assert said.lon == round(wanted.acceleration / 5e-4)
        assert (said.pedals, said.clear, said.acceleration) == (wanted.enable, wanted.clear, 1)
        assert (said.yaw, said.curvature, said.from_park, said.shift, said.steer, said.coast) == (0,) * 6
        assert (said.five, said.six, said.wdc) == (0, 0, number % 256)


def test_the_ulcs_report_is_the_public_struct():
    message, chance = dbc.read(ULC.with_name("ulc.dbc"))["UlcReport"], random.Random(6)
    for _ in range(3000):
        data = chance.randbytes(8)
        mine, said = message.decode(data), UlcReport.from_buffer_copy(data)
        assert mine["SPEED_REFERENCE"] == pytest.approx(0.02 * said.speed_ref)
        assert mine["SPEED"] == pytest.approx(0.02 * said.speed)
        assert mine["ACCELERATION_REFERENCE"] == pytest.approx(0.05 * said.accel_ref)
        assert mine["ACCELERATION"] == pytest.approx(0.05 * said.accel)
        assert (mine["TIMEOUT"], mine["PEDALS_ENABLED"], mine["OVERRIDE"]) == (said.timeout, said.pedals, said.override)
        assert (mine["STEERING_ENABLED"], mine["PEDALS_MODE"]) == (said.steering, said.mode)
        assert (mine["COASTING"], mine["SPEED_PREEMPTED"]) == (said.coasting, said.preempted)
        assert mine["LARGEST_WHEEL_ANGLE"] == pytest.approx(5.0 * said.angle)
        assert mine["LARGEST_WHEEL_RATE"] == pytest.approx(8.0 * said.rate)


def test_what_the_ulc_shares_with_dbw1_is_the_same():
    shared = dbc.read(layout.DBC)
    for name, message in dbc.read(ULC.with_name("ulc.dbc")).items():
        if name in shared:
            assert message.id == shared[name].id
            for one, signal in message.signals.items():
                assert replace(signal, choices={}) == replace(shared[name].signals[one], choices={})
