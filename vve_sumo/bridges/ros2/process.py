"""The bridge on real sockets and in a real domain: opens what a rig names, runs until it is told to end.

It is a program of its own, beside the drive: it hears the drive's wires as any external controller does and holds no
way to it but the port of setpoints. It knows sockets, the rig and DDS; it must not know what stands in a message.
"""

from __future__ import annotations

import contextlib
import gc
import select
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from vve_sumo.bridges.ros2.bridge import COMMANDS, Bridge, Installation
from vve_sumo.bridges.ros2.dds import Dds
from vve_sumo.bridges.ros2.senses import topics_of
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.live.brain_link import key_of
from vve_sumo.rig.schema import Rig
from vve_sumo.sensors.drawing import Mounting
from vve_sumo.wire.ros2.messages import LATCHED, TOPICS, sense_refusal

#: largest datagram [bytes]
LONGEST: Final = 65_535
#: the wires that are heard, in the order in which a tick's datagrams are taken; the radar datagram ends the tick
WIRES: Final = ("ncom", "scene", "radar")
SENSE: Final = "sense"  #: the kind of the wires of further sensors
#: asked for each wire [bytes]: a turn of a lidar waits in it; Linux allows it to every user, and doubles it
QUEUE_SIZE: Final = 212_992
#: how often it is looked whether a node that was started has ended [s]
POLL: Final = 0.2
#: how long a node may take to be found [s], and how often it is looked for
NODE_TIMEOUT, MATCH_POLL = 20.0, 0.2
END_TIMEOUT: Final = 3.0  #: for a node to end after SIGTERM [s]


def places_of(rig: Rig) -> dict[str, tuple[str, int]]:
    """Return address and port of each wire that the bridge hears, by kind; raises ConfigError for what is missing."""
    found: dict[str, tuple[str, int]] = {}
    for number, output in enumerate(rig.outputs):
        if output.kind not in WIRES or output.udp is None or output.sensor is not None:
            continue
        if output.kind in found:
            raise ConfigError(f"outputs.{number}: the ROS 2 bridge hears one wire of kind {output.kind!r}, got two")
        found[output.kind] = _place(output.udp)
    missing = next((kind for kind in WIRES if kind not in found), None)
    if missing is not None:
        raise ConfigError(f"outputs: the ROS 2 bridge needs one of kind {missing!r} over udp, and has none")
    order = [output.kind for output in rig.outputs if output.kind in (*WIRES, SENSE)]
    if order[-1] != "radar":
        raise ConfigError(f"outputs: expected the one of kind 'radar' after 'ncom' and 'scene', got {', '.join(order)}")
    return found


def senses_of(rig: Rig) -> dict[str, tuple[str, int]]:
    """Return address and port of each sensor's wire, by name; raises ConfigError for a name that cannot be used."""
    found: dict[str, tuple[str, int]] = {}
    for number, output in enumerate(rig.outputs):
        if output.kind != SENSE or output.udp is None or output.sensor is None:
            continue
        why = sense_refusal(output.sensor) or (
            "" if output.sensor not in found else f"sensor {output.sensor!r}: got two"
        )
        if why:
            raise ConfigError(f"outputs.{number}: {why}")
        found[output.sensor] = _place(output.udp)
    return found


