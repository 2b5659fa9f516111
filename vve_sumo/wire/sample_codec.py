"""Encodes samples for the way from the drive to the process of the outgoing wires."""

from __future__ import annotations

from typing import Final

import numpy as np

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import Actors
from vve_sumo.wire.sample import Sample, SampleContent

_CODEC: Final = MessageCodec[Sample](MessageKind.OUTPUTS, Sample)
_NO_COLUMNS: Final = [np.zeros(0) for _ in range(8)]


def encode_sample(sample: Sample, *, actors: bool) -> bytes:
    """Return the datagram of a sample; without `actors`, the actors are left out and arrive as none."""
    if (measured := sample.measured) is not None and not actors:
        nobody = Actors(measured.actors.time, (), *_NO_COLUMNS)
        left = SampleContent(measured.fix, measured.pose, measured.scan, measured.scan_age, nobody, measured.others)
        sample = Sample(sample.sequence, sample.time, sample.drive_time, left)
    return _CODEC.encode(sample)


def decode_sample(datagram: bytes) -> Sample | MalformedMessage:
    """Return the sample in a datagram."""
    return _CODEC.decode(datagram)
