"""Runs the simulated vehicle as a process in real time: its receiver's bytes over the receiver's wire, CAN over a
bus that others can open.

`python -m vve_sumo.live.simulated_vehicle`, started by `spawn`. Like a real car it knows the commands on its bus, its
own motion and the sky; no street, no gateway, no controller. It also injects faults and writes a file of the true
motion.
"""

from __future__ import annotations

import contextlib
import gc
import math
import signal
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import msgspec
import numpy as np

from vve_sumo.errors import ConfigError, RigError, VveError
from vve_sumo.frames import MapFrame
from vve_sumo.live import messages
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import VEHICLE_PRIORITY, raise_priority
from vve_sumo.live.slcan import Adapter
from vve_sumo.live.spawn import receive_config
from vve_sumo.plant.car import FAST, STEPS_PER_SECOND, Car, CarParameters
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.pose.receivers.port import FarBus, configured
from vve_sumo.values import Frame, Pose

if TYPE_CHECKING:
    from vve_sumo.bus import Bus

MAX_LAG: Final = 0.100  # messages that are later than this are not sent [s]
STEPS_PER_POLL: Final = 20  # steps between polls of the console and flushes of the truth: 0.1 s
REST_TIME: Final = 1.0  # a car that stands for so long without a frame on its bus is at rest [s]
LOG_BUFFER: Final = 1 << 16  # of the bus's log [bytes]: some seconds of a car's reports
END_TIMEOUT: Final = 60.0  # longest time from the request to end to the end [s]

TRUTH_COLUMNS: Final = (
    "time_s", "x_m", "y_m", "heading_rad", "speed_mps", "brake_torque_nm", "gear", "wheel_angle_rad",
    "brake_enabled", "throttle_enabled", "steering_enabled", "watchdog_braking",
)  # fmt: skip


class CarBusEnd(Protocol):
    """The car's end of its CAN bus; no method waits or raises."""

    def send(self, frames: Iterable[Frame]) -> None:
        """Put frames on the bus."""

    def receive(self) -> list[Frame]:
        """Return the frames received since the last call, in order."""

    def close(self) -> None:
        """Let go of the bus."""


class PythonCanWire:
    """A bus that python-can opens, as a `Wire`: to the car, a bus that is down is a silent one."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def send(self, frames: Iterable[Frame]) -> None:
        """Put frames on the bus."""
        with contextlib.suppress(RigError):
            for frame in frames:
                self._bus.send(frame)

    def receive(self) -> list[Frame]:
        """Return the frames received since the last call, in order."""
        try:
            return self._bus.drain()
        except RigError:
            return []

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.close()


@dataclass(frozen=True, slots=True)
class CarConfig:
    """The configuration of the process: `to_dict` gives it as plain JSON, `from_dict` reads that."""

    parameters: CarParameters
    lot: MapFrame  #: the plane map of the lot that the truth is written in
    latitude_deg: float  #: of the rear axle at the start, WGS84
    longitude_deg: float  #: of the rear axle at the start, WGS84
    heading_deg: float  #: at the start, clockwise from true north
    epoch: float  #: GNSS second of drive time 0
    t0: float  #: monotonic second of drive time 0
    seed: int  #: of the scenario
    receiver: dict[str, Any]  #: table `[pose]` of the rig, as which the car's receiver sends
    bus: tuple[str, str] | None = None  #: python-can's interface and channel; None is a pty of the car's own
    faults: tuple[InjectedFault, ...] = ()
    truth: Path | None = None  #: file that the truth is written to
    brain: str | None = None  #: `pty:FILE`: a second port on a pty of the car's own, for an external controller
    bus_log: Path | None = None  #: file that the frames of such a bus are written to, with who sent each

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as `spawn.start` takes it."""
        plain: dict[str, Any] = msgspec.to_builtins(self, enc_hook=_plain)
        return plain

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> CarConfig:
        """Return the configuration that `to_dict` gave; raises ConfigError for other data."""
        try:
            return msgspec.convert(data, cls, dec_hook=_made)
        except msgspec.ValidationError as error:
            raise ConfigError(f"simulated vehicle: {error}") from None

    def start(self) -> tuple[float, float, float]:
        """Return x, y [m] and heading [rad] of the rear axle at the start, in the lot's map."""
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        x, y = self.lot.to_map(latitude, longitude)
        return x, y, math.radians(90.0 - self.heading_deg) + self.lot.convergence(latitude, longitude)


