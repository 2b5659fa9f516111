"""A turning lidar on the ego: which of its rays come back, from where, and when.

A lidar turns clockwise, seen from above, and fires all of its channels one after the other many times a turn. Each ray
leaves at a time of its own: the ego moves on during a turn, and so do the bodies. A turn begins and ends behind the
car, so that no cut runs through what lies ahead. Rays are cast in the slack of the ticks after them, and a turn comes
out at the tick after its last ray. `ray_casting` says what a ray meets. The lidar draws
from its own generator alone.

Whether a ray comes back follows from the received power, which falls with the square of the range and grows with the
reflectivity and the cosine of the incidence of a matt surface (Lambert). What is in the way of the light, such as rain,
is left out, and so is the ego's own body. The ground is flat, and the car stands level on it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.coded_texts import CodedTexts
from vve_sumo.path import Indices
from vve_sumo.sensors.body_shapes import Blocks, blocks_of, finite_rows
from vve_sumo.sensors.port import Column
from vve_sumo.sensors.ray_casting import GROUND, NOTHING, WALL, Channels, Hits, Stretch, at_every_firing, cast
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
#: Rays are cast as soon as so great a share of a turn waits: many at once cost less a ray, all of them much of a slack.
AT_ONCE: Final = 0.5
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
    range_min: float = 0.5  #: nearer surfaces do not come back [m]; more than 0
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


class Returns(NamedTuple):
    """Rays that came back; arrays have an entry a ray."""

    firing: Indices  #: of the turn
    channel: Indices
    range: Floats  #: [m]
    reflectivity: NDArray[np.int8]  #: apparent, percent
    whose: NDArray[np.int32]  #: number of an actor; GROUND or WALL


class LidarScan(NamedTuple):
    """A whole turn: what a controller is handed, and the truth beside it."""

    cloud: PointCloud
    returns: Returns  #: of the turn, in the order of the firings
    names: Sequence[str]  #: of the actors, by their numbers

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table: a row for each ray that came back, in the order of the firings."""
        cloud, (firing, channel, far, reflectivity, whose) = self.cloud, self.returns
        named = np.where(whose >= 0, whose, np.int32(len(self.names)))
        return (
            channel.astype(np.int8),
            cloud.azimuth.take(firing) + cloud.azimuth_offset.take(channel),
            cloud.elevation.take(channel),
            far,
            reflectivity,
            CodedTexts(named, (*self.names, "")),
        )


class _Place(NamedTuple):
    """Where the lidar is and what is around it at a tick."""

    time: float
    x: float
    y: float
    heading: float  #: of the lidar's x axis, unwrapped against the place before
    actors: Actors
    finite: Indices  #: rows of the actors whose every number is finite


