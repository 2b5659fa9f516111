"""A V2X receiver on the ego: what the messages of vehicles, people and cyclists tell it.

Every actor with a radio is a station: it finds its own place with the errors of its receiver, sends its messages by the
standards' rules (`v2x_senders`) and is heard or not by what is in between (`radio`). What is heard comes out after a
latency, rounded as the message has it; the last message of every station stays until it is too old. All of this is done
in the slack of the tick. Every station has a random stream of its own.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import MapFrame
from vve_sumo.sensors.body_shapes import finite_rows
from vve_sumo.sensors.perception import Perceiver, Sector, Surroundings
from vve_sumo.sensors.radio import Antenna, Fading, Obstacles, antenna_of, received_power
from vve_sumo.sensors.random_streams import CorrelatedNoise, stream
from vve_sumo.sensors.street import Walls
from vve_sumo.sensors.v2x_messages import HeardMessage, Memory, V2xReading, seen_from
from vve_sumo.sensors.v2x_senders import MICROSECONDS, VULNERABLE, Check, Composer, Sender, check_of
from vve_sumo.v2x.events import EventTrigger
from vve_sumo.v2x.triggering import CHECK_PERIOD, CamTrigger, VamTrigger
from vve_sumo.values import Actors, Point, Pose, Stations, Vehicle

#: of the errors of a station's place and speed from one second to the next
ERROR_CORRELATION: Final = 0.9
#: at least so often an output comes out, also where nothing is heard [s]
HEARTBEAT: Final = 0.5
SECTOR: Final = Sector()


@dataclass(frozen=True, slots=True)
class V2xConfig:
    """The receiver and the stations around it. The defaults are assumptions of the usual order."""

    equipped: float = 1.0  #: share of the vehicles that send
    equipped_vulnerable: float = 1.0  #: share of the people and bicycles that send
    latency: float = 0.05  #: from the time that a message tells of to its coming out [s]
    longest_cam_interval: float = 1.0  #: between two CAMs of a vehicle [s]
    power: float = 23.0  #: radiated, gains included [dBm]
    sensitivity: float = -82.0  #: least power at which a packet is received [dBm]
    loss: float = 0.02  #: share of the packets that others' drown
    jammed_from: float = math.inf  #: drive time from which on no packet is received [s]
    x: float = 1.0  #: of the antenna from the rear axle forward [m]
    y: float = 0.0  #: of the antenna to the left [m]
    z: float = 1.5  #: of the antenna above the ground [m]
    position_sigma: float = 0.5  #: of a vehicle's own place, on each axis [m]
    position_sigma_vulnerable: float = 1.5  #: of a person's or a cyclist's own place, on each axis [m]
    speed_sigma: float = 0.1  #: of a station's own speed [m/s]
    warnings: bool = False  #: vehicles that send also warn of what happens to them
    hazard_lights: frozenset[str] = frozenset()  #: names of the actors whose hazard lights are on
    perceiving: float = 0.0  #: share of the vehicles that send which also tell of what they perceive
    sector: Sector = SECTOR  #: in which they perceive

    @property
    def more(self) -> bool:
        """Whether more is sent than awareness messages."""
        return self.warnings or self.perceiving > 0.0

    def ideal(self) -> V2xConfig:
        """Return the same where everybody sends, every packet comes and no station errs; the others are as they are."""
        return replace(
            self,
            equipped=1.0,
            equipped_vulnerable=1.0,
            sensitivity=-math.inf,
            loss=0.0,
            position_sigma=0.0,
            position_sigma_vulnerable=0.0,
            speed_sigma=0.0,
            sector=replace(self.sector, sigma=0.0),
        )


#: returns what a receiver reads of a packet, by the power with which it came [dBm]
ReadPacket: TypeAlias = Callable[[float], Sequence[HeardMessage]]


@dataclass(slots=True)
class _Station:
    """A sender, and how it is heard."""

    sender: Sender
    fading: Fading
    chance: np.random.Generator
    next_check: int  # [us]


_NOWHERE: Final = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class _Look(NamedTuple):
    """What the last tick showed."""

    time: float
    pose: Pose
    actors: Actors


class V2xReceiver:
    """A receiver on the ego. Pass it every tick in order, then call `prepare` in the tick's slack."""

    def __init__(
        self, config: V2xConfig, vehicle: Vehicle, generator: np.random.Generator, walls: Walls, frame: MapFrame
    ) -> None:
        """`frame` is that of the map, in which stations say where they are."""
        self._config, self._vehicle, self._walls = config, vehicle, walls
        self._composer, self._bumper = Composer(frame), vehicle.rear_axle_to_bumper
        self._seed = generator.bytes(32)
        self._look: _Look | None = None
        self._stations: dict[str, _Station | None] = {}  # by actor; None for one without a radio
        self._numbers: set[int] = set()
        self._on_the_way: list[HeardMessage] = []  # in the order of their times
        self._known = Memory(objects=config.perceiving > 0.0, events=config.warnings)
        self.output: Stations = self._known.output(-math.inf, _NOWHERE, 0.0)  #: for the controller
        self.refused = 0  #: actors left out at the last tick because of a value that is not finite

    def step(self, time: float, pose: Pose, actors: Actors) -> None:
        """Take the ego's pose and the actors at drive time `time` [s]; all work is left to `prepare`."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"v2x: the pose must be the rear axle's, got {pose.point}")
        if not math.isfinite(pose.x + pose.y + pose.heading + pose.speed):
            raise ValueError("v2x: the pose is not finite")
        self._look = _Look(time, pose, actors)
        self.refused = len(actors.ids) - len(finite_rows(actors))

    def prepare(self) -> V2xReading | None:
        """Let the stations send; return the messages that come out at the next tick, if any do."""
        look = self._look
        if look is None:
            return None
        self._send(look)
        came = self._arrived(look.time)
        self._known.take(came)
        if not came and look.time - self.output.time < HEARTBEAT:
            return None
        self._known.forget(look.time)
        self.output = self._known.output(look.time, look.pose, self._bumper)
        places = [seen_from(look.pose, self._bumper, one) for one in came]
        x, y, heading = zip(*places, strict=True) if places else ((), (), ())
        return V2xReading(look.time, came, x, y, heading, self._config.more)

    def _arrived(self, now: float) -> list[HeardMessage]:
        """Take the messages that come out by now off the way."""
        count = 0
        for one in self._on_the_way:
            if one.time + self._config.latency > now + 1e-9:
                break
            count += 1
        came, self._on_the_way = self._on_the_way[:count], self._on_the_way[count:]
        return came

    def _send(self, look: _Look) -> None:
        """Let every station that is due send, and put what is received on its way."""
        now, obstacles, around = round(look.time * MICROSECONDS), None, None
        for row in finite_rows(look.actors).tolist():
            station = self._station(look.actors.ids[row], int(look.actors.kind[row]), now)
            if station is None or now < station.next_check:
                continue
            station.next_check += CHECK_PERIOD * ((now - station.next_check) // CHECK_PERIOD + 1)
            check = check_of(station.sender, look.actors, row, look.time)
            if station.sender.perceiver is not None:
                around = around or Surroundings(look.actors, look.pose, self._vehicle, self._walls)
            for read in self._packets(check, around):
                obstacles = obstacles or Obstacles(look.actors, self._walls)
                power = self._power(station, look, row, obstacles)
                lost = station.chance.random() < self._config.loss
                if power >= self._config.sensitivity and not lost and look.time < self._config.jammed_from:
                    self._on_the_way += read(power)

    def _packets(self, check: Check, around: Surroundings | None) -> list[ReadPacket]:
        """Return what reads each of the packets that a station sends at a check, where it is received."""
        sender, composer, packets = check.sender, self._composer, list[ReadPacket]()
        if sender.trigger.due(check.now, check.own):
            packets.append(partial(composer.awareness, check))
        if sender.events is not None:
            # What a vehicle measures of its own motion does not jump as its receiver's place does.
            speed, acceleration = float(check.actors.speed[check.row]), check.change.acceleration
            notices = sender.events.due(check.now, acceleration, speed, hazard_lights=sender.hazard_lights)
            packets += [partial(composer.warning, check, notice) for notice in notices]
        if around is not None and sender.perceiver is not None:
            bodies, total = sender.perceiver.due(check.now, around, check.row)
            if bodies:
                packets.append(partial(composer.perception, check, sender.perceiver.sector, bodies, total))
        return packets

    def _station(self, name: str, kind: int, now: int) -> _Station | None:
        """Return an actor's station; None where it has no radio."""
        if name not in self._stations:
            chance = stream(self._seed, name)
            share = self._config.equipped_vulnerable if BODY_KINDS[kind] in VULNERABLE else self._config.equipped
            equipped, phase = chance.random() < share, int(chance.integers(CHECK_PERIOD))
            self._stations[name] = None
            if equipped:
                fading = Fading(stream(self._seed, f"{name} fading"))
                self._stations[name] = _Station(self._sender(name, BODY_KINDS[kind]), fading, chance, now + phase)
        return self._stations[name]

    def _sender(self, name: str, kind: str) -> Sender:
        config, vulnerable = self._config, kind in VULNERABLE
        sender = Sender(
            self._number(name),
            kind,
            VamTrigger() if vulnerable else CamTrigger(round(config.longest_cam_interval * MICROSECONDS)),
            CorrelatedNoise(stream(self._seed, f"{name} errors"), ERROR_CORRELATION, MICROSECONDS),
            config.position_sigma_vulnerable if vulnerable else config.position_sigma,
            config.speed_sigma,
        )
        if config.warnings and not vulnerable:
            sender.events, sender.hazard_lights = EventTrigger(), name in config.hazard_lights
        if config.perceiving > 0.0 and not vulnerable:
            chance = stream(self._seed, f"{name} perception")
            if chance.random() < config.perceiving:
                sender.perceiver = Perceiver(config.sector, chance)
        return sender

    def _number(self, name: str) -> int:
        """Give a station an ID that no other has."""
        digest = hashlib.blake2b(name.encode(), key=self._seed, digest_size=4).digest()
        number = int.from_bytes(digest, "little")
        while number in self._numbers:
            number = (number + 1) % 2**32
        self._numbers.add(number)
        return number

    def _power(self, station: _Station, look: _Look, row: int, obstacles: Obstacles) -> float:
        config, pose = self._config, look.pose
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        x, y = pose.x + config.x * cos - config.y * sin, pose.y + config.x * sin + config.y * cos
        receiver, sender = Antenna(x, y, config.z), antenna_of(look.actors, row)
        found = obstacles.between(receiver, sender, row)
        return received_power(config.power, receiver, sender, found, station.fading)
