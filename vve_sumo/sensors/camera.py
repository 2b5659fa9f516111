"""A camera on the ego that reports a list of objects, as a driver assistance camera does.

An object is in the list when enough of it is seen, by the pixels of a mask (`image_mask`): enough rows, and enough of
its own pixels that nothing nearer hides. Its range comes from where it meets the ground in the picture, so that the
error grows with the square of the range; its bearing from its middle. Errors of one object hold on from frame to frame.
Objects are drawn in the slack of the tick. The camera draws from its own generator alone; every actor has a stream.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS, number_of
from vve_sumo.sensors.body_shapes import Blocks, blocks_of, finite_rows
from vve_sumo.sensors.image_mask import CameraPlace, Mask, Pinhole, mask_of
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.sensors.random_streams import CorrelatedNoise, stream
from vve_sumo.sensors.street import LaneBorders, Lanes, Walls
from vve_sumo.values import Actors, CameraObjects, Point, Pose, Vehicle

#: name of the actor behind a false object
NO_ACTOR: Final = ""
#: kinds of which less is known from afar: people and two-wheelers
SMALL: Final = frozenset({"motorcycle", "bicycle", "pedestrian", "child"})
#: of a relative speed, which a camera finds by following the size of an object over about so long [s]: an assumption
SPEED_TIME: Final = 1.0
#: an object that is slower over the ground stands [m/s]
STANDING_SPEED: Final = 0.5
#: an object that comes towards the camera faster than this over the ground is oncoming [m/s]
ONCOMING_SPEED: Final = 1.0
#: Objects have the numbers below it, as those of a driver assistance camera; the false ones have this one.
FALSE_NUMBER: Final = 63
MICROSECONDS: Final = 1_000_000

COLUMNS: Final = (
    SensorColumn("number", "int", "of the object, kept while it is followed"),
    SensorColumn("kind", "int8", f"of the object: {', '.join(f'{n} {kind}' for n, kind in enumerate(BODY_KINDS))}"),
    SensorColumn("status", "int8", "1 standing, 2 stopped after it moved, 3 moving, 4 oncoming"),
    SensorColumn("x_m", "float", "of the middle of its near side, ahead of the front bumper"),
    SensorColumn("y_m", "float", "of the middle of its near side, to the left"),
    SensorColumn("relative_speed_mps", "float", "along the car's axis, opening positive"),
    SensorColumn("width_m", "float", "of the object"),
    SensorColumn("length_m", "float", "of the object: what is usual for its kind"),
    SensorColumn("visible_share", "float", "share of its own pixels that nothing nearer hides: truth for the record"),
    SensorColumn("actor", "str", "name of the actor, empty for a false object: truth for the record"),
)


WIDE: Final = Pinhole(1280, 480, 1312.0)


class Status(enum.IntEnum):
    """How an object moves over the ground."""

    STANDING = 1  #: and has not been seen to move
    STOPPED = 2
    MOVING = 3
    ONCOMING = 4


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """The camera. The defaults are of the order of a driver assistance camera behind the windscreen: assumptions."""

    view: Pinhole = WIDE  #: 52 degrees wide
    rate: float = 15.0  #: frames a second
    latency: float = 0.1  #: from the picture to the list [s]
    x: float = 1.9  #: from the rear axle forward [m]
    y: float = 0.0  #: left [m]
    z: float = 1.3  #: above the ground [m]
    yaw: float = 0.0  #: of the axis [rad], counter-clockwise from the car's forward axis
    range_max: float = 150.0  #: nothing farther is listed [m]
    min_rows: float = 16.0  #: of a vehicle that is listed [pixels]
    min_rows_small: float = 32.0  #: of a person or a two-wheeler that is listed [pixels]
    min_visible: float = 0.4  #: least share of an object's own pixels that is seen
    pixel_sigma: float = 1.0  #: 1 sigma of a place in the picture [pixels]
    noise_correlation: float = 0.9  #: of one object's errors from frame to frame
    miss_rate: float = 0.02  #: share of the frames in which an object that is in sight is not listed
    false_objects: float = 0.0  #: mean number a frame
    forget: float = 0.5  #: after so long out of the list an object gets a new number [s]

    def ideal(self) -> CameraConfig:
        """Return the same camera without noise, misses, false objects and latency."""
        return replace(self, latency=0.0, pixel_sigma=0.0, miss_rate=0.0, false_objects=0.0)


class CameraFrame(NamedTuple):
    """What a camera says of one picture, and the truth beside it."""

    objects: CameraObjects
    visible: Sequence[float]
    names: Sequence[str]

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table."""
        seen = self.objects
        numbers = (seen.number, seen.kind, seen.status)
        places = (seen.x, seen.y, seen.relative_speed, seen.width, seen.length)
        return *numbers, *places, np.array(self.visible, np.float64), tuple(self.names)


class _Object(NamedTuple):
    """A row of the list."""

    number: int
    kind: int
    status: int
    x: float
    y: float
    relative_speed: float
    width: float
    length: float
    visible: float
    name: str


