"""What a drive's wires carry in the bridge's tests: a car that drives east, samples of it, and their datagrams."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vve_sumo.bridges.ros2.bridge import Installation
from vve_sumo.drive.brain import virtual_placement
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.drawing import Mounting as SensorFrame
from vve_sumo.values import Actors, Detections, Fix, FixQuality, Point, Pose, Vehicle
from vve_sumo.wire.outputs import KINDS, Context
from vve_sumo.wire.sample import Sample, SampleContent, virtual_fix

EPOCH = 1_451_260_818.0
FRAME = MapFrame("+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", (-329_000.0, -4_428_000.0))
MOUNTING = Mounting(0.30, 0.20)
START, SPEED, FAR = (1000.0, 1000.0), 8.0, 60.0
_PARKED: Any = {
    "x": START[0] + FAR, "y": START[1], "heading": 0.0, "speed": 0.0, "length": 4.5, "width": 1.8,
    "radar_cross_section": 10.0, "lateral_speed": 0.0, "height": 1.5,
}  # fmt: skip
ACTORS = Actors(
    0.0, ("parked",), **{name: np.array([value]) for name, value in _PARKED.items()}, kind=np.zeros(1, np.int8)
)


@dataclass
class Wires:
    """The wires of a drive, tick by tick."""

    vehicle: Vehicle
    key: bytes = b""
    outputs: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        context = Context(self.vehicle, FRAME.projection, FRAME.offset, key=self.key)
        self.outputs = {kind: KINDS[kind].make(context) for kind in ("ncom", "scene", "radar")}

    def of(self, sample: Sample) -> dict[str, bytes]:
        """Return a sample's datagram on each wire."""
        return {kind: output.step(sample)[0] for kind, output in self.outputs.items()}  # type: ignore[attr-defined]


def pose_at(tick: int) -> Pose:
    """Return the pose at a tick, counted from 0."""
    return Pose(0.02 * tick, Point.REAR_AXLE, START[0] + SPEED * 0.02 * tick, START[1], 0.0, SPEED, 0.0, 0.0, 0.0, 0.0)


def sample_at(tick: int, *, valid: bool = True, scan_age: float = 0.04) -> Sample:
    """Return the sample of a tick."""
    now, pose = 0.02 * tick, pose_at(tick)
    newest = Fix(
        time=EPOCH + now, time_received=now, latitude=0.0, longitude=0.0, altitude=230.0, heading=0.0, pitch=0.0,
        roll=0.0, velocity_north=0.0, velocity_east=0.0, velocity_down=0.0, yaw_rate=0.0, acceleration=0.0,
        locked=True, quality=FixQuality.RTK_FIXED, position_sigma=0.02, velocity_sigma=0.02, heading_sigma=0.002,
    )  # fmt: skip
    fix = virtual_fix(pose, virtual_placement(FRAME, MOUNTING, EPOCH), newest)
    far = FAR - 0.5 * 4.5 - 3.84 - SPEED * now
    seen, aside, rate = (np.array([value]) for value in (far, 0.01, -SPEED))
    scan = Detections(now - scan_age, seen, aside, rate, np.zeros(1, np.int8))
    content = SampleContent(fix, pose, scan, scan_age, ACTORS) if valid else None
    faults = () if valid else ("pose_stale",)
    return Sample(tick + 1, EPOCH + now, now, content, faults=faults, state="engaged" if valid else "stopping")


def installation(vehicle: Vehicle, key: bytes = b"", commands: str = "twist_stamped") -> Installation:
    """Return what the bridge knows beforehand."""
    x = np.linspace(START[0], START[0] + 500.0, 51)
    path = ReferencePath.from_points(x, np.full(51, START[1]))
    senses = {"roof": SensorFrame(x_m=1.4, z_m=1.9), "front": SensorFrame(x_m=vehicle.rear_axle_to_bumper)}
    return Installation(FRAME, MOUNTING, vehicle, path, 11.0, key, commands, senses=senses)


def heading_of(z: float, w: float) -> float:
    """Return the heading of a turn about the vertical [rad]."""
    return 2.0 * math.atan2(z, w)
