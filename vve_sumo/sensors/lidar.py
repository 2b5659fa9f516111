"""A turning lidar on the ego: which of its rays come back, from where, and when.

A lidar turns clockwise, seen from above, and fires all of its channels one after the other many times a turn. Each ray
leaves at a time of its own: the ego moves on during a turn, and so do the bodies. A turn begins and ends behind the
car, so that no cut runs through what lies ahead. The rays between two ticks are cast after the second one, in the slack
of the tick, and a turn comes out at the tick after its last ray. `ray_casting` says what a ray meets. The lidar draws
from its own generator alone.

Whether a ray comes back follows from the received power, which falls with the square of the range and grows with the
reflectivity and the cosine of the incidence of a matt surface (Lambert). What is in the way of the light, such as rain,
is left out, and so is the ego's own body. The ground is flat, and the car stands level on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.sensors.body_shapes import Blocks, blocks_of, finite_rows
from vve_sumo.sensors.port import Column
from vve_sumo.sensors.ray_casting import GROUND, NOTHING, WALL, Firings, Hits, cast
from vve_sumo.sensors.street import Walls
from vve_sumo.values import Actors, Floats, Point, PointCloud, Pose

#: Diffuse reflectivities at 905 nm. Assumptions of the usual order of magnitude: asphalt 0.1 to 0.2, painted metal,
#: cloth and masonry 0.2 to 0.5.
REFLECTIVITY_OF_KIND: Final = dict.fromkeys(BODY_KINDS, 0.3) | {"bicycle": 0.2, "motorcycle": 0.25}
GROUND_REFLECTIVITY: Final = 0.15
WALL_REFLECTIVITY: Final = 0.35
#: the reflectivity for which a lidar's range is stated
DARK: Final = 0.1
#: of the received power from ray to ray, in decibels: an assumption
POWER_SIGMA: Final = 1.5
#: Walls that come no nearer than this beyond the range are left out until the car has gone as far [m].
WALL_MARGIN: Final = 20.0
#: the longest time between two ticks whose rays are cast [s]: a longer gap leaves a part of the turn dark
LONGEST_GAP: Final = 0.1
#: two times that are closer are the same [s]
SAME_TIME: Final = 1e-9


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """The lidar. The defaults are a Velodyne VLP-16 in the middle of the roof (user manual 63-9243, rev. E)."""

    #: of the channels in the order in which they fire [rad]
    elevations: tuple[float, ...] = tuple(math.radians(angle) for low in range(-15, 0, 2) for angle in (low, low + 16))
    rate: float = 10.0  #: turns a second
    steps: int = 1800  #: firings a turn
    channel_spread: float = 1.0 / 24.0  #: from one channel's ray to the next, in shares of the step between firings
    x: float = 1.4  #: from the rear axle forward [m]
    y: float = 0.0  #: left [m]
    z: float = 1.9  #: above the ground [m]
    yaw: float = 0.0  #: of the lidar's x axis [rad], counter-clockwise from the car's forward axis
    range_min: float = 0.5  #: nearer surfaces do not come back [m]
    range_max: float = 100.0  #: farther ones do not, either [m]
    range_dark: float = 60.0  #: at which half of the rays come back from a surface of a tenth, met squarely [m]
    range_sigma: float = 0.015  #: 1 sigma of the range [m]; the manual says +-3 cm "typical"
    range_quantum: float = 0.002  #: of the range [m]
    drop_out: bool = True  #: whether weak rays are lost

    @property
    def firing_period(self) -> float:
        """Time from one firing to the next [s]."""
        return 1.0 / (self.rate * self.steps)

    def ideal(self) -> LidarConfig:
        """Return the same lidar without noise, quantum or lost rays."""
        return replace(self, range_sigma=0.0, range_quantum=0.0, drop_out=False)

    @property
    def step(self) -> float:
        """Angle from one firing to the next [rad]: negative, because the lidar turns clockwise."""
        return -math.tau / self.steps


class LidarScan(NamedTuple):
    """A whole turn: what a controller is handed, and the truth beside it."""

    cloud: PointCloud
    what: NDArray[np.int32]  #: firings by channels: row of `names`, GROUND, WALL or NOTHING
    names: Sequence[str]

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table: a row for each ray that came back, in the order of the firings."""
        cloud = self.cloud
        firing, channel = np.nonzero(cloud.range > 0.0)
        named = np.array([*self.names, "", "", ""], object)
        return (
            channel.astype(np.int8),
            cloud.azimuth[firing] + cloud.azimuth_offset[channel],
            cloud.elevation[channel],
            cloud.range[firing, channel],
            cloud.reflectivity[firing, channel],
            tuple(named[self.what[firing, channel]].tolist()),
        )


