"""Gateway, simulated vehicle and sender as processes on a wire; the suite is their operator, recorder and saboteur."""

from __future__ import annotations

import csv
import dataclasses
import math
import select
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from tests import vehicles
from tests.vm.sender import PERIOD, Sender
from tests.vm.wires import FRAME, Heard, Wire, Witness, open_raw
from vve_sumo.frames import MapFrame
from vve_sumo.live.channel import pair
from vve_sumo.live.messages import Ready, decode
from vve_sumo.live.recorder_client import RECORD, RecordBatch
from vve_sumo.live.simulated_vehicle import CarConfig
from vve_sumo.live.spawn import start
from vve_sumo.record.rows import GatewayRow
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.interface import ActuationCommand, Gear
from vve_sumo.vehicle.limits import Limits

LOT = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-82.98 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
EPOCH = 1_447_000_000.0
LOOK = 0.02
NOBODY = ("127.0.0.1", 9)  # listens to the car's NCOM


class LiveCar:
    """The car's process on a wire; it stands in park between two drives."""

    def __init__(self, wire: Wire, folder: Path) -> None:
        self.t0 = time.monotonic()
        self.truth_file = folder / f"truth-{wire.car}.csv"
        self.parameters = vehicles.parameters(noise=0.0)
        config = CarConfig(
            self.parameters,
            LOT,
            40.0,
            -82.98,
            0.0,
            EPOCH,
            self.t0,
            1,
            {"kind": "ncom_udp", "address": NOBODY[0], "port": NOBODY[1], "minimum_delay_ms": 10.0},
            ("socketcan", wire.car),
            (),
            self.truth_file,
        )
        self.console, theirs = pair()
        self._process = start("simulated_vehicle", config.to_dict(), {"console": theirs})
        assert select.select([self.console], [], [], 30.0)[0], "the car says that it is ready"
        said = decode(self.console.receive()[0])
        assert isinstance(said, Ready), said

    def truth(self, since: float) -> list[tuple[float, float, float]]:
        """Drive time [s], x [m] along the start's heading and speed [m/s], since a drive time."""
        with self.truth_file.open() as file:
            rows = [(float(row["time_s"]), float(row["y_m"]), float(row["speed_mps"])) for row in csv.DictReader(file)]
        return [row for row in rows if row[0] >= since]

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()


class Bench:
    """One drive of one gateway process over a wire."""

    def __init__(self, wire: Wire, car: LiveCar, *, cruise: bool, silent: bool = False) -> None:
        self._silent = silent
        self.car, self.t0 = car, car.t0
        self.witness = Witness(wire.car, layout.COMMAND_IDS | {layout.GEAR_REPORT})
        self.begun = self.now
        self.rows: list[GatewayRow] = []
        self.sent: list[Frame] = []
        self.states: list[ArmingState] = []
        self.reasons: tuple[str, ...] = ()
        self.speed = 0.0
        to_gateway, drive = pair()
        self.sender = Sender(to_gateway, drive, self.t0, cruise)
        self.console, console = pair()
        self._recorder, recorder = pair()
        channels = {"drive": drive, "console": console, "recorder": recorder}
        self.gateway: subprocess.Popen[bytes] = start("gateway", self._config(wire), channels, own_session=True)

    def _config(self, wire: Wire) -> dict[str, object]:
        parameters = self.car.parameters
        return {
            "vehicle": dataclasses.asdict(parameters.vehicle),
            "calibration": dataclasses.asdict(parameters.calibration),
            "limits": dataclasses.asdict(Limits()),
            "interface": dataclasses.asdict(parameters.interface),
            "period": PERIOD,
            "bus": {"interface": "socketcan", "channel": wire.gateway, "bitrate": 500_000},
            "t0": self.t0,
            "epoch": EPOCH,
            "shadow": False,
            "wheel_bias": 0.0,
            "stop_can_id": None,
            "silent": self._silent,
            "log": None,
        }

    @property
    def now(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self.t0

    def act(self, act: OperatorCommand) -> None:
        """Do what an operator does."""
        assert self.console.send(link.encode_operator_command(act))

    def until(self, condition: Callable[[], bool], patience: float = 20.0) -> None:
        """Let time pass until a condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            there = self.gateway.poll() is None and time.monotonic() < deadline
            self.run(LOOK)
            assert there or condition(), f"waited in vain: {self.states}, {self.reasons}, {self.speed:.2f} m/s"

    def run(self, duration: float) -> None:
        """Let time pass, hearing everything."""
        end = time.monotonic() + duration
        while True:
            self._listen()
            if (left := end - time.monotonic()) <= 0.0:
                return
            time.sleep(min(left, LOOK))

    def engage(self) -> None:
        """Take the car over and let it go."""
        # The first words come when Python has imported everything, some two seconds of the machine's clock.
        self.until(lambda: ArmingState.READY in self.states, patience=30.0)
        self.act(OperatorCommand.ENGAGE)
        self.until(lambda: "waiting_for_go" in self.reasons)
        self.act(OperatorCommand.GO)

    def finish(self) -> None:
        """Wait for the gateway's own end, and let everything be said."""
        self.until(lambda: self.gateway.poll() is not None)
        self._listen()

    def _listen(self) -> None:
        self.witness.listen()
        for data in self.console.receive():
            feedback = link.decode_feedback(data)
            assert isinstance(feedback, link.Feedback)
            if not self.states or feedback.status.state is not self.states[-1]:
                self.states.append(feedback.status.state)
            self.reasons, self.speed = feedback.status.reasons, feedback.wheel_speed
        for data in self._recorder.receive():
            batch = RECORD.decode(data)
            assert isinstance(batch, RecordBatch), batch
            self.rows += [row for (row,) in batch.stepped]
            frames = [frame for _time, _channel, seen in batch.saw_frames for frame in seen]
            self.sent += [frame for frame in frames if frame.id in layout.COMMAND_IDS]

    def commands(self, kind: int) -> list[Heard]:
        """Everything that the wire carried of one kind, on drive time."""
        return [Heard(heard.time - self.t0, heard.frame) for heard in self.witness.heard if heard.frame.id == kind]

    def close(self) -> None:
        """End everything."""
        self.sender.end()
        self.gateway.kill()
        self.gateway.wait()
        self.witness.close()


class Brain:
    """An external controller on the car's side of the wire, on a socket of the kernel's own; it drives straight on."""

    def __init__(self, wire: Wire) -> None:
        self.sent: list[Frame] = []
        self._raw, self._interface = open_raw(wire.car), DataspeedDbw1()
        self._due = -math.inf

    def step(self, torque: float, throttle: float, gear: Gear, *, enable: bool = True) -> None:
        """Send the four frames of a command where they are due."""
        if (now := time.monotonic()) < self._due:
            return
        self._due = now + PERIOD
        clear = not self.sent
        command = ActuationCommand(torque, throttle, 0.0, 1.0, gear, enable, clear)
        for frame in self._interface.encode(command):
            self._raw.send(FRAME.pack(frame.id, len(frame.data), frame.data))
            self.sent.append(frame)

    def close(self) -> None:
        """Leave the wire."""
        self._raw.close()
