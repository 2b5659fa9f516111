"""Encodes the list of objects of a camera as the obstacle frames of a Mobileye on CAN.

It knows frames and objects; it must not know which bus they travel on. `mobileye.dbc` is the layout: that of Apollo's
public parser (modules/drivers/mobileye, Apache-2.0), whose test vectors are among the tests. What the frames also have
room for and no virtual camera knows (blinkers, brake lights, cutting in, a matched radar's track, how angle and size
change, acceleration) is sent as 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from vve_sumo import dbc
from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.values import CameraObjects, Frame

_LAYOUTS: Final = dbc.read(Path(__file__).with_name("mobileye.dbc"))
_STATUS, _A, _B, _C = (_LAYOUTS[name] for name in ("Status", "ObstacleA", "ObstacleB", "ObstacleC"))
STATUS, OBSTACLE_A, OBSTACLE_B, OBSTACLE_C = _STATUS.id, _A.id, _B.id, _C.id
#: between the identifiers of two obstacles
STEP: Final = 3
#: identifiers end at 0x756
MAX_OBSTACLES: Final = 10
#: of the camera's own failure, in the status frame: an assumption, any number but 0 is one
FAILED: Final = 1
#: counts of a frame's age
OLDEST: Final = 255


class ObstacleType(IntEnum):
    """What an obstacle is."""

    VEHICLE = 0
    TRUCK = 1
    MOTORCYCLE = 2
    PEDESTRIAN = 3
    BICYCLE = 4


class ObstacleStatus(IntEnum):
    """How an obstacle moves over the ground."""

    UNDEFINED = 0
    STANDING = 1
    STOPPED = 2
    MOVING = 3
    ONCOMING = 4
    PARKED = 5


class Lane(IntEnum):
    """In which lane an obstacle is."""

    NOT_ASSIGNED = 0
    OWN = 1
    NEXT = 2
    INVALID = 3


TYPES: Final = {
    "car": ObstacleType.VEHICLE,
    "van": ObstacleType.VEHICLE,
    "truck": ObstacleType.TRUCK,
    "bus": ObstacleType.TRUCK,
    "motorcycle": ObstacleType.MOTORCYCLE,
    "bicycle": ObstacleType.BICYCLE,
    "pedestrian": ObstacleType.PEDESTRIAN,
    "child": ObstacleType.PEDESTRIAN,
}


class MobileyeEncoder:
    """Packs lists; it counts for how many lists each object has been followed."""

    def __init__(self) -> None:
        self._ages: dict[int, int] = {}

    def encode(self, listed: CameraObjects | None, time: float) -> tuple[Frame, ...]:
        """Return the frames of a list at a GNSS second, nearest objects first; of None those of a failed camera.

        A value beyond what its signal carries saturates. Raises ValueError for a number that is not finite.
        """
        stamp = round(1000.0 * time) % 256
        if listed is None:
            self._ages.clear()
            return (Frame(STATUS, _STATUS.encode(NUMBER_OF_OBSTACLES=0, TIMESTAMP=stamp, FAILSAFE=FAILED)),)
        rows = np.argsort(np.hypot(listed.x, listed.y), kind="stable")[:MAX_OBSTACLES].tolist()
        numbers = [int(listed.number[row]) for row in rows]
        self._ages = {number: min(self._ages.get(number, 0) + 1, OLDEST) for number in numbers}
        status = _STATUS.encode(NUMBER_OF_OBSTACLES=len(rows), TIMESTAMP=stamp)
        frames = [Frame(STATUS, status)]
        closest = _closest_in_path(listed, rows)
        for place, row in enumerate(rows):
            frames += self._frames(listed, row, STEP * place, closest=row == closest)
        return tuple(frames)

    def _frames(self, listed: CameraObjects, row: int, shift: int, *, closest: bool) -> tuple[Frame, ...]:
        number, x, y = int(listed.number[row]), float(listed.x[row]), float(listed.y[row])
        age = self._ages[number]
        a = _A.encode(
            ID=number,
            POSITION_X=x,
            POSITION_Y=y,
            RELATIVE_SPEED=float(listed.relative_speed[row]),
            TYPE=TYPES[BODY_KINDS[listed.kind[row]]],
            STATUS=int(listed.status[row]),
            VALID=1 if age == 1 else 2,
        )
        b = _B.encode(
            LENGTH=float(listed.length[row]),
            WIDTH=float(listed.width[row]),
            AGE=age,
            LANE=_lane(listed, row),
            CLOSEST_IN_PATH=closest,
        )
        c = _C.encode(ANGLE=math.degrees(math.atan2(y, max(x, 1e-3))))
        return Frame(OBSTACLE_A + shift, a), Frame(OBSTACLE_B + shift, b), Frame(OBSTACLE_C + shift, c)


class CameraStatus(NamedTuple):
    """What the status frame says, with which a list begins."""

    obstacles: int  #: in the list
    stamp: int  #: of the list, milliseconds modulo 256
    failed: bool


class Obstacle(NamedTuple):
    """What an obstacle's first frame says."""

    number: int  #: kept while it is followed
    x: float  #: ahead of the front bumper [m]
    y: float  #: left of the car's axis [m]
    relative_speed: float  #: along the car's axis [m/s], opening positive
    kind: int  #: `ObstacleType`
    status: int  #: `ObstacleStatus`


def decode_status(frame: Frame) -> CameraStatus | None:
    """Return what the status frame says; None for another frame, and for one of another length."""
    if frame.id != STATUS or len(frame.data) != 8:
        return None
    read = _STATUS.decode(frame.data)
    return CameraStatus(int(read["NUMBER_OF_OBSTACLES"]), int(read["TIMESTAMP"]), read["FAILSAFE"] != 0.0)


def decode_obstacle(frame: Frame) -> Obstacle | None:
    """Return what the first of an obstacle's frames says; None for another frame, and for one that is not valid."""
    place, rest = divmod(frame.id - OBSTACLE_A, STEP)
    if rest or not 0 <= place < MAX_OBSTACLES or len(frame.data) != 8:
        return None
    read = _A.decode(frame.data)
    if not read["VALID"]:
        return None
    where = read["POSITION_X"], read["POSITION_Y"], read["RELATIVE_SPEED"]
    return Obstacle(int(read["ID"]), *where, int(read["TYPE"]), int(read["STATUS"]))


def with_failure(frame: Frame) -> Frame:
    """Return a frame of which the status says that the camera has failed; every other one is left as it is."""
    return frame._replace(data=_STATUS.altered(frame.data, FAILSAFE=FAILED)) if frame.id == STATUS else frame


def _lane(listed: CameraObjects, row: int) -> Lane:
    """Return the lane of an object, by the borders at the car: of a bend ahead a camera's list says nothing."""
    if not listed.lane_known:
        return Lane.NOT_ASSIGNED
    return Lane.OWN if -listed.lane_right <= listed.y[row] <= listed.lane_left else Lane.NEXT


def _closest_in_path(listed: CameraObjects, rows: Sequence[int]) -> int | None:
    """Return the nearest object in the car's own lane."""
    own = [row for row in rows if _lane(listed, row) is Lane.OWN and listed.x[row] > 0.0]
    return min(own, key=lambda row: float(listed.x[row]), default=None)
