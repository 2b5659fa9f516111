"""Codec of a Dataspeed DBW1 drive-by-wire controller: values in, CAN frame out, and back.

Both directions: the gateway encodes commands and decodes reports, the simulated vehicle does the reverse.
It knows which field is which signal, and nothing about when or why anything is sent; the DBC files hold the bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle import frame_codec
from vve_sumo.vehicle.dataspeed.layout import (
    BRAKE_COMMAND,
    MESSAGES,
    STEERING_COMMAND,
    THROTTLE_COMMAND,
    OfVariant,
    Variant,
)
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeInfo,
    BrakeReport,
    GearCommand,
    GearReport,
    Message,
    SteeringCommand,
    SteeringReport,
    ThrottleCommand,
    ThrottleReport,
)
from vve_sumo.vehicle.interface import Accelerations, Malformed, WheelSpeeds, YawRate

#: Signals of a message's fields in their order; the message has the name of its class.
_SIGNALS: Final[Mapping[type, str]] = {
    BrakeCommand: "CMD_TYPE PCMD EN COUNT CLEAR",
    ThrottleCommand: "CMD_TYPE PCMD EN COUNT CLEAR",
    SteeringCommand: "SCMD SVEL EN COUNT CLEAR",
    GearCommand: "GCMD CLEAR",
    BrakeReport: "BTYPE? PI PC PO ENABLED BC OVERRIDE DRIVER TMOUT WDCBRK WDCSRC FLTWDC FLT1 FLT2 FLTPWR",
    ThrottleReport: "PI PC PO ENABLED OVERRIDE DRIVER TMOUT WDCSRC FLTWDC FLT1 FLT2 FLTPWR",
    SteeringReport: "ANGLE CMD SPEED TORQUE ENABLED OVERRIDE TMOUT TMODE? FLTWDC FLTBUS1 FLTBUS2 FLTCAL FLTPWR",
    GearReport: "STATE CMD OVERRIDE FLTBUS REJECT",
    WheelSpeeds: "FRONT_LEFT FRONT_RIGHT REAR_LEFT REAR_RIGHT",
    Accelerations: "LONGITUDINAL LATERAL VERTICAL",
    YawRate: "ROLL YAW",
    BrakeInfo: "TORQUE_REQUESTED TORQUE_ACTUAL STATIONARY PARKING_BRAKE OVER_GROUND ABS_ACTIVE STAB_ACTIVE TRAC_ACTIVE",
}
#: Commands that come as a CLEAR alone too, and the signals of each that are not understood, with the reason.
_REFUSED: Final[Mapping[type, Mapping[str, str]]] = {
    BrakeCommand: {"IGNORE": "ignore_bit"},
    ThrottleCommand: {"IGNORE": "ignore_bit"},
    SteeringCommand: {"IGNORE": "ignore_bit", "CMD_TYPE": "torque_mode"},
}
_CLEAR_ALONE: Final = frozenset({BRAKE_COMMAND, THROTTLE_COMMAND, STEERING_COMMAND})


def encode(message: Message, variant: Variant = Variant.DBW1_2024) -> Frame:
    """Return the frame of `message`.

    NaN in a report becomes the field's "invalid" pattern. Raises ValueError for NaN in a command and for a value
    outside its field's stated range: nothing is ever wrapped or clipped.
    """
    return _ENCODERS[variant][type(message)](message)


def decode(frame: Frame, variant: Variant = Variant.DBW1_2024) -> Message | Malformed | None:
    """Return the message in `frame`: None for an unknown identifier, `Malformed` for one without usable content."""
    identifier, data = frame
    known = _DECODERS[variant].get(identifier)
    if known is None:
        return None
    length, unpack, interpret = known
    if len(data) == length:
        message: Message | Malformed = interpret(*unpack(data))
        return message
    if len(data) == 4 and identifier in _CLEAR_ALONE:
        command = interpret(*unpack(data + bytes(4)))
        return command if isinstance(command, Malformed) else command._replace(counter=None)
    return Malformed(identifier, "length")


def encoder(made: type, variant: Variant, case: str = "") -> Callable[[Any], Frame]:
    """Return what encodes messages of a class, or those of one kind, by its name, as tuples without the kind."""
    return frame_codec.encoder(
        MESSAGES[variant][made.__name__], made, _SIGNALS[made], {"wheel_rate": _rate_count}, case
    )


def _rate_count(counts: float) -> int:
    """Round down, but never to zero: zero asks for the DBW controller's largest rate."""
    return int(counts + 1e-9) or 1 if counts > 0.0 else 0


def _encoders(variant: Variant) -> dict[type, Callable[[Any], Frame]]:
    return {made: encoder(made, variant) for made in _SIGNALS}


def _decoders(variant: Variant) -> dict[int, tuple[int, Callable[..., Any], Callable[..., Any]]]:
    """By identifier the length of the data, what takes the counts out of it, and what makes a message of them."""
    decoders: dict[int, tuple[int, Callable[..., Any], Callable[..., Any]]] = {}
    for made, signals in _SIGNALS.items():
        layout = MESSAGES[variant][made.__name__]
        counts, interpret = frame_codec.reading(layout, made, signals, zero=_REFUSED.get(made))
        decoders[layout.id] = counts.size, counts.unpack, interpret
    return decoders


_ENCODERS: Final = OfVariant(_encoders)
_DECODERS: Final = OfVariant(_decoders)
