"""A geometric radar: what an antenna on the ego's front measures of the boxes on the street, once every cycle.

Must not know SUMO, the controller, or what an actor is for. Randomness comes from the generator passed in, time from
the tick. Defaults are the Delphi ESR's where a source is named, and said to be assumptions where none is.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.sensors.echo import Echo, Mount, antenna_at, echoes
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors, Detections, Pose, Vehicle

#: Cycle times are compared as whole microseconds, so that 0.1 + 0.2 never decides when a scan is due.
MICROSECONDS = 1_000_000
#: Cross-section that `detection_probability` is stated for [m2]: a car seen from behind, 10 dBsm.
REFERENCE_CROSS_SECTION = 10.0
#: Draws made at once for an actor: one by one they would cost several times as much.
BLOCK = 8
#: Dated before every drive, and empty: what a controller holds until the first scan.
BEFORE_FIRST_SCAN = Detections(-math.inf, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))


@dataclass(frozen=True, slots=True)
class RadarMode:
    """A field of view, symmetric about the antenna's boresight."""

    range_max: float  #: farthest point seen, from the antenna [m]
    half_angle: float  #: boresight to edge [rad], below pi/2

    def __post_init__(self) -> None:
        if not 0.0 < self.range_max < math.inf:
            raise ConfigError(f"radar mode: range_max must be positive [m], got {self.range_max}")
        if not 0.0 < self.half_angle < 0.5 * math.pi:
            raise ConfigError(f"radar mode: half_angle must lie between 0 and pi/2 [rad], got {self.half_angle}")


#: Delphi ESR: long range 174 m in +-10 deg (as tabulated after de Ponte Mueller, Sensors 17(2) 271, 2017); medium range
#: 60 m in +-45 deg (no public sheet found that states it).
ESR_MODES = (RadarMode(174.0, math.radians(10.0)), RadarMode(60.0, math.radians(45.0)))

_GRILLE = Mount()
_SIGMAS = ("range_sigma", "range_rate_sigma", "azimuth_sigma")
_QUANTA = ("range_quantum", "range_rate_quantum", "azimuth_quantum")


@dataclass(frozen=True, slots=True)
class RadarConfig:
    """What is declared of a radar; a standard deviation or a quantum of 0 leaves the value as it is.

    Shorter sight needs no option of its own: a radar that is blind until 18 m is one whose modes reach 18 m.
    Raises ConfigError for values that no radar can have.
    """

    modes: tuple[RadarMode, ...] = ESR_MODES  #: `Detections.mode` is the index of the first one that covers the point
    mount: Mount = _GRILLE  #: of the antenna
    period: float = 0.05  #: cycle [s] (ESR: 50 ms)
    range_sigma: float = 0.25  #: [m] (assumption, within the 0.1 to 0.4 m of long-range radars in 3GPP TR 22.837)
    range_rate_sigma: float = 0.12  #: [m/s] (ESR)
    azimuth_sigma: float = math.radians(0.5)  #: [rad] (assumption: no ESR figure found; Delphi's MRR states 1 deg)
    range_quantum: float = 0.1  #: [m] (ESR track messages, opendbc ESR.dbc)
    range_rate_quantum: float = 0.01  #: [m/s] (ESR track messages)
    azimuth_quantum: float = math.radians(0.1)  #: [rad] (ESR track messages)
    detection_probability: float = 0.9  #: of a 10 m2 target at its mode's range_max (assumption); 1 misses nothing
    false_alarm_probability: float = 1e-6  #: sets the threshold an echo must pass (assumption); none are generated
    max_targets: int = 64  #: the nearest are kept (ESR: 64)

    def __post_init__(self) -> None:
        if not self.modes:
            raise ConfigError("radar: modes must name at least one mode, got none")
        for name in (*_SIGMAS, *_QUANTA, "max_targets"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"radar: {name} must be finite and not negative, got {getattr(self, name)}")
        if not 1e-3 <= self.period < math.inf:
            raise ConfigError(f"radar: period must be at least 0.001 s, got {self.period}")
        if not 0.0 < self.false_alarm_probability < self.detection_probability <= 1.0:
            raise ConfigError(
                "radar: 0 < false_alarm_probability < detection_probability <= 1 must hold, got "
                f"{self.false_alarm_probability} and {self.detection_probability}"
            )

    def ideal(self) -> RadarConfig:
        """The same radar without noise, quantisation or misses."""
        return replace(
            self,
            range_sigma=0.0,
            range_rate_sigma=0.0,
            azimuth_sigma=0.0,
            range_quantum=0.0,
            range_rate_quantum=0.0,
            azimuth_quantum=0.0,
            detection_probability=1.0,
        )


@dataclass(frozen=True, slots=True)
class Scan:
    """One cycle's result, with the truth that the record keeps and no controller may see."""

    detections: Detections  #: nearest first, as measured
    actor_rows: NDArray[np.intp]  #: row of `Actors` behind each detection
    refused: int  #: rows of `Actors` left out because a value in them is not finite


#: What chance adds to one actor in one scan: uniform in [0, 1), and standard normal for range, azimuth and range rate.
_Draw = tuple[float, float, float, float]


#: A detection before it becomes a row: range, azimuth, range rate, mode and row of its actor; sorts nearest first.
_Measurement = tuple[float, float, float, int, int]