def _plain(value: object) -> Any:
    """Return what is sent for a part of a configuration that msgspec does not know."""
    if isinstance(value, MapFrame):
        return {"projection": value.projection, "offset": value.offset}
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} is no part of a configuration")


def _made(kind: type[Any], value: Any) -> Any:
    if kind is not MapFrame:
        return kind(value)
    if not (isinstance(value, dict) and value.keys() == {"projection", "offset"}):
        raise ValueError("expected a map's projection and offset")
    return MapFrame(value["projection"], tuple(value["offset"]))


class TruthFile:
    """The file of the car's true motion; a full disk ends the file, not the car."""

    def __init__(self, file: FileIO | None) -> None:
        self._file = file
        self._lines = [",".join(TRUTH_COLUMNS) + "\n"]

    def add(self, pose: Pose, car: Car) -> None:
        """Add a line for the car's present state."""
        interface = car.interface
        enabled = ",".join(str(int(one)) for one in interface.enabled)
        motion = f"{pose.time:.3f},{pose.x:.5f},{pose.y:.5f},{pose.heading:.6f},{pose.speed:.5f}"
        body = f"{car.brake_torque:.1f},{interface.gear.name.lower()},{car.wheel_angle:.6f}"
        self._lines.append(f"{motion},{body},{enabled},{interface.watchdog_braking:d}\n")

    def flush(self) -> None:
        """Hand the lines taken so far to the kernel."""
        lines, self._lines = self._lines, []
        if self._file is None:
            return
        try:
            self._file.write("".join(lines).encode())
        except OSError:
            self._file = None


class SimulatedVehicle:
    """The car on the monotonic clock; each step is computed ahead, so that its messages go out when they are due."""

    def __init__(self, config: CarConfig, wire: CarBusEnd, truth: TruthFile) -> None:
        # The radar's noise is the second child of a scenario's seed.
        car_seeds, _, fault_seeds = np.random.SeedSequence(config.seed).spawn(3)
        start, faults, receiver = config.start(), config.faults, configured(config.receiver)
        self._car = FaultInjectedCar(
            config.parameters, start, config.lot, config.epoch, car_seeds, faults, fault_seeds, receiver=receiver
        )
        self._wire = wire
        self._truth = truth
        self._t0 = config.t0
        far_end = receiver.far_end(_far_bus)
        if far_end is None:
            raise ConfigError(f"pose.{receiver.not_simulated()}")
        self._far_end = far_end
        self._steps = 0
        self._rests_since = 0.0

    @property
    def time(self) -> float:
        """Drive time up to which the car has moved [s]."""
        return self._steps / STEPS_PER_SECOND

    @property
    def at_rest(self) -> bool:
        """Whether the car has been standing for REST_TIME without a frame on its bus."""
        return self.time - self._rests_since >= REST_TIME

    def step(self) -> None:
        """Advance by one step and send each message when it is due; returns when the step is over in real time."""
        data = self._wire.receive()
        self._steps += 1
        until = self.time
        output, truth = self._car.step(until, data), self._car.truth()
        if truth.speed != 0.0 or data:
            self._rests_since = until
        if self._steps % FAST == 0:
            self._truth.add(truth, self._car.car)
        self._say(output.packets, output.reports)
        self._wait(until)

    def flush(self) -> None:
        """Write the truth so far to its file."""
        self._truth.flush()

    def close(self) -> None:
        """Write the rest of the truth; close the receiver's wire and the bus."""
        self._truth.flush()
        self._far_end.close()
        self._wire.close()

    def _say(self, packets: Sequence[tuple[float, bytes]], reports: Sequence[tuple[float, Frame]]) -> None:
        for arrival, packet in packets:
            if self._wait(arrival) <= MAX_LAG:
                self._far_end.send(packet)
        if reports and self._wait(reports[-1][0]) <= MAX_LAG:
            self._wire.send([frame for _, frame in reports])

    def _wait(self, until: float) -> float:
        """Wait until drive time `until`; return how long that is past [s], 0 after a wait."""
        late = time.monotonic() - self._t0 - until
        if late >= 0.0:
            return late
        time.sleep(-late)
        return 0.0