class _Place(NamedTuple):
    """Where the lidar is and what is around it at a tick."""

    time: float
    x: float
    y: float
    heading: float  #: of the lidar's x axis, unwrapped against the place before
    actors: Actors


class Lidar:
    """A lidar on the ego's roof. Pass it every tick in order, then call `prepare` in the tick's slack."""

    def __init__(self, config: LidarConfig, generator: np.random.Generator, walls: Walls) -> None:
        self._config, self._generator, self._walls = config, generator, walls
        self._near_walls, self._walls_at = walls, (math.inf, math.inf)
        self._before: _Place | None = None
        self._now: _Place | None = None
        self._next = 0  # number of the firing that is next, counted from drive time 0
        self._turn: _Turn | None = None
        self._elevation = np.array(config.elevations)
        self._spread: Floats = np.arange(len(config.elevations), dtype=np.float64) * config.channel_spread
        self.output = empty_cloud(config)  #: newest turn, for the controller
        self.refused = 0  #: actors left out at the last tick because of a value that is not finite

    def step(self, time: float, pose: Pose, actors: Actors) -> None:
        """Take the ego's pose and the actors at drive time `time` [s]; what they mean comes out of `prepare`."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"lidar: the pose must be the rear axle's, got {pose.point}")
        config, before = self._config, self._now
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        heading = pose.heading + config.yaw
        if before is not None:
            heading = before.heading + math.remainder(heading - before.heading, math.tau)
        place = _Place(
            time,
            pose.x + config.x * cos - config.y * sin,
            pose.y + config.x * sin + config.y * cos,
            heading,
            actors,
        )
        if not math.isfinite(place.x + place.y + heading):
            raise ValueError("lidar: the pose is not finite")
        self._before, self._now = before, place
        self.refused = len(actors.ids) - len(finite_rows(actors))

    def prepare(self) -> LidarScan | None:
        """Cast the rays since the tick before; return the turn that they complete, if they complete one."""
        before, now = self._before, self._now
        if before is None or now is None:
            return None
        config, scan = self._config, None
        begin = max(before.time, now.time - LONGEST_GAP)
        first = max(self._next, math.ceil((begin - SAME_TIME) / config.firing_period))
        after = math.ceil((now.time - SAME_TIME) / config.firing_period)
        rows = finite_rows(now.actors)
        blocks = blocks_of(now.actors, rows)
        while first < after:
            turn, end = first // config.steps, min(after, (first // config.steps + 1) * config.steps)
            if self._turn is None or self._turn.number != turn:
                self._turn = _Turn(turn, config)
            self._fire(self._turn, first, end, before, now, blocks)
            if end == (turn + 1) * config.steps:
                scan, self._turn = self._turn.scan(), None
            first = end
        self._next = max(after, self._next)
        if scan is not None:
            self.output = scan.cloud
        return scan

    def _fire(self, turn: _Turn, first: int, after: int, before: _Place, now: _Place, blocks: Blocks) -> None:
        """Cast the rays of some firings of one turn."""
        config = self._config
        time: Floats = np.arange(first, max(after, first + 2), dtype=np.float64) * config.firing_period
        share: Floats = (time - before.time) / (now.time - before.time)
        x, y = before.x + share * (now.x - before.x), before.y + share * (now.y - before.y)
        heading = before.heading + share * (now.heading - before.heading)
        in_turn = np.arange(len(time)) + (first - turn.number * config.steps)
        azimuth: Floats = heading + math.pi + config.step * in_turn
        firings = Firings(x, y, config.z, now.time - time, azimuth, self._spread, self._elevation)
        hits = cast(firings, blocks, self._walls_near(now), config.range_max).first(after - first)
        rows = slice(int(in_turn[0]), int(in_turn[0]) + after - first)
        turn.take(rows, self._returned(hits, blocks, now.actors), now.actors)

    def _walls_near(self, now: _Place) -> Walls:
        at = self._walls_at
        if not math.hypot(now.x - at[0], now.y - at[1]) < WALL_MARGIN:
            self._near_walls = self._walls.near(now.x, now.y, self._config.range_max + WALL_MARGIN)
            self._walls_at = now.x, now.y
        return self._near_walls

    def _returned(self, hits: Hits, blocks: Blocks, actors: Actors) -> _Returned:
        """Return which rays come back, with which range, and from whom."""
        config, generator = self._config, self._generator
        met = np.nonzero(hits.what != NOTHING)
        far, what, cosine = hits.range[met], hits.what[met], hits.cosine[met]
        kinds = actors.kind[blocks.actor]
        brightness = np.concatenate((_REFLECTIVITIES[kinds], _OTHER_REFLECTIVITIES))[what]
        back = far >= config.range_min
        if config.drop_out:
            power = 10.0 * np.log10(np.maximum(brightness * cosine / DARK, 1e-9))
            power -= 20.0 * np.log10(far / config.range_dark)
            back &= power + POWER_SIGMA * generator.standard_normal(len(far)) > 0.0
        noisy = far + config.range_sigma * generator.standard_normal(len(far)) if config.range_sigma else far
        noisy = np.round(noisy / config.range_quantum) * config.range_quantum if config.range_quantum else noisy
        range_ = np.zeros(hits.range.shape)
        reflectivity = np.zeros(hits.range.shape, np.int8)
        whose = np.full(hits.range.shape, NOTHING, np.int32)
        owner = np.concatenate((blocks.actor, _OTHERS))[what]
        place = met[0][back], met[1][back]
        range_[place] = np.maximum(noisy[back], config.range_min)
        reflectivity[place] = np.maximum(np.round(100.0 * (brightness * cosine)[back]), 1.0).astype(np.int8)
        whose[place] = owner[back]
        return _Returned(range_, reflectivity, whose)


#: what a ray meets that is no body, and its reflectivity: counted from the end, as its number does
_OTHERS: Final = (NOTHING, WALL, GROUND)
_OTHER_REFLECTIVITIES: Final = (0.0, WALL_REFLECTIVITY, GROUND_REFLECTIVITY)
_REFLECTIVITIES: Final = np.array([REFLECTIVITY_OF_KIND[kind] for kind in BODY_KINDS])


class _Returned(NamedTuple):
    """What came back of some firings; arrays are firings by channels."""

    range: Floats  #: [m]; 0 where nothing came back
    reflectivity: NDArray[np.int8]  #: apparent, percent
    whose: NDArray[np.int32]  #: row of the actors; GROUND, WALL or NOTHING


class _Turn:
    """A turn that grows."""

    def __init__(self, number: int, config: LidarConfig) -> None:
        shape = config.steps, len(config.elevations)
        self.number, self._config = number, config
        self._range, self._reflectivity = np.zeros(shape), np.zeros(shape, np.int8)
        self._what = np.full(shape, NOTHING, np.int32)
        self._names: dict[str, int] = {}

    def take(self, rows: slice, returned: _Returned, actors: Actors) -> None:
        """Take what came back of some firings."""
        self._range[rows], self._reflectivity[rows] = returned.range, returned.reflectivity
        numbers = np.array([self._names.setdefault(name, len(self._names)) for name in actors.ids] or [0], np.int32)
        whose = returned.whose
        self._what[rows] = np.where(whose >= 0, numbers[np.maximum(whose, 0)], whose)

    def scan(self) -> LidarScan:
        """Return the turn."""
        config = self._config
        time = ((self.number + 1) * config.steps - 1) * config.firing_period
        return LidarScan(_cloud(config, time, self._range, self._reflectivity), self._what, tuple(self._names))


def empty_cloud(config: LidarConfig) -> PointCloud:
    """Return what a lidar says before its first turn."""
    shape = 0, len(config.elevations)
    return _cloud(config, -math.inf, np.zeros(shape), np.zeros(shape, np.int8))


def _cloud(config: LidarConfig, time: float, range_: Floats, reflectivity: NDArray[np.int8]) -> PointCloud:
    """Return a turn whose last firing was at a drive time [s]; its first one looks behind the car."""
    firing, channel = (np.arange(count, dtype=np.float64) for count in (len(range_), len(config.elevations)))
    azimuth: Floats = math.pi + config.step * firing
    offset: Floats = channel * (config.channel_spread * config.step)
    age: Floats = (firing - (len(range_) - 1)) * config.firing_period
    return PointCloud(time, azimuth, offset, np.array(config.elevations), age, range_, reflectivity)
