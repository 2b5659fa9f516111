"""The bridge without its sockets: datagrams of a drive's wires become messages on topics, commands become setpoints.

What a node may drive by comes over the wires that every external controller has, NCOM and the radar datagram, under the
same rules: nothing that is invalid, old or repeated is shown, and then no setpoint is sent. Bodies, state and reasons
come over the wire `scene`. Knows wires, messages and commands; it must not know DDS or sockets.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vve_sumo.bridges.ros2.commands import MAX_TICKS, Answers, Beat, Command, command_of
from vve_sumo.bridges.ros2.senses import Senses
from vve_sumo.drive.brain import virtual_placement
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.path import ReferencePath
from vve_sumo.pose.ncom import Decoder
from vve_sumo.sensors.drawing import Mounting as SensorFrame
from vve_sumo.values import Actors, Fix, Pose, Vehicle
from vve_sumo.wire.datagrams import SEQUENCES, RadarDatagram, decode_radar, encode_setpoint
from vve_sumo.wire.ros2 import clouds, messages
from vve_sumo.wire.ros2.messages import unix_nanoseconds
from vve_sumo.wire.ros2.path_ahead import PathAhead
from vve_sumo.wire.sample import MAX_SCAN_AGE
from vve_sumo.wire.scene import Scene, decode_scene
from vve_sumo.wire.signature import signed, without_tag

#: topic and type of the commands, by `ros2.commands` of a rig
COMMANDS: Final = {
    "twist_stamped": ("/cmd_vel", "geometry_msgs/msg/TwistStamped"),
    "twist": ("/cmd_vel", "geometry_msgs/msg/Twist"),
    "ackermann": ("/ackermann_cmd", "ackermann_msgs/msg/AckermannDriveStamped"),
}
#: a fix and a radar datagram of one tick are apart by less than this [s]
SAME_TICK: Final = 0.05
#: after a silence this long the next datagram is of another drive [s]
NEW_DRIVE: Final = 1.0


@dataclass(frozen=True, slots=True)
class Installation:
    """What the bridge knows of a drive beforehand."""

    frame: MapFrame  #: the virtual road's map
    mounting: Mounting  #: the receiver's on the car
    vehicle: Vehicle
    path: ReferencePath
    speed: float  #: the scenario's [m/s]
    key: bytes = b""  #: that signs this project's own datagrams; empty: they are not signed
    commands: str = "twist_stamped"  #: one of COMMANDS
    time_constant: float = 0.5  #: see `Answers` [s]
    senses: Mapping[str, SensorFrame] = field(default_factory=dict)  #: frames of further sensors, by name


class Bridge:
    """Takes datagrams and commands in the order in which they came."""

    def __init__(
        self, installed: Installation, publish: Callable[[str, Any], None], send: Callable[[bytes], None]
    ) -> None:
        """`publish` sends a message on a topic of TOPICS, `send` a setpoint; neither waits."""
        self._installed, self._publish, self._send = installed, publish, send
        self._placement = virtual_placement(installed.frame, installed.mounting, 0.0)
        self.answers = Answers(installed.vehicle.wheelbase, installed.time_constant)
        self._ahead = PathAhead(installed.path, installed.speed)
        self._senses = Senses(tuple(installed.senses), installed.key)
        self._unread = 0
        self._begin()

    @property
    def unread(self) -> int:
        """Datagrams that are none, or not signed with the key."""
        return self._unread + self._senses.unread

    def _begin(self) -> None:
        self._decoder = Decoder()
        # The newest, for a bridge that is some ticks late.
        self._fixes: deque[Fix] = deque(maxlen=MAX_TICKS)
        self._scenes: deque[Scene] = deque(maxlen=MAX_TICKS)
        self._sequence: int | None = None  # of the newest radar datagram
        self._measured = -math.inf  # of the newest scan that was shown
        self._heard = -math.inf  # clock of the newest radar datagram
        self._latched = False
        self._s: float | None = None  # of the ego along the path, by the truth
        self._driven: float | None = None  # likewise, by the receiver

    def take_ncom(self, data: bytes) -> None:
        """Take an NCOM packet."""
        self._fixes.extend(self._decoder.feed(data, 0.0))

    def take_scene(self, data: bytes) -> None:
        """Take a datagram of the wire `scene`."""
        body = without_tag(data, self._installed.key)
        scene = None if body is None else decode_scene(body)
        if isinstance(scene, Scene):
            self._scenes.append(scene)
        else:
            self._unread += 1

    def take_sense(self, name: str, data: bytes) -> None:
        """Take a datagram of the wire `sense` of a sensor."""
        self._senses.take(name, data)

    def take_radar(self, data: bytes, now: float) -> None:
        """Take a radar datagram at a time of any clock [s]; it ends its tick, whose messages are published now."""
        body = without_tag(data, self._installed.key)
        radar = None if body is None else decode_radar(body)
        if radar is None:
            self._unread += 1
            return
        if now - self._heard > NEW_DRIVE:
            fixes, scenes = self._fixes, self._scenes  # of this tick, whose datagrams came first
            self._begin()
            self._fixes, self._scenes = fixes, scenes
            self._senses.begin(radar.sequence)
            self.answers.forget()
        self._heard = now
        if self._sequence is not None and not 0 < (radar.sequence - self._sequence) % SEQUENCES < SEQUENCES // 2:
            return
        self._sequence = radar.sequence
        self._tick(radar)

    def _tick(self, radar: RadarDatagram) -> None:
        at = unix_nanoseconds(radar.time)
        fix = min(reversed(self._fixes), key=lambda one: abs(one.time - radar.time), default=None)
        scene = next((one for one in reversed(self._scenes) if one.sequence == radar.sequence), None)
        self._publish("/clock", messages.clock(at))
        self._latch(at)
        timely = fix is not None and fix.locked and abs(fix.time - radar.time) <= SAME_TICK
        sound = timely and radar.valid and radar.time - radar.measured <= MAX_SCAN_AGE
        pose = self._placement.place(fix) if sound and fix is not None else None
        sensed = list(self._senses.of_tick(radar.sequence))
        if pose is None or fix is None:
            self.answers.forget()
        else:
            # Before what a node may answer by: whoever does finds the tick.
            self.answers.ticked(Beat(radar.sequence, radar.time, radar.speed))
            for topic, message in sensed:
                self._publish(topic, message)
            self._show(at, radar, fix, pose)
        # What nobody drives by delays nothing that somebody does.
        self._tell(at, scene, pose)

    def _latch(self, at: int) -> None:
        if self._latched:
            return
        self._latched = True
        vehicle, mounting = self._installed.vehicle, self._installed.mounting
        place = mounting.forward, mounting.left
        senses = self._installed.senses
        self._publish("/tf_static", messages.static_transforms(at, vehicle.rear_axle_to_bumper, place, senses))
        self._publish("/path", messages.path(at, self._installed.path))

    def _show(self, at: int, radar: RadarDatagram, fix: Fix, pose: Pose) -> None:
        """Publish what a node may drive by, `/odom` last."""
        if radar.measured > self._measured:
            self._measured = radar.measured
            rows = np.array([(one.range, one.azimuth, one.range_rate) for one in radar.targets]).reshape(-1, 3)
            self._publish("/radar/points", clouds.radar_cloud(unix_nanoseconds(radar.measured), *rows.T))
        self._publish("/tf", messages.transforms(at, pose))
        self._publish("/fix", messages.nav_sat_fix(at, fix))
        self._publish("/imu", messages.imu(at, fix))
        self._driven = self._installed.path.project(pose.x, pose.y, self._driven).s
        self._publish("/path/ahead", self._ahead.path(at, pose, self._driven))
        self._publish("/path/speed", self._ahead.reference(at, self._driven))
        self._publish("/odom", messages.odometry(at, pose, fix))

    def _tell(self, at: int, scene: Scene | None, pose: Pose | None) -> None:
        """Publish bodies and diagnostics of a tick; without its scene the diagnostics know neither state nor gap."""
        gap = math.nan
        if scene is not None and scene.pose is not None:
            self._publish("/bodies", messages.markers(at, scene.actors))
            gap = self._gap(scene.pose, scene.actors)
        state, reasons = (scene.state, scene.faults) if scene is not None else ("", ())
        self._publish("/diagnostics", messages.drive_status(at, state, reasons, valid=pose is not None, gap=gap))

    def _gap(self, pose: Pose, actors: Actors) -> float:
        path, vehicle = self._installed.path, self._installed.vehicle
        self._s = path.project(pose.x, pose.y, self._s).s
        return float(lead_vehicle_now(pose, self._s, actors, path, vehicle).gap[0])

    def take_command(self, writer: int, message: Any) -> None:
        """Take a command of a publisher, None for bytes that are none; send the setpoint that it comes to, if any."""
        command: Command | None = None
        if message is not None:
            command = command_of(self._installed.commands, message)
        setpoint = self.answers.take(writer, command)
        if setpoint is None:
            return
        data, key = encode_setpoint(setpoint), self._installed.key
        self._send(signed(data, key) if key else data)