class Lidar:
    """A lidar on the ego's roof. Pass it every tick in order, then call `prepare` in the tick's slack."""

    def __init__(self, config: LidarConfig, generator: np.random.Generator, walls: Walls) -> None:
        self._config, self._generator, self._walls = config, generator, walls
        self._near_walls, self._walls_at = walls, (math.inf, math.inf)
        self._before: _Place | None = None
        self._now: _Place | None = None
        # Number of the firing that is next, counted from drive time 0; a rolling start has some before that.
        self._next = -sys.maxsize
        self._turn = _Turn(0)
        spread: Floats = np.arange(len(config.elevations), dtype=np.float64) * config.channel_spread
        self._channels = Channels.of(np.array(config.elevations), spread, config.z, config.range_max)
        # What the ground sends back on each channel never changes.
        ground = self._channels.ground
        self._from_ground = _strength(config, ground.range, GROUND_REFLECTIVITY * ground.cosine)
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
            finite_rows(actors),
        )
        if not math.isfinite(place.x + place.y + heading):
            raise ValueError("lidar: the pose is not finite")
        self._before, self._now = before, place
        self.refused = len(actors.ids) - len(place.finite)

    def prepare(self) -> LidarScan | None:
        """Fire the rays since the tick before; return the turn that they complete, if they complete one."""
        before, now = self._before, self._now
        if before is None or now is None:
            return None
        config, scan = self._config, None
        begin = max(before.time, now.time - LONGEST_GAP)
        first = max(self._next, math.ceil((begin - SAME_TIME) / config.firing_period))
        after = math.ceil((now.time - SAME_TIME) / config.firing_period)
        blocks = blocks_of(now.actors, now.finite)
        while first < after:
            number, end = first // config.steps, min(after, (first // config.steps + 1) * config.steps)
            if self._turn.number != number:
                self._cast(self._turn)  # of a turn that a gap cut short, for what is drawn does not depend on that
                self._turn = _Turn(number)
            self._turn.waiting.append(self._fire(first, end, before, now, blocks))
            if end == (number + 1) * config.steps:
                self._cast(self._turn)
                scan, self._turn = self._turn.scan(config), _Turn(number + 1)
            first = end
        if sum(len(fired.number) for fired in self._turn.waiting) >= AT_ONCE * config.steps:
            self._cast(self._turn)
        self._next = max(after, self._next)
        if scan is not None:
            self.output = scan.cloud
        return scan

    def _fire(self, first: int, after: int, before: _Place, now: _Place, blocks: Blocks) -> _Fired:
        """Return some firings of one turn, numbered from drive time 0 on."""
        config = self._config
        # Of one firing alone there is no step to the next.
        time: Floats = np.arange(first, max(after, first + 2), dtype=np.float64) * config.firing_period
        share: Floats = (time - before.time) / (now.time - before.time)
        x, y = before.x + share * (now.x - before.x), before.y + share * (now.y - before.y)
        heading = before.heading + share * (now.heading - before.heading)
        in_turn = np.arange(len(time)) + first % config.steps
        azimuth: Floats = heading + math.pi + config.step * in_turn
        step = float(azimuth[-1] - azimuth[0]) / (len(azimuth) - 1)
        own = slice(after - first)
        stretch = Stretch(x[own], y[own], (now.time - time)[own], azimuth[own], step, blocks, self._walls_near(now))
        return _Fired(in_turn[own], stretch, now.actors)

    def _cast(self, turn: _Turn) -> None:
        """Cast the rays of a turn that wait for it."""
        if turn.waiting:
            hits = cast(self._channels, [fired.stretch for fired in turn.waiting])
            turn.returns.append(self._returned(hits, turn))
            turn.waiting.clear()

    def _walls_near(self, now: _Place) -> Walls:
        at = self._walls_at
        if not math.hypot(now.x - at[0], now.y - at[1]) < WALL_MARGIN:
            self._near_walls = self._walls.near(now.x, now.y, self._config.range_max + WALL_MARGIN)
            self._walls_at = now.x, now.y
        return self._near_walls

    def _returned(self, hits: Hits, turn: _Turn) -> Returns:
        """Return which of a turn's waiting rays come back, with which range, and from whom."""
        config, channels, what = self._config, len(self._channels.elevation), hits.what.reshape(-1)
        whose, brightness = turn.bodies()
        power, reflectivity = self._echoes(hits, brightness)
        met = np.flatnonzero(what != NOTHING)
        of_power, of_range = self._noise(turn, met)
        far: Floats = hits.range.reshape(-1)[met]
        comes = far >= config.range_min
        if config.drop_out:
            comes &= power[met] + of_power > 0.0
        if config.range_sigma:
            far += of_range
        back = np.flatnonzero(comes)
        ray, far = met[back], far[back]
        if config.range_quantum:
            far = np.rint(far / config.range_quantum) * config.range_quantum
        firing = ray // channels
        far = np.maximum(far, config.range_min)
        return Returns(turn.firings()[firing], ray - firing * channels, far, reflectivity[ray], whose[what[ray]])

    def _echoes(self, hits: Hits, brightness: Floats) -> tuple[Floats, NDArray[np.int8]]:
        """Return power [dB] and reflectivity of every ray as `_strength` does, by the reflectivities of what is met."""
        power, reflectivity = (at_every_firing(column, len(hits.what)).reshape(-1) for column in self._from_ground)
        what = hits.what.reshape(-1)
        upright = np.flatnonzero((what >= 0) | (what == WALL))
        apparent = brightness[what[upright]] * hits.cosine.reshape(-1)[upright]
        power[upright], reflectivity[upright] = _strength(self._config, hits.range.reshape(-1)[upright], apparent)
        return power, reflectivity

    def _noise(self, turn: _Turn, met: Indices) -> tuple[Floats, Floats]:
        """Draw the noise of power [dB] and range [m] of a turn's waiting rays, those that met something.

        It is drawn stretch by stretch, so that it does not depend on how many stretches are cast at once.
        """
        config, draw = self._config, self._generator.standard_normal
        after = len(self._channels.elevation) * np.cumsum([len(fired.number) for fired in turn.waiting])
        power, range_ = [], []
        for count in np.diff(met.searchsorted(after), prepend=0).tolist():
            power.append(draw(count if config.drop_out else 0))
            range_.append(draw(count if config.range_sigma else 0))
        return POWER_SIGMA * np.concatenate(power), config.range_sigma * np.concatenate(range_)