class EndCondition:
    """When the process ends: asked to and with the car at rest, or END_TIMEOUT after it was asked."""

    def __init__(self, console: Channel) -> None:
        self._console = console
        self._stop_requested = False
        self._since = math.inf
        signal.signal(signal.SIGTERM, self._ask)
        for ignored in (signal.SIGINT, signal.SIGHUP):
            signal.signal(ignored, signal.SIG_IGN)

    def due(self, now: float, at_rest: bool) -> bool:
        """Whether to end at drive time `now` [s]."""
        self._console.receive()
        if self._stop_requested or self._console.closed:
            self._since = min(self._since, now)
        return now - self._since >= END_TIMEOUT or (at_rest and self._since < math.inf)

    def _ask(self, *_: object) -> None:
        self._stop_requested = True


def main() -> int:
    """Run the process; returns its exit code."""
    data, channels = receive_config()
    console = channels["console"]
    ending = EndCondition(console)
    try:
        config = CarConfig.from_dict(data)
        with contextlib.ExitStack() as stack:
            run(config, console, ending, stack)
    except VveError as error:
        console.send(messages.refusal(error))
        return error.exit_code
    return 0


def run(config: CarConfig, console: Channel, ending: EndCondition, stack: contextlib.ExitStack) -> None:
    """Run the car until it is time to end; sends `Ready` to the console, with the bus that others can open."""
    wire, bus = _wire(config, stack)
    file = None if config.truth is None else stack.enter_context(config.truth.open("wb", buffering=0))
    car = SimulatedVehicle(config, wire, TruthFile(file))
    stack.callback(car.close)
    gc.collect()
    gc.freeze()
    raise_priority(VEHICLE_PRIORITY)
    console.send(messages.encode(messages.Ready(bus)))
    while not ending.due(car.time, car.at_rest):
        for _ in range(STEPS_PER_POLL):
            car.step()
        car.flush()


def _wire(config: CarConfig, stack: contextlib.ExitStack) -> tuple[CarBusEnd, tuple[str, str]]:
    if config.bus is None and config.brain is None:
        adapter = Adapter()
        return adapter, ("slcan", adapter.name)
    if config.bus is None:
        return _two_port_wire(config, stack)
    from vve_sumo.bus import Bus

    return PythonCanWire(Bus(*config.bus)), config.bus


def _two_port_wire(config: CarConfig, stack: contextlib.ExitStack) -> tuple[CarBusEnd, tuple[str, str]]:
    from vve_sumo.live.pty_bus import TwoPortBus, monotonic_clock

    assert config.brain is not None
    log = None
    if config.bus_log is not None:
        log = stack.enter_context(config.bus_log.open("w", encoding="ascii", buffering=LOG_BUFFER))
    ports = TwoPortBus(config.brain, log, monotonic_clock(config.t0))
    return ports, ("slcan", ports.name)


def _far_bus(channel: str) -> FarBus:
    """Return the emulated adapter of a receiver on CAN; it is imported only then, for it brings python-can."""
    from vve_sumo.live.pty_bus import LinkedAdapter

    return LinkedAdapter(channel)


if __name__ == "__main__":
    sys.exit(main())
