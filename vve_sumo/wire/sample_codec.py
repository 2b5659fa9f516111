"""Packs samples for the way from the drive to the process of the outgoing wires, and unpacks them there.

Both ends are this program's own. Samples are packed as plain numbers and bytes: pickling the classes themselves takes
five times as long, in the part of a tick that the car's command waits for.
"""

from __future__ import annotations

import dataclasses
import pickle
from operator import attrgetter
from typing import Any, Final

import numpy as np

from vve_sumo.values import Actors, Detections, Fix, FixQuality, Point, Pose
from vve_sumo.wire.sample import Sample, SampleContent


def _columns(kind: type[Detections] | type[Actors]) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(kind) if field.name not in ("time", "ids"))


_FIX: Final = attrgetter(*(field.name for field in dataclasses.fields(Fix)))
_POSE: Final = attrgetter(*(field.name for field in dataclasses.fields(Pose)))
_SCAN: Final = attrgetter(*_columns(Detections))
_ACTORS: Final = attrgetter(*_columns(Actors))
_QUALITY: Final = [field.name for field in dataclasses.fields(Fix)].index("quality")
_POINT: Final = [field.name for field in dataclasses.fields(Pose)].index("point")
_NO_COLUMN: Final = np.zeros(0)


def pack(sample: Sample, *, actors: bool) -> bytes:
    """Return a sample as bytes; without `actors`, the actors are left out and arrive as none."""
    if (measured := sample.measured) is None:
        return pickle.dumps((sample.sequence, sample.time, sample.drive_time), pickle.HIGHEST_PROTOCOL)
    fix, pose = list(_FIX(measured.fix)), list(_POSE(measured.pose))
    fix[_QUALITY], pose[_POINT] = measured.fix.quality.value, measured.pose.point.value
    scan, others = _packed(measured.scan), {name: _packed(one) for name, one in measured.others.items()}
    seen = measured.actors
    street = [seen.time, seen.ids, *(column.tobytes() for column in _ACTORS(seen))] if actors else [seen.time, ()]
    row = (sample.sequence, sample.time, sample.drive_time, fix, pose, scan, measured.scan_age, street, others)
    return pickle.dumps(row, pickle.HIGHEST_PROTOCOL)


def unpack(data: bytes) -> Sample:
    """Return the sample that `pack` packed; only for bytes of this program's own drive."""
    # pickle is safe here: only the drive, which the same program started, holds the other end.
    sequence, time, drive_time, *rest = pickle.loads(data)
    if not rest:
        return Sample(sequence, time, drive_time, None)
    fix, pose, scan, scan_age, street, others = rest
    fix[_QUALITY], pose[_POINT] = FixQuality(fix[_QUALITY]), Point(pose[_POINT])
    seen = {name: _scan(one) for name, one in others.items()}
    measured = SampleContent(Fix(*fix), Pose(*pose), _scan(scan), scan_age, _actors(street), seen)
    return Sample(sequence, time, drive_time, measured)


def _packed(scan: Detections) -> list[Any]:
    return [scan.time, *(column.tobytes() for column in _SCAN(scan))]


def _scan(packed: list[Any]) -> Detections:
    *numbers, mode = packed[1:]
    columns = [*_unpacked(numbers), np.frombuffer(mode, np.int8)]
    return Detections(packed[0], *columns)


def _unpacked(columns: list[bytes]) -> list[Any]:
    return [np.frombuffer(column) for column in columns]


def _actors(street: list[Any]) -> Actors:
    time, ids, *columns = street
    if not columns:
        return Actors(time, (), *(_NO_COLUMN for _ in _columns(Actors)))
    return Actors(time, ids, *_unpacked(columns))
