"""Frames that the codec made and read when its layouts were written by hand: every bit is kept.

`recorded_frames.jsonl` holds messages and commands with their frames (null: refused), and frames with what was read.
What the gateway and the simulated controller read is kept to the last digit, other messages to the one before.
"""

from __future__ import annotations

import enum
import json
from pathlib import Path
from typing import Any

import pytest

from vve_sumo.values import Frame
from vve_sumo.vehicle import interface as port
from vve_sumo.vehicle.dataspeed import codec, messages
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.dataspeed.layout import Variant

ROWS = [json.loads(line) for line in Path(__file__).with_name("recorded_frames.jsonl").read_text("ascii").splitlines()]
ENUMERATIONS = {
    ("BrakeReport", 0): messages.BrakeReportKind, ("BrakeReport", 10): messages.WatchdogSource,
    ("ThrottleReport", 7): messages.WatchdogSource, ("GearReport", 0): port.Gear, ("GearReport", 1): port.Gear,
    ("GearReport", 4): messages.GearReject, ("BrakeInfo", 3): messages.ParkingBrake, ("GearCommand", 0): port.Gear,
}  # fmt: skip


def rows(kind: str, variant: Variant) -> list[list[Any]]:
    chosen = [row[2:] for row in ROWS if row[:2] == [kind, variant.name]]
    assert len(chosen) >= 60
    return chosen


def plain(value: Any) -> list[Any]:
    """Name of a value's type and its fields, as the file holds them; NaN by its name, so that it equals itself."""
    return [type(value).__name__, [str(int(x)) if isinstance(x, enum.IntEnum) else str(x) for x in value]]


def as_text(name: str, fields: list[Any]) -> list[Any]:
    return [name, [str(field) for field in fields]]


@pytest.mark.parametrize("variant", Variant)
def test_messages_become_the_same_frames(variant):
    for name, fields, data in rows("encode", variant):
        values = [ENUMERATIONS.get((name, at), lambda x: x)(field) for at, field in enumerate(fields)]
        message = (getattr(messages, name, None) or getattr(port, name))(*values)
        if data is None:
            with pytest.raises(ValueError, match="got"):
                codec.encode(message, variant)
        else:
            assert codec.encode(message, variant).data.hex() == data, message


@pytest.mark.parametrize("variant", Variant)
def test_commands_become_the_same_frames(variant):
    for arguments, frames in rows("commands", variant):
        *values, enable, clear, counter = arguments
        interface = DataspeedDbw1(variant)
        interface._counter = counter - 1
        command = port.ActuationCommand(*values, port.Gear.DRIVE, enable, clear)
        if frames is None:
            with pytest.raises(ValueError, match="got"):
                interface.encode(command)
        else:
            assert [frame.data.hex() for frame in interface.encode(command)[:3]] == frames, arguments


@pytest.mark.parametrize("variant", Variant)
def test_frames_are_read_as_the_same_messages_and_reports(variant):
    for identifier, data, name, fields, report in rows("decode", variant):
        frame = Frame(identifier, bytes.fromhex(data))
        message = codec.decode(frame, variant)
        if name.endswith("Report"):
            assert type(message).__name__ == name
            assert tuple(message) == pytest.approx(tuple(fields), rel=4e-16, abs=0.0, nan_ok=True), frame
        else:
            assert plain(message) == as_text(name, fields), frame
        read = DataspeedDbw1(variant).decode(frame)
        if report is None:
            assert read == (), frame
        else:
            assert plain(read if isinstance(read, port.Malformed) else read[0]) == as_text(*report), frame
