"""The simulated vehicle as a process: a real pty, real UDP, a real gateway on the other end, real signals."""

from __future__ import annotations

import csv
import json
import math
import select
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import pytest

from tests import vehicles
from tests.setpoints import setpoint as complete
from vve_sumo.bus import Bus
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame, Placement
from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.messages import decode
from vve_sumo.live.simulated_vehicle import CarConfig, PythonCanWire, TruthFile
from vve_sumo.live.spawn import start
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.pose.ncom import Decoder
from vve_sumo.values import ArmingState, Fix, Frame, GatewayStatus
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import InterfaceConfig

LOT = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-81 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
EPOCH = 1_451_260_818.0
PERIOD = 0.02


def configuration(truth: Path | None, port: int, **changes: Any) -> CarConfig:
    config = CarConfig(
        parameters=vehicles.parameters(noise=0.0),
        lot=LOT,
        latitude_deg=40.002,
        longitude_deg=-82.98,
        heading_deg=300.0,
        epoch=EPOCH,
        t0=time.monotonic(),
        seed=7,
        receiver={"kind": "ncom_udp", "port": port, "minimum_delay_ms": 10.0},
        truth=truth,
    )
    return replace(config, **changes)


@dataclass
class Running:
    """A car's process and everything around it: the console's channel, the receiver's socket, a gateway on its bus."""

    process: subprocess.Popen[bytes]
    console: Channel
    ears: socket.socket
    config: CarConfig
    ready: Any = None
    packets: list[tuple[float, bytes]] = field(default_factory=list)  # drive time of taking them, bytes
    statuses: list[GatewayStatus] = field(default_factory=list)
    tick: int = 0

    @property
    def now(self) -> float:
        return time.monotonic() - self.config.t0

    def listen(self) -> None:
        while select.select([self.ears], [], [], 0.0)[0]:
            self.packets.append((self.now, self.ears.recv(4096)))

    def listen_for(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.listen()
            time.sleep(0.005)

    def fixes(self) -> list[Fix]:
        decoder = Decoder()
        return [fix for at, data in self.packets for fix in decoder.feed(data, at)]

    def truth(self) -> list[dict[str, str]]:
        with self.config.truth.open() as file:
            return list(csv.DictReader(file))

    def drive(self, bus: Bus, gateway: Gateway, seconds: float, wish: Callable[[float, GatewayStatus], Any]) -> None:
        """Step the gateway at 50 Hz; its clock is that of the ticks, so that a busy machine is no fault of its own.

        `wish` gives acceleration and act for the car's speed and the last status.
        """
        decoder, speed, place, begun = Decoder(), 0.0, (0.0, 0.0, 0.0), time.monotonic() - self.tick * PERIOD
        for tick in range(self.tick + 1, self.tick + 1 + round(seconds / PERIOD)):
            time.sleep(max(0.0, begun + tick * PERIOD - time.monotonic()))
            heard = len(self.packets)
            self.listen()
            for at, data in self.packets[heard:]:
                for fix in decoder.feed(data, at):
                    speed, place = math.hypot(fix.velocity_north, fix.velocity_east), place_of(fix)
            now, last = tick * PERIOD, self.statuses[-1] if self.statuses else None
            acceleration, command = wish(speed, last) if last else (0.0, None)
            setpoint = complete(
                0.0, acceleration, sequence=tick, time=now, expires=now + 0.1, x=place[0], y=place[1],
                heading=place[2], speed=speed, yaw_rate=0.0,
            )  # fmt: skip
            if place == (0.0, 0.0, 0.0):
                setpoint = None  # nothing is known yet
            output = gateway.step(now, setpoint, bus.drain(), command)
            for frame in output.frames:
                bus.send(frame)
            self.statuses.append(output.status)
            self.tick = tick


LATITUDE = math.radians(40.002)
EARTH_RADIUS = 6_371_000.0  # [m]


def place_of(fix: Fix) -> tuple[float, float, float]:
    """East and north of the equator [m], good to compare places that are near each other, and heading [rad]."""
    return fix.longitude * EARTH_RADIUS * math.cos(LATITUDE), fix.latitude * EARTH_RADIUS, fix.heading


@pytest.fixture
def launch(tmp_path) -> Iterator[Callable[..., Running]]:
    running: list[Running] = []

    def begin(**changes: Any) -> Running:
        ears = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        ears.bind(("127.0.0.1", 0))
        config = configuration(tmp_path / "truth.csv", ears.getsockname()[1], **changes)
        ours, theirs = pair()
        car = Running(start("simulated_vehicle", config.to_dict(), {"console": theirs}), ours, ears, config)
        running.append(car)
        assert select.select([ours], [], [], 20.0)[0], "the car says that it is ready"
        car.ready = decode(ours.receive()[0])
        return car

    yield begin
    for car in running:
        car.process.kill()
        car.process.wait()
        car.ears.close()
        car.console.close()


def engaging(then: float) -> Callable[[float, GatewayStatus], Any]:
    """An operator who engages once, says go until the car moves, and asks for `then` [m/s2] all the while."""
    engaged = False

    def wish(speed: float, last: GatewayStatus) -> Any:
        nonlocal engaged
        if last.state is ArmingState.READY and not engaged:
            engaged = True
            return then, OperatorCommand.ENGAGE
        return then, OperatorCommand.GO if last.state is ArmingState.ENGAGED and speed < 0.3 else None

    return wish


def gateway_of(car: Running) -> Gateway:
    parameters = car.config.parameters
    return Gateway(parameters.vehicle, calibration=parameters.calibration, period=PERIOD)


def test_what_is_told_is_heard(tmp_path):
    parameters = vehicles.parameters(
        vehicles.FUSION.mounting,
        interface=InterfaceConfig("dataspeed_dbw1", {"variant": "dbw1_2018"}),
        noise=1.0,
        mass_factor=1.1,
        grade=0.02,
    )
    config = configuration(
        tmp_path / "truth.csv",
        3000,
        parameters=parameters,
        bus=("socketcan", "vcan0"),
        faults=(InjectedFault("pose_jump", 1.0, 2.0, 3.0), InjectedFault("pose_lost", 4.0, math.inf)),
    )
    heard = CarConfig.from_dict(json.loads(json.dumps(config.to_dict())))
    assert heard.parameters == parameters
    assert (heard.lot.projection, heard.lot.offset) == (LOT.projection, LOT.offset)
    assert json.dumps(heard.to_dict()) == json.dumps(config.to_dict())
    assert configuration(None, 3000).to_dict() == CarConfig.from_dict(configuration(None, 3000).to_dict()).to_dict() | {
        "t0": pytest.approx(time.monotonic(), abs=5.0)
    }


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seed": "seven"}, "simulated vehicle: Expected `int`, got `str` - at `$.seed`"),
        ({"lot": {}}, "simulated vehicle: expected a map's projection and offset - at `$.lot`"),
        ({"faults": [{"kind": "no_such", "at": 1.0, "duration": 1.0}]}, "kind must be one of"),
    ],
)
def test_a_configuration_that_is_none_is_refused_in_one_line(change: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        CarConfig.from_dict(configuration(None, 3000).to_dict() | change)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_full_disk_ends_the_truth_and_not_the_car():
    with Path("/dev/full").open("wb", buffering=0) as full:
        truth = TruthFile(full)
        truth.flush()
        truth.flush()


def test_a_bus_that_is_down_is_a_silent_one():
    with can.Bus(interface="virtual", channel="node") as other:
        bus = Bus("virtual", "node")
        node = PythonCanWire(bus)
        node.send([Frame(0x61, b"\x01"), Frame(0x65, b"")])
        assert [other.recv(1.0).arbitration_id for _ in range(2)] == [0x61, 0x65]
        other.send(can.Message(arbitration_id=0x60, data=b"\x07", is_extended_id=False))
        assert node.receive() == [Frame(0x60, b"\x07")]
        bus.close()
        node.send([Frame(0x61, b"\x01")])
        assert node.receive() == []


@pytest.mark.thorough
@pytest.mark.live
def test_a_gateway_on_the_pty_drives_it_and_brakes_it_to_rest(launch):
    car = launch()
    assert car.ready.address[0] == "slcan"
    with Bus(*car.ready.address) as bus:
        gateway = gateway_of(car)
        car.drive(bus, gateway, 4.5, engaging(2.0))
        assert car.statuses[-1].state is ArmingState.ENGAGED, car.statuses[-1].reasons
        car.drive(bus, gateway, 3.5, lambda *_: (-3.0, None))
        car.drive(bus, gateway, 1.5, lambda speed, last: (0.0, OperatorCommand.STOP))
        stopped = [status for status in car.statuses if status.state is ArmingState.STOPPED]
        assert stopped
        assert stopped[0].reasons[0] == "stop_asked"
    car.console.close()
    assert car.process.wait(10.0) == 0
    rows = car.truth()
    assert max(float(row["speed_mps"]) for row in rows) > 3.0
    assert {row["gear"] for row in rows} == {"park", "drive"}
    assert (rows[-1]["gear"], float(rows[-1]["speed_mps"])) == ("park", 0.0)
    assert_fixes_tell_the_truth(car, rows)


def assert_fixes_tell_the_truth(car: Running, rows: list[dict[str, str]]) -> None:
    truths = {round(float(row["time_s"]), 3): row for row in rows}
    times = [round(float(row["time_s"]), 3) for row in rows]
    assert [round(b - a, 3) for a, b in pairwise(times)] == [0.01] * (len(times) - 1), "100 Hz without a gap"
    placement = Placement(LOT, Alignment(), car.config.parameters.receiver.mounting, EPOCH)
    poses = [placement.place(fix) for fix in car.fixes()]
    compared = [(pose, truths[round(pose.time, 3)]) for pose in poses if round(pose.time, 3) in truths]
    # What a busy machine made too late is not sent.
    assert len(compared) > 0.5 * (poses[-1].time - poses[0].time) * 100
    for pose, truth in compared:
        assert pose.speed == pytest.approx(float(truth["speed_mps"]), abs=1e-3)
        assert math.hypot(pose.x - float(truth["x_m"]), pose.y - float(truth["y_m"])) < 1e-3
        assert math.remainder(pose.heading - float(truth["heading_rad"]), math.tau) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.live
def test_it_outlives_console_and_gateway_and_comes_to_rest_by_its_own_watchdog(launch):
    car = launch(faults=(InjectedFault("pose_lost", 0.5, 0.5),))
    with Bus(*car.ready.address) as bus:
        car.drive(bus, gateway_of(car), 4.5, engaging(2.0))
        for ignored in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
            car.process.send_signal(ignored)
    car.console.close()
    assert car.process.wait(20.0) == 0
    rows = car.truth()
    speeds = [float(row["speed_mps"]) for row in rows]
    assert max(speeds) > 2.0
    assert {float(row["speed_mps"]) for row in rows[-100:]} == {0.0}, "it ends a second after it has come to rest"
    # A busy machine delays what the car hears: of the console, and of frames that are still on their way to it.
    assert max(speeds[-500:]) > 0.0, "and not much later"
    assert rows[-1]["watchdog_braking"] == "1"
    epochs = [fix.time for fix in car.fixes()]
    assert max(b - a for a, b in pairwise(epochs)) == pytest.approx(0.51, abs=0.005), "the injected gap"


@pytest.mark.live
def test_asked_to_end_while_it_stands_it_ends(launch):
    car = launch()
    for ignored in (signal.SIGINT, signal.SIGHUP):
        car.process.send_signal(ignored)
    car.listen_for(1.5)
    assert car.process.poll() is None
    assert len(car.fixes()) > 100
    car.process.send_signal(signal.SIGTERM)
    assert car.process.wait(5.0) == 0


@pytest.mark.live
def test_after_a_stall_it_has_lived_through_and_says_nothing_stale(launch):
    car = launch()
    car.listen_for(1.5)
    car.process.send_signal(signal.SIGSTOP)
    car.listen_for(0.8)
    car.process.send_signal(signal.SIGCONT)
    car.listen_for(1.0)
    car.process.send_signal(signal.SIGTERM)
    assert car.process.wait(5.0) == 0
    times = [round(float(row["time_s"]), 3) for row in car.truth()]
    assert [round(b - a, 3) for a, b in pairwise(times)] == [0.01] * (len(times) - 1)
    fixes = car.fixes()
    gaps = [b.time - a.time for a, b in pairwise(fixes)]
    assert 0.5 < max(gaps) < 1.0
    resumed = fixes[gaps.index(max(gaps)) + 1]
    assert resumed.time_received - (resumed.time - EPOCH) < 0.4, "0.1 s, and what a busy machine adds"


@pytest.mark.thorough
def test_a_bus_that_cannot_be_opened_is_one_line_and_an_exit_code(launch):
    car = launch(bus=("socketcan", "vve_none0"))
    assert car.ready.text.startswith("CAN bus socketcan:vve_none0 cannot be opened: ")
    assert car.process.wait(5.0) == 3
