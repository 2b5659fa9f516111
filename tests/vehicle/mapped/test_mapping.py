"""What a mapping may say: every key is on its page; numbers, conditions, counters and checksums by hand-made frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from tests.vehicle.mapped.test_binding import EXAMPLE, changed
from vve_sumo.config_file import alternatives, inside
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import (
    ActuationCommand,
    Gear,
    GearState,
    InterfaceConfig,
    Malformed,
    SteeringState,
    VehicleInterface,
    WheelSpeeds,
    YawRate,
    load,
)
from vve_sumo.vehicle.mapped import checksums
from vve_sumo.vehicle.mapped.mapping import Mapping

PAGE = EXAMPLE.parents[1] / "docs" / "own_car.md"
NEUTRAL = ActuationCommand(0.0, 0.0, 0.0, 0.0, Gear.NONE, enable=False, clear=False)


def wire(mapping: Path = EXAMPLE / "campus_shuttle.toml") -> VehicleInterface:
    return load(InterfaceConfig("generic", {"mapping_file": str(mapping)}))


def names(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield name
        for kind in alternatives([field.annotation]):
            for inner in (kind, *inside(kind, 0)) if not isinstance(kind, type) else (kind,):
                for table in alternatives([inner]):
                    if isinstance(table, type) and issubclass(table, BaseModel):
                        yield from names(table)


def test_every_key_is_on_the_page():
    page = PAGE.read_text(encoding="utf-8")
    known = set(names(Mapping))
    assert {"watchdog", "polynomial", "between", "valid", "deceleration_mps2"} <= known
    assert sorted(name for name in known if name not in page) == []


@pytest.mark.parametrize(
    ("kind", "data", "value"),
    [
        ("sum", b"123456789", sum(b"123456789")),
        ("xor", b"123456789", 0x31),
        ("crc8", b"123456789", 0x4B),  # CRC-8/SAE-J1850 of the catalogue of CRCs
    ],
)
def test_checksums_are_those_of_the_catalogue(kind, data, value):
    assert checksums.function_of(kind, 0x1D, 0xFF, 0xFF)(data) == value


@pytest.mark.parametrize(
    ("polynomial", "initial", "final", "value"),
    [(0x2F, 0xFF, 0xFF, 0xDF), (0x07, 0x00, 0x00, 0xF4), (0x31, 0xFF, 0x00, 0xF7), (0x9B, 0xFF, 0x00, 0xDA)],
    ids=["AUTOSAR", "SMBUS", "NRSC-5", "CDMA2000"],
)
def test_other_polynomials_too(polynomial, initial, final, value):
    """The check values of CRC-8/AUTOSAR, SMBUS, NRSC-5 and CDMA2000 in the catalogue of CRCs."""
    assert checksums.crc8(b"123456789", polynomial, initial, final) == value


@given(st.floats(-6.0, 3.0), st.floats(-8.7, 8.7), st.booleans())
def test_a_command_is_where_the_dbc_file_says(acceleration, angle, enable):
    """Motorola, most significant byte first: by hand, without any reader of DBC files."""
    frames = dict(wire().encode(NEUTRAL._replace(acceleration=acceleration, wheel_angle=angle, enable=enable)))
    assert int.from_bytes(frames[272][:2], "big", signed=True) == round(acceleration / 1e-3)
    assert int.from_bytes(frames[273][:2], "big", signed=True) == round(math.degrees(angle) / 0.05)
    assert frames[272][2] == enable
    assert frames[273][2] == 2 * enable
    assert [frames[272][6], frames[273][6], frames[274][1]] == [0, 0, 0], "the counter of the first step"


def sealed(number: int, data: bytes, counter: int) -> Frame:
    """Return a report with its counter and its checksum, made by hand."""
    body = bytes([*data[:6], data[6] & 0xF0 | counter])
    crc = checksums.crc8([number >> 8, number & 0xFF, *body], 0x1D, 0xFF, 0xFF)
    return Frame(number, body + bytes([crc]))


def test_a_report_whose_counter_or_checksum_is_wrong_is_malformed():
    interface, data = wire(), bytes((0x03, 0xE8, 0x01, 0, 0, 0, 0))
    (report,) = interface.decode(sealed(529, data, 1))
    assert report == SteeringState(pytest.approx(math.radians(50.0)), True, driver_torque=0.0)
    assert interface.decode(sealed(529, data, 1)) == Malformed(529, "counter")
    good = sealed(529, data, 2)
    assert interface.decode(Frame(529, good.data[:7] + bytes([good.data[7] ^ 1]))) == Malformed(529, "checksum")
    assert interface.decode(Frame(529, good.data[:7])) == Malformed(529, "length")
    assert interface.decode(good) == (report,)


def test_a_gear_without_a_name_is_malformed_and_numbers_that_are_unknown_are_no_numbers():
    interface = wire()
    assert interface.decode(Frame(530, bytes([4, 0]))) == (GearState(Gear.DRIVE),)
    assert interface.decode(Frame(530, bytes([0, 0]))) == Malformed(530, "value")
    (wheels,) = interface.decode(Frame(531, b"\x27\x10" * 3 + b"\xff\xff"))
    assert wheels[:3] == (0.0, 0.0, 0.0)
    assert math.isnan(wheels.rear_right)
    assert isinstance(wheels, WheelSpeeds)
    rate, _acceleration = interface.decode(Frame(532, b"\x80\x00\x00\x00"))
    assert isinstance(rate, YawRate)
    assert math.isnan(rate.yaw)


def test_a_scale_turns_the_sign_and_says_the_unit(tmp_path):
    angle = 'steering_wheel_angle = "SteeringCommand.ANGLE"'
    turned = 'steering_wheel_angle = { signal = "SteeringCommand.ANGLE", scale = -0.017453292519943295 }'
    mapping = changed(tmp_path, "campus_shuttle.toml", angle, turned)
    left = dict(wire().encode(NEUTRAL._replace(wheel_angle=1.0)))[273]
    right = dict(wire(mapping).encode(NEUTRAL._replace(wheel_angle=-1.0)))[273]
    assert left == right


def test_without_a_count_for_no_request_the_gear_last_reported_is_sent(tmp_path):
    interface = wire(changed(tmp_path, "campus_shuttle.toml", "none = 0, ", ""))
    assert dict(interface.encode(NEUTRAL))[274][0] == 1, "park, as long as nothing is known"
    interface.decode(Frame(530, bytes([4, 0])))
    assert dict(interface.encode(NEUTRAL))[274][0] == 4
    assert dict(interface.encode(NEUTRAL._replace(gear=Gear.PARK)))[274][0] == 1


def test_a_report_in_two_messages_comes_when_both_came_again(tmp_path):
    mapping = changed(
        tmp_path, "campus_shuttle.toml", 'yaw = "Inertial.YAW_RATE"',
        'yaw = "Inertial.YAW_RATE"\nroll = { signal = "WheelSpeeds.FRONT_LEFT", scale = 1.0 }',
    )  # fmt: skip
    interface = wire(mapping)
    motion, wheels = Frame(532, bytes(4)), Frame(531, b"\x27\x10" * 4)

    def kinds(frame: Frame) -> set[type]:
        reports = interface.decode(frame)
        assert not isinstance(reports, Malformed)
        return {type(report) for report in reports}

    assert YawRate not in kinds(motion)
    assert YawRate in kinds(wheels)
    assert YawRate not in kinds(wheels), "half of it is old"
    assert YawRate in kinds(motion)