def detection_probability(cross_section: float, range_: float, mode: RadarMode, config: RadarConfig) -> float:
    """Chance that one scan shows a target of a cross-section [m2] at a range from the antenna [m].

    Swerling 1: Pd = Pfa^(1 / (1 + SNR)), SNR falling with the fourth power of range (Richards, "Fundamentals of Radar
    Signal Processing"), scaled so that 10 m2 at the mode's range_max gives `config.detection_probability`.
    """
    if config.detection_probability == 1.0:
        return 1.0
    if cross_section <= 0.0:
        return config.false_alarm_probability
    if range_ <= 0.0:
        return 1.0
    reference = _signal_at_range_max(config.detection_probability, config.false_alarm_probability)
    loss: float = (range_ / mode.range_max) ** 4
    signal = reference * cross_section / REFERENCE_CROSS_SECTION
    return float(config.false_alarm_probability ** (loss / (loss + signal)))


@cache
def _signal_at_range_max(detection_probability: float, false_alarm_probability: float) -> float:
    """Signal-to-noise ratio that gives the first probability where the second sets the threshold."""
    return math.log(false_alarm_probability) / math.log(detection_probability) - 1.0


class Radar:
    """Scans once every period and measures with the noise, quanta and misses of its configuration.

    The generator gives one seed; from it and an actor's name every actor gets a stream of its own, so that the noise
    on one car does not change because another one drives by.
    """

    def __init__(self, config: RadarConfig, vehicle: Vehicle, generator: np.random.Generator) -> None:
        self._config = config
        self._vehicle = vehicle
        self._sectors = [Sector(mode.range_max, math.tan(mode.half_angle)) for mode in config.modes]
        self._period = round(config.period * MICROSECONDS)
        self._next_due = 0
        self._seed = generator.bytes(32)
        self._draws: dict[str, Iterator[_Draw]] = {}

    def due(self, time: float) -> bool:
        """Whether a tick at this drive time [s] is the first at or after the next multiple of the period."""
        return round(time * MICROSECONDS) >= self._next_due

    def step(self, time: float, pose: Pose, actors: Actors) -> Scan | None:
        """The scan dated at this tick, or None where none is due or the rear axle's pose is not finite.

        A scan that cannot be made stays due: the last one grows old, which is what tells a controller.
        """
        if not self.due(time) or not _finite(pose):
            return None
        self._next_due = (round(time * MICROSECONDS) // self._period + 1) * self._period
        antenna = antenna_at(pose, self._config.mount, self._vehicle)
        seen, refused = echoes(antenna, actors, self._sectors)
        nearest = sorted(self._measured(seen, actors))[: self._config.max_targets]
        return _scan(time, nearest, refused)

    def _measured(self, seen: Sequence[Echo], actors: Actors) -> Iterator[_Measurement]:
        config, mount, modes, ids = self._config, self._config.mount, self._config.modes, actors.ids
        range_quantum, azimuth_quantum = config.range_quantum, config.azimuth_quantum
        cross_sections = actors.radar_cross_section.tolist()
        for row, distance, direction, speed, mode in seen:
            chance, of_range, of_azimuth, of_rate = next(self._draws_for(ids[row]))
            if chance < detection_probability(cross_sections[row], distance, modes[mode], config):
                range_ = max(_quantised(distance + config.range_sigma * of_range, range_quantum), 0.0)
                azimuth = _quantised(direction + config.azimuth_sigma * of_azimuth, azimuth_quantum)
                range_rate = _quantised(speed + config.range_rate_sigma * of_rate, config.range_rate_quantum)
                yield *from_bumper(range_, azimuth, mount), range_rate, mode, row

    def _draws_for(self, actor: str) -> Iterator[_Draw]:
        draws = self._draws.get(actor)
        if draws is None:
            draws = self._draws[actor] = _draws(self._seed, actor)
        return draws


class _NamedSeed(ISeedSequence):
    """The state of a stream from the drive's seed and an actor's name; a fraction of the cost of a SeedSequence."""

    def __init__(self, seed: bytes, name: str) -> None:
        self._digest = hashlib.blake2b(name.encode(), key=seed).digest()

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        """The first words of the digest, the same on machines of either byte order."""
        return np.frombuffer(self._digest, "<u8", n_words).astype(dtype)


def _draws(seed: bytes, actor: str) -> Iterator[_Draw]:
    """An actor's own endless stream of draws, one for every scan that sees it."""
    # numpy's own stubs know no seed but SeedSequence; at run time its interface suffices.
    stream = np.random.Generator(np.random.PCG64(_NamedSeed(seed, actor)))  # type: ignore[arg-type]
    while True:
        yield from zip(stream.random(BLOCK).tolist(), *stream.standard_normal((3, BLOCK)).tolist(), strict=True)


def _quantised(value: float, quantum: float) -> float:
    return round(value / quantum) * quantum if quantum else value


def from_bumper(range_: float, azimuth: float, mount: Mount) -> tuple[float, float]:
    """Range [m] and azimuth [rad] from the middle of the front bumper of a point that the antenna has at these."""
    direction = azimuth + mount.yaw
    x, y = mount.x + range_ * math.cos(direction), mount.y + range_ * math.sin(direction)
    return math.sqrt(x * x + y * y), math.atan2(y, x)


def _scan(time: float, measured: Sequence[_Measurement], refused: int) -> Scan:
    ranges, azimuths, range_rates, modes, rows = zip(*measured, strict=True) if measured else ((),) * 5
    detections = Detections(
        time,
        np.array(ranges, np.float64),
        np.array(azimuths, np.float64),
        np.array(range_rates, np.float64),
        np.array(modes, np.int8),
    )
    # The record holds the arrays that the controller is given.
    for column in (detections.range, detections.azimuth, detections.range_rate, detections.mode):
        column.setflags(write=False)
    return Scan(detections, np.array(rows, np.intp), refused)


def _finite(pose: Pose) -> bool:
    return math.isfinite(pose.x + pose.y + pose.heading + pose.speed + pose.lateral_speed + pose.yaw_rate)
