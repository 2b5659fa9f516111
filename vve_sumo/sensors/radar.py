"""A geometric radar: measures the boxes of the actors from an antenna on the ego's front, once every cycle.

Must not know SUMO, the controller, or an actor's role. Randomness comes from the generator passed in, time from
the tick. A scan comes out some time after it was made, as a real sensor's does. Defaults are the Delphi ESR's where a
source is named, and said to be assumptions where none is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.sensors.echo import Echo, Mount, antenna_at, echoes
from vve_sumo.sensors.falsealarm import false_alarms
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.sensors.random_streams import CorrelatedNoise, stream
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors, Detections, Pose, Vehicle

#: Cycle times are compared as whole microseconds, so that 0.1 + 0.2 never decides when a scan is due.
MICROSECONDS: Final = 1_000_000
#: Cross-section that `detection_probability` is stated for [m2]: a car seen from behind, 10 dBsm.
REFERENCE_CROSS_SECTION: Final = 10.0
#: Actor name of a false alarm; no actor has it.
NO_ACTOR: Final = ""
#: Columns of a scan in the record, one row per detection.
COLUMNS = (
    SensorColumn("range_m", "float", "from the middle of the front bumper to the seen point"),
    SensorColumn("azimuth_rad", "float", "direction of the seen point from the front bumper, left positive"),
    SensorColumn("range_rate_mps", "float", "radial velocity at the antenna, opening positive"),
    SensorColumn("mode", "int8", "0 long range, 1 medium range"),
    SensorColumn("actor", "str", "what was seen: truth that no controller is told"),
)
#: The output until the first scan: empty, dated before every drive.
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
    """Parameters of a radar; a standard deviation or a quantum of 0 leaves the value as it is.

    A shorter range needs no option of its own: for a radar that sees up to 18 m, set the modes' range_max to 18 m.
    Raises ConfigError for values that no radar can have.
    """

    modes: tuple[RadarMode, ...] = ESR_MODES  #: `Detections.mode` is the index of the first one that covers the point
    mount: Mount = _GRILLE  #: of the antenna
    period: float = 0.05  #: cycle [s] (ESR: 50 ms)
    latency: float = 0.09  #: from measuring to a scan's coming out [s] (Denso tracks, measured: docs/radar.md)
    range_sigma: float = 0.25  #: [m] (assumption, within the 0.1 to 0.4 m of long-range radars in 3GPP TR 22.837)
    range_rate_sigma: float = 0.12  #: [m/s] (ESR)
    azimuth_sigma: float = math.radians(0.5)  #: [rad] (assumption: no ESR figure found; Delphi's MRR states 1 deg)
    range_quantum: float = 0.1  #: [m] (ESR track messages, opendbc ESR.dbc)
    range_rate_quantum: float = 0.01  #: [m/s] (ESR track messages)
    azimuth_quantum: float = math.radians(0.1)  #: [rad] (ESR track messages)
    noise_correlation: float = 0.0  #: of errors a period apart (0.45 in the Denso's range rates: docs/radar.md)
    detection_probability: float = 0.9  #: of a 10 m2 target at its mode's range_max (assumption); 1 misses nothing
    false_alarm_probability: float = 1e-6  #: sets the threshold an echo must pass (assumption)
    false_alarms: float = 0.0  #: mean number a scan
    max_targets: int = 64  #: the nearest are kept (ESR: 64)

    def __post_init__(self) -> None:
        if not self.modes:
            raise ConfigError("radar: modes must name at least one mode, got none")
        for name in (*_SIGMAS, *_QUANTA, "latency", "false_alarms", "max_targets"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"radar: {name} must be finite and not negative, got {getattr(self, name)}")
        if not 1e-3 <= self.period < math.inf:
            raise ConfigError(f"radar: period must be at least 0.001 s, got {self.period}")
        if not 0.0 <= self.noise_correlation < 1.0:
            raise ConfigError(f"radar: noise_correlation must be from 0 to below 1, got {self.noise_correlation}")
        if not 0.0 < self.false_alarm_probability < self.detection_probability <= 1.0:
            raise ConfigError(
                "radar: 0 < false_alarm_probability < detection_probability <= 1 must hold, got "
                f"{self.false_alarm_probability} and {self.detection_probability}"
            )

    def ideal(self) -> RadarConfig:
        """The same radar without latency, noise, quantisation, misses or false alarms."""
        return replace(
            self,
            latency=0.0,
            range_sigma=0.0,
            range_rate_sigma=0.0,
            azimuth_sigma=0.0,
            range_quantum=0.0,
            range_rate_quantum=0.0,
            azimuth_quantum=0.0,
            noise_correlation=0.0,
            detection_probability=1.0,
            false_alarms=0.0,
        )


@dataclass(frozen=True, slots=True)
class RadarScan:
    """One cycle's result, with the truth that the record keeps and no controller may see."""

    detections: Detections  #: nearest first, dated when they were measured
    actors: tuple[str, ...]  #: name behind each detection; NOBODY behind a false alarm

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table."""
        seen = self.detections
        return seen.range, seen.azimuth, seen.range_rate, seen.mode, self.actors


#: A detection before it becomes a row: range, azimuth, range rate, mode and name of its actor; sorts nearest first.
_Measurement = tuple[float, float, float, int, str]


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
    """Scans once every period, with the errors of its configuration, and puts each scan out after the latency.

    The generator gives one seed; from it and an actor's name every actor gets a stream of its own, so that the noise
    on one car does not change because another one drives by. False alarms have a stream of their own too.
    """

    def __init__(self, config: RadarConfig, vehicle: Vehicle, generator: np.random.Generator) -> None:
        self._config = config
        self._vehicle = vehicle
        self._sectors = [Sector(mode.range_max, math.tan(mode.half_angle)) for mode in config.modes]
        self._period, self._latency = round(config.period * MICROSECONDS), round(config.latency * MICROSECONDS)
        self._next_due: int | None = None  # the first scan is made at the first step
        self._coming: deque[tuple[int, RadarScan]] = deque()
        self._seed = generator.bytes(32)
        self._luck: dict[str, CorrelatedNoise] = {}
        self._nothing = stream(self._seed, NO_ACTOR)
        self.output = BEFORE_FIRST_SCAN  #: the newest scan that came out
        self.refused = 0  #: rows of `Actors` that this tick's measuring left out: a value in them is not finite

    def step(self, time: float, pose: Pose, actors: Actors) -> RadarScan | None:
        """Measure where a cycle begins, and return the scan that comes out at this tick; None where none does.

        A cycle begins with the first tick at or after each multiple of the period. Its scan is dated at that tick and
        comes out at the first one at or after the end of the latency; of two that are due, the newer. Without a finite
        pose of the rear axle nothing is measured and the cycle stays due: a controller sees this by the age of the last
        scan.
        """
        now, self.refused, out = round(time * MICROSECONDS), 0, None
        if (self._next_due is None or now >= self._next_due) and _finite(pose):
            self._next_due = (now // self._period + 1) * self._period
            self._coming.append((now + self._latency, self._measure(time, now, pose, actors)))
        while self._coming and self._coming[0][0] <= now:
            _, out = self._coming.popleft()
            self.output = out.detections
        return out

    def _measure(self, time: float, now: int, pose: Pose, actors: Actors) -> RadarScan:
        antenna = antenna_at(pose, self._config.mount, self._vehicle)
        seen, self.refused = echoes(antenna, actors, self._sectors)
        found = [*self._measured(now, seen, actors), *self._false_alarms()]
        return _scan(time, sorted(found)[: self._config.max_targets])

    def _measured(self, now: int, seen: Sequence[Echo], actors: Actors) -> Iterator[_Measurement]:
        config, modes, ids = self._config, self._config.modes, actors.ids
        cross_sections = actors.radar_cross_section.tolist()
        for row, distance, direction, speed, mode in seen:
            chance, of_range, of_azimuth, of_rate = self._luck_of(ids[row]).at(now)
            if chance < detection_probability(cross_sections[row], distance, modes[mode], config):
                yield self._reported(
                    distance + config.range_sigma * of_range,
                    direction + config.azimuth_sigma * of_azimuth,
                    speed + config.range_rate_sigma * of_rate,
                    mode,
                    ids[row],
                )

    def _false_alarms(self) -> Iterator[_Measurement]:
        for alarm in false_alarms(self._nothing, self._config.false_alarms, self._sectors):
            yield self._reported(*alarm, NO_ACTOR)

    def _reported(self, range_: float, azimuth: float, range_rate: float, mode: int, name: str) -> _Measurement:
        """Quantise a measurement of the antenna and refer it to the bumper."""
        config = self._config
        reach = max(_quantised(range_, config.range_quantum), 0.0)
        side = _quantised(azimuth, config.azimuth_quantum)
        return *from_bumper(reach, side, config.mount), _quantised(range_rate, config.range_rate_quantum), mode, name

    def _luck_of(self, actor: str) -> CorrelatedNoise:
        luck = self._luck.get(actor)
        if luck is None:
            source = stream(self._seed, actor)
            luck = self._luck[actor] = CorrelatedNoise(source, self._config.noise_correlation, self._period)
        return luck


def _quantised(value: float, quantum: float) -> float:
    return round(value / quantum) * quantum if quantum else value


def from_bumper(range_: float, azimuth: float, mount: Mount) -> tuple[float, float]:
    """Range [m] and azimuth [rad] from the middle of the front bumper of a point that the antenna has at these."""
    direction = azimuth + mount.yaw
    x, y = mount.x + range_ * math.cos(direction), mount.y + range_ * math.sin(direction)
    return math.sqrt(x * x + y * y), math.atan2(y, x)


def _scan(time: float, measured: Sequence[_Measurement]) -> RadarScan:
    ranges, azimuths, range_rates, modes, names = zip(*measured, strict=True) if measured else ((),) * 5
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
    return RadarScan(detections, names)


def _finite(pose: Pose) -> bool:
    return math.isfinite(pose.x + pose.y + pose.heading + pose.speed + pose.lateral_speed + pose.yaw_rate)
