"""The codec against cantools over the DBC files, signal by signal and both ways."""

from __future__ import annotations

import enum
import math
import struct
from pathlib import Path
from typing import get_type_hints

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo import dbc
from vve_sumo.values import Frame
from vve_sumo.vehicle import frame_codec
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.dataspeed.layout import Variant
from vve_sumo.vehicle.interface import Gear, Malformed
from vve_sumo.wire import esr

MODERN, OLD = Variant.DBW1_2024, Variant.DBW1_2018
NEWER, OLDER = (
    {message.name: message for message in cantools.database.load_file(file, strict=True).messages}
    for file in (layout.DBC, layout.DBC.with_name("dbw1_2018.dbc"))
)
LAYOUTS = {MODERN: NEWER, OLD: NEWER | OLDER}
IDENTIFIERS = {
    "BrakeCommand": 0x060, "BrakeReport": 0x061, "ThrottleCommand": 0x062, "ThrottleReport": 0x063,
    "SteeringCommand": 0x064, "SteeringReport": 0x065, "GearCommand": 0x066, "GearReport": 0x067, "MiscCommand": 0x068,
    "WheelSpeeds": 0x06A, "Accelerations": 0x06B, "YawRate": 0x06C, "BrakeInfo": 0x074,
}  # fmt: skip
SI = {"deg": math.radians, "deg/s": math.radians, "km/h": lambda speed: speed / 3.6}
SIGNALS = {made: signals.replace("?", "").split() for made, signals in codec._SIGNALS.items()}
KINDS = st.sampled_from([(variant, made) for variant in Variant for made in SIGNALS])


def signal_of(made: type, name: str, variant: Variant, switch: int):
    """The signal of a field, of multiplexed ones that of the case that the switch says; None where there is none."""
    (found,) = [
        signal
        for signal in LAYOUTS[variant][made.__name__].signals
        if signal.name == name or (signal.multiplexer_ids == [switch] and signal.name.startswith(f"{name}_"))
    ] or [None]
    return found


def switch_of(made: type, variant: Variant, values) -> int:
    """What the field says that tells the cases of multiplexed signals apart."""
    names = {signal.name for signal in LAYOUTS[variant][made.__name__].signals if signal.is_multiplexer}
    signals = SIGNALS[made]
    return next((int(value) for name, value in zip(signals, values, strict=False) if name in names), 0)


def si(signal, value: float) -> float:
    return SI.get(signal.unit, float)(value)


def invalid(signal) -> int | None:
    return next((count for count, name in (signal.choices or {}).items() if name == "INVALID"), None)


@st.composite
def sayings(draw):
    """A message with values in the ranges of the DBC file."""
    variant, made = draw(KINDS)
    kinds, names = get_type_hints(made), SIGNALS[made]
    fields = {}
    for field, name in sorted(zip(kinds, names, strict=True), key=lambda pair: kinds[pair[0]] is float):
        kind = kinds[field]
        switch = switch_of(made, variant, [fields.get(field, 0) for field in kinds])
        signal = signal_of(made, name, variant, switch)
        if signal is None:
            fields[field] = kind(0)
        elif kind is float:
            low, high = (si(signal, limit or 0.0) for limit in (signal.minimum, signal.maximum))
            fields[field] = draw(st.floats(low, high))
        elif kind is bool:
            fields[field] = draw(st.booleans())
        else:
            fields[field] = draw(st.sampled_from(kind) if isinstance(kind, enum.EnumType) else st.integers(0, 255))
    return variant, made(**{field: fields[field] for field in kinds})


def test_both_dbc_files_hold_what_they_should():
    assert {name: message.frame_id for name, message in NEWER.items()} == IDENTIFIERS
    assert {name: message.frame_id for name, message in OLDER.items()}.items() <= IDENTIFIERS.items()
    assert codec.decode(Frame(layout.MISC_COMMAND, bytes(1))) is None