def _place(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


class BridgeProcess:
    """A bridge with its sockets and its domain: `listen`, then `run`; always call `close`."""

    def __init__(self, rig: Rig, resolved: ResolvedScenario, working: Path) -> None:
        """Join the domain; raises VveError for a rig that it cannot serve, and where it cannot."""
        self._places, self._sense_places, brain, wanted = places_of(rig), senses_of(rig), rig.brain, rig.ros2
        senses = self._sense_places
        sensors = resolved.sensors()
        drawings = {name: sensors[name].drawing(resolved.vehicle) for name in senses}
        frames = {name: Mounting() if drawn is None else drawn.frame for name, drawn in drawings.items()}
        self._closing = contextlib.ExitStack()
        try:
            self._out = self._closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._out.setblocking(False)
            self._dds = Dds(wanted.domain_id)
            self._closing.callback(self._dds.close)
        except BaseException:
            self._closing.close()
            raise
        for topic, kind in TOPICS.items():
            self._dds.advertise(topic, kind, latched=topic in LATCHED)
        for name in senses:
            for topic, kind in topics_of(name, sensors[name].serves).items():
                self._dds.advertise(topic, kind)
        installed = Installation(
            resolved.map_frame,
            resolved.model.mounting,
            resolved.vehicle,
            resolved.path,
            resolved.scenario.ego.speed_mps,
            key_of(brain, working),
            wanted.commands,
            wanted.time_constant_s,
            frames,
        )
        self._setpoints = brain.address, brain.port
        self.lost = 0  #: setpoints that could not be sent
        self.bridge = Bridge(installed, self._dds.publish, self._send)
        if brain.kind == "setpoints":
            self._dds.subscribe(*COMMANDS[wanted.commands])

    def await_node(self, ended: Callable[[], bool]) -> None:
        """Wait until a node hears a topic, and commands where commands are taken; for NODE_TIMEOUT at most."""
        limit = time.monotonic() + NODE_TIMEOUT
        while not self._dds.has_node() and not ended() and time.monotonic() < limit:
            time.sleep(MATCH_POLL)
        time.sleep(MATCH_POLL)  # the node's other topics

    def listen(self) -> None:
        """Open the wires: from now on a drive is heard; raises RigError naming what cannot be opened."""
        entered = self._closing.enter_context
        self._wires = {kind: entered(_listening(*self._places[kind])) for kind in WIRES}
        self._senses = {name: entered(_listening(*place)) for name, place in self._sense_places.items()}

    def run(self, ended: Callable[[], bool]) -> None:
        """Run until `ended` says so."""
        gc.collect()
        gc.freeze()
        bridge, wires = self.bridge, self._wires
        take: dict[str, Callable[[bytes], None]] = {
            "ncom": bridge.take_ncom,
            "scene": bridge.take_scene,
            "radar": lambda data: bridge.take_radar(data, time.monotonic()),
        }
        watched: list[socket.socket | Dds] = [*wires.values(), *self._senses.values(), self._dds]
        while not ended():
            select.select(watched, [], [], POLL)
            # The radar datagram is sent last: what is read after it holds all of its tick.
            came = {kind: _waiting(wires[kind]) for kind in reversed(WIRES)}
            for name, wire in self._senses.items():
                for data in _waiting(wire):
                    bridge.take_sense(name, data)
            for kind in WIRES:
                for data in came[kind]:
                    take[kind](data)
            for heard in self._dds.receive():
                bridge.take_command(heard.writer, heard.message)

    def _send(self, setpoint: bytes) -> None:
        try:
            self._out.sendto(setpoint, self._setpoints)
        except OSError:
            self.lost += 1

    def report(self) -> str:
        """Return one line on what was sent, taken and refused."""
        answers = self.bridge.answers
        refused = ", ".join(f"{count} x {why}" for why, count in sorted(answers.refused.items())) or "none"
        return (
            f"{answers.taken} commands became setpoints, refused {refused}; {self._dds.dropped} messages dropped, "
            f"{self.bridge.unread} datagrams not read, {self.lost} setpoints lost"
        )

    def close(self) -> None:
        """Close all that is open."""
        self._closing.close()


def _listening(host: str, port: int) -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE_SIZE)
        end.bind((host, port))
    except OSError as error:
        end.close()
        raise RigError(f"udp {host}:{port}: cannot be listened on ({error.strerror})") from None
    end.setblocking(False)
    return end


def _waiting(end: socket.socket) -> list[bytes]:
    """Return the datagrams that wait on a socket, in order."""
    came: list[bytes] = []
    with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
        while True:
            came.append(end.recv(LONGEST))
    return came


class Node:
    """A program that the bridge starts beside itself, and ends with it."""

    def __init__(self, command: Sequence[str], working: Path, environment: dict[str, str]) -> None:
        """Start it; raises ConfigError for one that cannot be started."""
        try:
            self._process = subprocess.Popen(list(command), cwd=working, env=environment)
        except OSError as error:
            raise ConfigError(f"{command[0]}: cannot be started ({error.strerror})") from None

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def close(self) -> int:
        """End it; return its exit code."""
        self._process.terminate()
        try:
            return self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()