#: what a ray meets that is no body, and its reflectivity: counted from the end, as its number does
_OTHERS: Final = np.array((NOTHING, WALL, GROUND), np.int32)
_OTHER_REFLECTIVITIES: Final = (0.0, WALL_REFLECTIVITY, GROUND_REFLECTIVITY)
_REFLECTIVITIES: Final = np.array([REFLECTIVITY_OF_KIND[kind] for kind in BODY_KINDS])


def _strength(config: LidarConfig, far: Floats, apparent: Floats) -> tuple[Floats, NDArray[np.int8]]:
    """Return power [dB] and reflectivity [percent] of what comes from a range [m] with an apparent reflectivity.

    Half of the rays with 0 dB come back.
    """
    power = 10.0 * np.log10(np.maximum(apparent / DARK, 1e-9)) - 20.0 * np.log10(far / config.range_dark)
    return power, np.maximum(np.round(100.0 * apparent), 1.0).astype(np.int8)


class _Fired(NamedTuple):
    """Firings of a turn between two ticks."""

    number: Indices  #: of each firing in the turn
    stretch: Stretch
    actors: Actors  #: that the stretch's blocks are of


class _Turn:
    """A turn that grows."""

    def __init__(self, number: int) -> None:
        self.number = number  #: counted from drive time 0
        self.waiting: list[_Fired] = []  #: firings whose rays are not cast yet
        self.returns: list[Returns] = []  #: of the others
        self._names: dict[str, int] = {}
        self._ids: tuple[str, ...] = ()  # of the actors that `_numbered` numbers
        self._numbered = np.zeros(0, np.int32)

    def firings(self) -> Indices:
        """Return the numbers of the firings that wait."""
        return np.concatenate([fired.number for fired in self.waiting])

    def bodies(self) -> tuple[NDArray[np.int32], Floats]:
        """Return number and reflectivity of what the waiting rays may meet: of the actor of each block, then others."""
        whose, brightness = [], []
        for _, stretch, actors in self.waiting:
            whose.append(self._numbers(actors.ids)[stretch.blocks.actor])
            brightness.append(_REFLECTIVITIES[actors.kind[stretch.blocks.actor]])
        return np.concatenate((*whose, _OTHERS)), np.concatenate((*brightness, _OTHER_REFLECTIVITIES))

    def _numbers(self, ids: tuple[str, ...]) -> NDArray[np.int32]:
        if ids != self._ids:
            numbers = [self._names.setdefault(name, len(self._names)) for name in ids]
            self._ids, self._numbered = ids, np.array(numbers, np.int32)
        return self._numbered

    def scan(self, config: LidarConfig) -> LidarScan:
        """Return the turn, whose every ray is cast."""
        returns = Returns(*map(np.concatenate, zip(*self.returns, strict=True)))
        shape = config.steps, len(config.elevations)
        range_, reflectivity = np.zeros(shape), np.zeros(shape, np.int8)
        ray = returns.firing * len(config.elevations) + returns.channel
        range_.reshape(-1)[ray], reflectivity.reshape(-1)[ray] = returns.range, returns.reflectivity
        time = ((self.number + 1) * config.steps - 1) * config.firing_period
        return LidarScan(_cloud(config, time, range_, reflectivity), returns, tuple(self._names))


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
