"""Encodes samples for the way from the drive to the process of the outgoing wires."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import Actors
from vve_sumo.wire.sample import Sample

_CODEC: Final = MessageCodec[Sample](MessageKind.OUTPUTS, Sample)


def encode_sample(sample: Sample, *, actors: bool) -> bytes:
    """Return the datagram of a sample; without `actors`, the actors are left out and arrive as none."""
    if (measured := sample.measured) is not None and not actors:
        nobody = Actors.none(measured.actors.time)
        sample = replace(sample, measured=replace(measured, actors=nobody))
    return _CODEC.encode(sample)


def decode_sample(datagram: bytes) -> Sample | MalformedMessage:
    """Return the sample in a datagram."""
    return _CODEC.decode(datagram)
