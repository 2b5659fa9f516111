"""What a live drive says of itself once a tick, for the process of its page.

Plain values that the drive has anyway; turning them into a picture is that process's work. Imports nothing heavy, for
the drive's process imports this.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import Actors, CommandedPath, FallbackPath, FixQuality, GatewayStatus, Pose


@dataclass(frozen=True, slots=True)
class ReadingView:
    """A sensor's reading that came out at a tick."""

    measured: float  #: drive time at which it was measured [s]
    columns: tuple[Any, ...]  #: arrays or lists, of the sensor's table, as `scenario.json` names them


@dataclass(frozen=True, slots=True)
class PersonMark:
    """A person at a tick, as the page draws one."""

    id: str  #: in the scenario
    presence: str  #: name of one of `Presence`, in small letters
    x: float  #: middle of the circle that holds the true place with 95 % [m], map; NaN where nobody knows
    y: float  #: [m]
    radius: float  #: of that circle [m]
    age: float  #: of the newest believed position [s]
    heading: float  #: of the box that sensors meet [rad], counter-clockwise from the map's +x; NaN without one
    length: float  #: of that box [m]
    width: float  #: of that box [m]


@dataclass(frozen=True, slots=True)
class ViewSample:
    """One tick of a live drive."""

    tick: int
    time: float  #: drive time [s]
    wall: float  #: Unix time of that [s]
    pose: Pose | None  #: of the rear axle on the virtual road; None before the first trusted fix
    s: float  #: distance along the path [m]; NaN for none
    d: float  #: lateral deviation [m], left positive; NaN for none
    wished: float  #: acceleration that the controller asks for [m/s2]; NaN for none
    wished_steering: float  #: road-wheel angle likewise [rad]; NaN for none
    note: str  #: the controller's own word for what it does
    fallback_path: FallbackPath | None  #: the fallback path that the setpoint carries
    commanded_path: CommandedPath | None  #: the path that the controller's command carries
    faults: tuple[str, ...]  #: all reason codes of the tick
    details: dict[str, str]  #: the numbers behind some of them, in words
    pose_reasons: tuple[str, ...]  #: why the newest fix was not trusted
    quality: FixQuality  #: of the newest trusted fix
    sigma: float  #: its horizontal standard deviation [m]; NaN not reported
    status: GatewayStatus  #: the gateway's newest
    status_age: float  #: how old that is [s]; inf before the first
    steering: float  #: road-wheel angle that the car reports [rad]; NaN not reported
    wheel_speed: float  #: that the car reports [m/s]; NaN not reported
    gear: str  #: that the car reports; empty before the first report
    latency: float  #: of the newest completed tick, arrival of the bytes to the command frame [s]; NaN for none
    missed: int  #: ticks skipped so far
    actors: Actors  #: that the sensors saw
    readings: Mapping[str, ReadingView]  #: of the sensors that gave one, by the sensor's name
    signals: Mapping[str, str]  #: what each traffic signal shows, SUMO's letter for each of its links
    people: tuple[PersonMark, ...]  #: real people, as the actors that the sensors saw have them
    outcome: str | None  #: of the drive, once it has one


_CODEC: Final = MessageCodec[ViewSample](MessageKind.VIEW, ViewSample)


def encode(sample: ViewSample) -> bytes:
    """Return a sample as a datagram."""
    return _CODEC.encode(sample)


def decode(datagram: bytes) -> ViewSample | MalformedMessage:
    """Return the sample in a datagram of the drive."""
    return _CODEC.decode(datagram)
