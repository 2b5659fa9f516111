"""Codec of this project's own account of a tick: where the ego is, who is around it, what the gateway and faults say.

It is the truth of the virtual road, which no sensor gives: for bridges that show a drive, never for a brain that is to
be tested. Knows values and bytes; it must not know sockets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import Actors, Pose
from vve_sumo.wire.sample import Sample


@dataclass(frozen=True, slots=True)
class Scene:
    """One tick of a drive."""

    sequence: int  #: `sequence_of` its tick
    time: float  #: GNSS time [s since 1980-01-06, no leap seconds]
    state: str  #: of the gateway, as the drive knew it last; empty before that
    faults: tuple[str, ...]  #: reason codes of the tick
    pose: Pose | None  #: of the rear axle on the virtual road; None while the outputs are invalid
    actors: Actors  #: on the virtual road; none while the outputs are invalid


_CODEC: Final = MessageCodec[Scene](MessageKind.SCENE, Scene)


def encode_scene(sample: Sample) -> bytes:
    """Return the datagram of a sample."""
    measured = sample.measured
    pose = None if measured is None else measured.pose
    actors = Actors.none(sample.drive_time) if measured is None else measured.actors
    return _CODEC.encode(Scene(sample.sequence, sample.time, sample.state, sample.faults, pose, actors))


def decode_scene(datagram: bytes) -> Scene | MalformedMessage:
    """Return the scene in a datagram, or why it is none."""
    return _CODEC.decode(datagram)