@given(sayings())
def test_every_signal_is_written_as_cantools_reads_it(saying):
    variant, message = saying
    made = type(message)
    frame = codec.encode(message, variant)
    assert frame.id == IDENTIFIERS[made.__name__]
    wire = LAYOUTS[variant][made.__name__].decode(frame.data, decode_choices=False)
    switch = switch_of(made, variant, message)
    for value, name in zip(message, SIGNALS[made], strict=True):
        signal = signal_of(made, name, variant, switch)
        if signal is None:
            assert value == 0
            continue
        said = wire.pop(signal.name)
        if name == "SVEL":
            step = signal.scale
            assert said == max(step, step * math.floor(math.degrees(value) / step + 1e-9)) if value else said == 0.0
        elif isinstance(value, float):
            half = si(signal, abs(signal.scale)) / 2
            assert si(signal, said) == pytest.approx(value, rel=1e-12, abs=half * (1 + 1e-9))
        else:
            assert said == value
    assert not any(wire.values()), "what no field says is zero, the bit that ignores the driver as well"


@given(KINDS, st.binary(min_size=8, max_size=8))
def test_every_signal_is_read_as_cantools_reads_it(kind, data):
    variant, made = kind
    description = LAYOUTS[variant][made.__name__]
    frame = Frame(IDENTIFIERS[made.__name__], data[: description.length])
    message = codec.decode(frame, variant)
    try:
        wire = description.decode(frame.data, decode_choices=False)
    except cantools.database.errors.DecodeError:  # the count of a switch is no case
        assert message == Malformed(frame.id, "value")
        return
    names = [name for name, type_ in zip(SIGNALS[made], get_type_hints(made).values(), strict=True)
             if isinstance(type_, enum.EnumType)]  # fmt: skip
    unnamed = any(wire[name] not in description.get_signal_by_name(name).choices for name in names if name in wire)
    reason = (
        "value" if unnamed else "ignore_bit" if wire.get("IGNORE") else "torque_mode" if wire.get("CMD_TYPE") else ""
    )
    if unnamed or wire.get("IGNORE") or (made is codec.SteeringCommand and reason):
        assert message == Malformed(frame.id, reason)
        return
    assert type(message) is made
    switch = switch_of(made, variant, message)
    for value, name in zip(message, SIGNALS[made], strict=True):
        signal = signal_of(made, name, variant, switch)
        if signal is None:
            assert value == 0
        elif signal.conversion.numeric_scaled_to_raw(wire[signal.name]) == invalid(signal):
            assert math.isnan(value)
        elif isinstance(value, float):
            assert value == pytest.approx(si(signal, wire[signal.name]), rel=1e-12, abs=1e-12)
        else:
            assert value == wire[signal.name]


@given(st.sampled_from(sorted(IDENTIFIERS)), st.binary(max_size=8))
def test_frames_of_another_length_are_refused(name, data):
    for variant in Variant:
        message = codec.decode(Frame(IDENTIFIERS[name], data), variant)
        lengths = {
            LAYOUTS[variant][name].length,
            4 if name in ("BrakeCommand", "ThrottleCommand", "SteeringCommand") else 0,
        }
        if name == "MiscCommand":
            assert message is None
        elif len(data) not in lengths:
            assert message == Malformed(IDENTIFIERS[name], "length")


@pytest.mark.parametrize(
    "command",
    [
        codec.BrakeCommand(messages.BrakeKind.NONE, 0.0, False, 0, clear=True),
        codec.ThrottleCommand(messages.ThrottleKind.NONE, 0.0, False, 0, clear=True),
        codec.SteeringCommand(0.0, 0.0, False, 0, clear=True),
    ],
)
def test_clear_alone_comes_with_four_bytes(command):
    number, data = codec.encode(command)
    assert codec.decode(Frame(number, data[:4])) == command._replace(counter=None)


BRAKE = codec.BrakeCommand(messages.BrakeKind.TORQUE, 100.0, True, 0)
STEER = codec.SteeringCommand(0.0, 1.0, True, 0)