@dataclass(slots=True)
class _Followed:
    """An actor that is or was in the list."""

    number: int
    noise: CorrelatedNoise
    seen_at: float  #: drive time of the last frame in which it was listed [s]
    moved: bool = False  #: whether it was ever seen to move


class _Look(NamedTuple):
    """What the last tick showed."""

    time: float
    pose: Pose
    actors: Actors


class Camera:
    """A camera on the ego. Pass it every tick in order, then call `prepare` in the tick's slack."""

    def __init__(
        self, config: CameraConfig, vehicle: Vehicle, generator: np.random.Generator, walls: Walls, lanes: Lanes
    ) -> None:
        self._config, self._bumper, self._walls, self._lanes = config, vehicle.rear_axle_to_bumper, walls, lanes
        self._seed, self._false = generator.bytes(32), generator
        self._period = round(MICROSECONDS / config.rate)
        self._due = -(2**62)
        self._look: _Look | None = None
        self._waiting: list[tuple[float, CameraFrame]] = []  # frames that are not out yet, with their times
        self._followed: dict[str, _Followed] = {}
        self._free = list(range(FALSE_NUMBER))
        self.output = no_objects(-math.inf)  #: newest list, for the controller
        self.refused = 0  #: actors left out at the last tick because of a value that is not finite

    def step(self, time: float, pose: Pose, actors: Actors) -> CameraFrame | None:
        """Take the ego's pose and the actors at drive time `time` [s]; return the list that comes out, if one does."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"camera: the pose must be the rear axle's, got {pose.point}")
        if not math.isfinite(pose.x + pose.y + pose.heading + pose.speed):
            raise ValueError("camera: the pose is not finite")
        self._look = _Look(time, pose, actors)
        self.refused = len(actors.ids) - len(finite_rows(actors))
        out = None
        while self._waiting and self._waiting[0][0] + self._config.latency <= time + 1e-9:
            out = self._waiting.pop(0)[1]
        if out is not None:
            self.output = out.objects
        return out

    def prepare(self) -> None:
        """Take a picture, where one is due; its list comes out at a later tick."""
        look = self._look
        if look is None:
            return
        now = round(look.time * MICROSECONDS)
        if now < self._due:
            return
        self._due = (now // self._period + 1) * self._period
        self._waiting.append((look.time, self._frame(look)))

    def _frame(self, look: _Look) -> CameraFrame:
        config, pose = self._config, look.pose
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        place = CameraPlace(
            pose.x + config.x * cos - config.y * sin,
            pose.y + config.x * sin + config.y * cos,
            config.z,
            pose.heading + config.yaw,
        )
        blocks = blocks_of(look.actors, finite_rows(look.actors))
        mask = mask_of(config.view, place, blocks, self._walls, config.range_max)
        objects = [*self._seen(look, blocks, mask), *self._false_objects()]
        for name in [name for name, one in self._followed.items() if look.time - one.seen_at > config.forget]:
            self._free.append(self._followed.pop(name).number)
        borders = self._lanes.borders(place.x, place.y, pose.heading)
        return _frame_of(look.time, objects, borders)

    def _seen(self, look: _Look, blocks: Blocks, mask: Mask) -> Iterator[_Object]:
        config, actors = self._config, look.actors
        for actor, (rows, share) in _in_sight(blocks, mask).items():
            kind = BODY_KINDS[actors.kind[actor]]
            enough = config.min_rows_small if kind in SMALL else config.min_rows
            if rows < enough or share < config.min_visible:
                continue
            # Where a side meets the road tells its distance: one beside the camera meets it in no picture.
            if _near_side(look.pose, actors, actor)[0] <= config.x:
                continue
            name = actors.ids[actor]
            followed = self._follow(name)
            if followed is None:
                continue
            chance, of_range, of_bearing, of_speed = followed.noise.at(round(look.time * MICROSECONDS))
            moving = abs(float(actors.speed[actor])) > STANDING_SPEED
            followed.moved |= moving
            if chance >= config.miss_rate:
                followed.seen_at = look.time
                yield self._measured(look, actor, followed, (of_range, of_bearing, of_speed), share)

    def _follow(self, name: str) -> _Followed | None:
        """Return an actor that is followed; None where all numbers are given away."""
        followed = self._followed.get(name)
        if followed is None and self._free:
            noise = CorrelatedNoise(stream(self._seed, name), self._config.noise_correlation, self._period)
            followed = self._followed[name] = _Followed(self._free.pop(0), noise, -math.inf)
        return followed

    def _measured(
        self, look: _Look, actor: int, followed: _Followed, errors: tuple[float, float, float], share: float
    ) -> _Object:
        config, pose, actors = self._config, look.pose, look.actors
        ahead, left = _near_side(pose, actors, actor)
        # The camera measures from its own place: a range along the axis by the ground line, and a bearing.
        ahead, left = ahead - config.x, left - config.y
        sigma = ahead * ahead * config.pixel_sigma / (config.view.focal * config.z)
        measured = max(ahead + sigma * errors[0], 0.0)
        bearing = left / max(ahead, 1e-6) + config.pixel_sigma / config.view.focal * errors[1]
        speed = _relative_speed(pose, actors, actor) + sigma / SPEED_TIME * errors[2]
        kind = int(actors.kind[actor])
        length = _TYPICAL_LENGTH[BODY_KINDS[kind]]
        return _Object(
            followed.number,
            kind,
            _status(pose, actors, actor, followed.moved),
            measured + config.x - self._bumper,
            measured * bearing + config.y,
            speed,
            float(actors.width[actor]),
            length,
            share,
            actors.ids[actor],
        )

    def _false_objects(self) -> Iterator[_Object]:
        """Draw the false objects of a frame: vehicles, as likely at one place of the ground as at the next."""
        config = self._config
        for _ in range(int(self._false.poisson(config.false_objects)) if config.false_objects else 0):
            far, side = self._false.random(2).tolist()
            x = config.range_max * math.sqrt(far)
            y = (2.0 * side - 1.0) * x * math.tan(config.view.half_angle)
            kind = number_of("car")
            yield _Object(FALSE_NUMBER, kind, Status.STANDING, x, y, 0.0, 1.8, _TYPICAL_LENGTH["car"], 0.0, NO_ACTOR)


#: lengths that are reported, because a picture from behind does not show them [m]: assumptions
_TYPICAL_LENGTH: Final[Mapping[str, float]] = {
    "car": 4.5, "van": 5.5, "truck": 9.0, "bus": 12.0, "motorcycle": 2.2, "bicycle": 1.8, "pedestrian": 0.5,
    "child": 0.4,
}  # fmt: skip


def no_objects(time: float) -> CameraObjects:
    """Return a list without objects, on a road without lanes."""
    return _frame_of(time, (), None).objects


def _frame_of(time: float, objects: Sequence[_Object], borders: LaneBorders | None) -> CameraFrame:
    columns = tuple(zip(*objects, strict=True)) if objects else ((),) * len(_Object._fields)
    number, kind, status, x, y, speed, width, length, visible, names = columns
    left, right = (borders.left, borders.right) if borders is not None else (0.0, 0.0)
    listed = CameraObjects(
        time,
        np.array(number, np.int64),
        np.array(kind, np.int8),
        np.array(status, np.int8),
        np.array(x, np.float64),
        np.array(y, np.float64),
        np.array(speed, np.float64),
        np.array(width, np.float64),
        np.array(length, np.float64),
        borders is not None,
        left,
        right,
    )
    return CameraFrame(listed, visible, names)


def _in_sight(blocks: Blocks, mask: Mask) -> dict[int, tuple[int, float]]:
    """Return of each actor that is in the picture how many rows of it are seen, and which share of its own pixels.

    These are the pixels that show it where it is alone.
    """
    parts: dict[int, list[int]] = {}
    for block in mask.drawn:
        parts.setdefault(int(blocks.actor[block]), []).append(block)
    found = {}
    for actor, own in parts.items():
        rows, pixels = np.zeros(mask.block.shape[0], bool), 0
        for block in own:
            seen = mask.visible_pixels(block)
            rows[mask.drawn[block].rows] |= np.logical_or.reduce(seen, axis=1)
            pixels += int(np.count_nonzero(seen))
        if pixels:
            found[actor] = int(np.count_nonzero(rows)), pixels / mask.alone[actor]
    return found


def _near_side(pose: Pose, actors: Actors, actor: int) -> tuple[float, float]:
    """Return the middle of the side of a body that faces the car, ahead of the rear axle and to the left [m]."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    east, north = float(actors.x[actor]) - pose.x, float(actors.y[actor]) - pose.y
    ahead, left = east * cos + north * sin, north * cos - east * sin
    turn = float(actors.heading[actor]) - pose.heading
    half_length, half_width = 0.5 * float(actors.length[actor]), 0.5 * float(actors.width[actor])
    if half_length * abs(math.cos(turn)) >= half_width * abs(math.sin(turn)):
        half, towards = half_length, turn
    else:
        half, towards = half_width, turn + 0.5 * math.pi
    sign = -math.copysign(1.0, math.cos(towards))
    return ahead + sign * half * math.cos(towards), left + sign * half * math.sin(towards)


def _relative_speed(pose: Pose, actors: Actors, actor: int) -> float:
    turn = float(actors.heading[actor]) - pose.heading
    speed, lateral = float(actors.speed[actor]), float(actors.lateral_speed[actor])
    return speed * math.cos(turn) - lateral * math.sin(turn) - pose.speed


def _status(pose: Pose, actors: Actors, actor: int, moved: bool) -> int:
    speed, turn = float(actors.speed[actor]), float(actors.heading[actor]) - pose.heading
    if abs(speed) <= STANDING_SPEED:
        return Status.STOPPED if moved else Status.STANDING
    return Status.ONCOMING if speed * math.cos(turn) < -ONCOMING_SPEED else Status.MOVING
