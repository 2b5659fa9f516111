"""Messages between the gateway's process and the other processes of a drive.

It has no socket and no clock, and does not judge content. Encoding cuts texts and lists that are too long.
"""

from __future__ import annotations

import dataclasses
from operator import attrgetter
from typing import Annotated, Any, Final, NamedTuple, get_type_hints

import msgspec

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import FallbackPath, GatewayStatus, Setpoint, resolve_fallback_path
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.fallback import MAX_KNOTS

MAX_TEXT: Final = 255  # characters of a string
MAX_CODES: Final = 64  # strings in a list
# One knot more than a fallback path may have is sent, so that the gateway rejects a path that was too long.
_KNOTS_SENT: Final = MAX_KNOTS + 1
_MAX_INTEGER: Final = (1 << 63) - 1
_Whole = Annotated[int, msgspec.Meta(le=_MAX_INTEGER)]


class Feedback(NamedTuple):
    """The gateway process's message after each of its steps."""

    time: float  #: drive time of the step [s]
    sequence: _Whole  #: of the newest setpoint accepted; -1 for none
    sent: float  #: drive time at which the send of the last command frame returned [s]; NaN for none
    status: GatewayStatus  #: of the step
    measured_steering: float  #: road-wheel angle that the car reports [rad], left positive; NaN not reported
    wheel_speed: float  #: rear axle's speed from the wheels [m/s], forward positive; NaN not reported
    gear: str  #: that the car reports
    steps: _Whole  #: steps so far


#: a fallback path as it is sent; a class that is compiled would lose the options of its `class` line
_Path: Final = msgspec.defstruct(
    "_Path",
    [("spacing", float), ("curvature", Annotated[tuple[float, ...], msgspec.Meta(max_length=_KNOTS_SENT)])],
    array_like=True,
    forbid_unknown_fields=True,
)

_Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]
_NAMES: Final = tuple(field.name for field in dataclasses.fields(Setpoint))
_TYPES: Final[dict[str, Any]] = get_type_hints(Setpoint) | {
    "note": _Text,
    "sequence": _Whole,
    "faults": Annotated[tuple[_Text, ...], msgspec.Meta(max_length=MAX_CODES)],
    "fallback_path": _Path | None,
}
#: a setpoint as it is sent: its fields in their order, the fallback path computed
_SentSetpoint: Final = msgspec.defstruct(
    "_SentSetpoint", [(name, _TYPES[name]) for name in _NAMES], array_like=True, forbid_unknown_fields=True
)
_fields: Final = attrgetter(*_NAMES)
_NOTE, _SEQUENCE, _FAULTS, _PATH = map(_NAMES.index, ("note", "sequence", "faults", "fallback_path"))

_SETPOINT: Final = MessageCodec[Any](MessageKind.SETPOINT, _SentSetpoint)
_COMMAND: Final = MessageCodec[OperatorCommand](MessageKind.OPERATOR_COMMAND, OperatorCommand)
_FEEDBACK: Final = MessageCodec[Feedback](MessageKind.FEEDBACK, Feedback)


def encode_setpoint(setpoint: Setpoint) -> bytes:
    """Return the datagram of a setpoint; note and faults are cut at 255 characters each and 64 faults."""
    values = [*_fields(setpoint)]
    values[_NOTE], values[_FAULTS] = setpoint.note[:MAX_TEXT], _cut(setpoint.faults)
    values[_SEQUENCE] = _whole(setpoint.sequence)
    path = resolve_fallback_path(setpoint.fallback_path)
    values[_PATH] = None if path is None else (path.spacing, path.curvature[:_KNOTS_SENT])
    return _SETPOINT.encode(values)


def decode_setpoint(data: bytes) -> Setpoint | MalformedMessage:
    """Return the setpoint in a datagram, bit for bit as it was sent."""
    sent = _SETPOINT.decode(data)
    if isinstance(sent, MalformedMessage):
        return sent
    values = [*_fields(sent)]
    if (path := values[_PATH]) is not None:
        values[_PATH] = FallbackPath(path.spacing, path.curvature)
    return Setpoint(*values)


def encode_operator_command(command: OperatorCommand) -> bytes:
    """Return the datagram of an operator command."""
    return _COMMAND.encode(command)


def decode_operator_command(data: bytes) -> OperatorCommand | MalformedMessage:
    """Return the operator command in a datagram."""
    return _COMMAND.decode(data)


def encode_feedback(feedback: Feedback) -> bytes:
    """Return the datagram of a feedback; lists of codes are cut at 64, each at 255 characters."""
    status = feedback.status
    reasons, limited = _cut(status.reasons), _cut(status.limited)
    if (reasons, limited) != (status.reasons, status.limited):
        status = dataclasses.replace(status, reasons=reasons, limited=limited)
    sent = feedback._replace(status=status, gear=feedback.gear[:MAX_TEXT], sequence=_whole(feedback.sequence))
    return _FEEDBACK.encode(sent)


def decode_feedback(data: bytes) -> Feedback | MalformedMessage:
    """Return the feedback in a datagram, bit for bit as it was sent."""
    return _FEEDBACK.decode(data)


def _whole(number: int) -> int:
    return min(max(number, -_MAX_INTEGER), _MAX_INTEGER)


def _cut(texts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(text[:MAX_TEXT] for text in texts[:MAX_CODES])