@pytest.mark.parametrize(
    ("message", "variant"),
    [
        (BRAKE._replace(value=3413.0), MODERN),
        (BRAKE._replace(value=3251.0), OLD),
        (BRAKE._replace(value=-1.0), MODERN),
        (BRAKE._replace(value=math.nan), MODERN),
        (BRAKE._replace(value=math.inf), MODERN),
        (BRAKE._replace(kind=messages.BrakeKind.PERCENT, value=1.01), MODERN),
        (BRAKE._replace(kind=messages.BrakeKind.PEDAL, value=0.51), MODERN),
        (BRAKE._replace(kind=messages.BrakeKind.DECELERATION, value=10.1), MODERN),
        (codec.ThrottleCommand(messages.ThrottleKind.PERCENT, 1.01, True, 0), MODERN),
        (codec.ThrottleCommand(messages.ThrottleKind.PERCENT, math.nan, True, 0), MODERN),
        (STEER._replace(wheel_angle=9.61), MODERN),
        (STEER._replace(wheel_angle=-8.21), OLD),
        (STEER._replace(wheel_angle=math.nan), MODERN),
        (STEER._replace(wheel_rate=17.6), MODERN),
        (STEER._replace(wheel_rate=8.8), OLD),
        (STEER._replace(wheel_rate=math.nan), MODERN),
        (codec.WheelSpeeds(0.0, 0.0, 0.0, 328.0), MODERN),
        (codec.WheelSpeeds(0.0, 0.0, 0.0, math.inf), MODERN),
        (codec.YawRate(0.0, -6.56), MODERN),
        (codec.BrakeInfo(16_380.0, 0.0, False), MODERN),
        (codec.BrakeReport(messages.BrakeReportKind.TORQUE, 0.0, 0.0, 0.0, True), OLD),
        (codec.SteeringReport(0.0, 0.0, -1.0, 0.0, True), OLD),
        (codec.SteeringReport(0.0, 0.0, 1.0, 0.0, True, torque_mode=True), OLD),
    ],
)
def test_what_does_not_fit_is_refused_and_never_wrapped(message, variant):
    with pytest.raises(ValueError, match="got"):
        codec.encode(message, variant)


@pytest.mark.parametrize("counter", [-1, 256])
def test_a_counter_that_does_not_fit_is_refused(counter):
    with pytest.raises(struct.error):
        codec.encode(BRAKE._replace(counter=counter))


def test_nan_is_sent_as_invalid_and_read_as_nan():
    for message in (
        codec.WheelSpeeds(*[math.nan] * 4),
        codec.YawRate(math.nan, math.nan),
        codec.Accelerations(*[math.nan] * 3),
        codec.SteeringReport(*[math.nan] * 4, enabled=False),
        codec.BrakeInfo(math.nan, math.nan, False, acceleration_over_ground=math.nan),
    ):
        assert str(codec.decode(codec.encode(message))) == str(message)
    assert codec.encode(codec.YawRate(math.nan, math.nan)).data == bytes.fromhex("0080 0080")
    assert codec.encode(codec.GearReport(Gear.NONE)).data == bytes(2)


def test_nothing_public_can_ask_to_ignore_the_driver():
    for kind in (codec.BrakeCommand, codec.ThrottleCommand, codec.SteeringCommand, codec.GearCommand):
        assert not any("ignore" in name for name in kind._fields)


@pytest.mark.parametrize(
    ("signals", "complaint"),
    [
        ("GCMD CLEER", "GearCommand has no signal CLEER"),
        ("CLEAR CLEAR", "CLEAR: the DBC file has other names"),
    ],
)
def test_a_table_that_does_not_fit_its_dbc_file_is_refused(signals, complaint):
    with pytest.raises(ValueError, match=complaint):
        frame_codec.reading(layout.MESSAGES[MODERN]["GearCommand"], codec.GearCommand, signals)
    with pytest.raises(ValueError, match="Track: expected signals in Intel order"):
        frame_codec.encoder(dbc.read(Path(esr.__file__).with_name("esr.dbc"))["Track"], codec.GearCommand, signals)
