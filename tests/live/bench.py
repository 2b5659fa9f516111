"""A test bench of real processes: gateway, recorder and a sender of setpoints, around a small car in the test itself.

The car hangs on a serial adapter made of software; the test is its clock, its operator and its saboteur.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.live.patience import until
from tests.record.declared import RESOLVED
from tests.setpoints import setpoint as complete
from tests.vehicle.car import FUSION, PERIOD, Car
from vve_sumo.live.channel import pair
from vve_sumo.live.priority import VEHICLE_PRIORITY
from vve_sumo.live.slcan import Adapter
from vve_sumo.live.spawn import start
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.limits import Limits

EPOCH = 1000.0
FIRST_ID = 0x060  #: of the four frames of a step: the brake command's
LIFETIME = 0.1
WAITING = "waiting_for_go"


#: frames of one step, in order
COMMANDS = [codec.BRAKE_COMMAND, codec.THROTTLE_COMMAND, codec.STEERING_COMMAND, layout.GEAR_COMMAND]


class Heard(NamedTuple):
    """What the car was commanded in one step of the gateway."""

    time: float  #: drive time of the last of the four frames [s]
    brake: codec.BrakeCommand
    throttle: codec.ThrottleCommand
    steering: codec.SteeringCommand
    gear: codec.GearCommand


@dataclasses.dataclass
class LiveCar(Car):
    """The car of the tests in real time: its last command goes on where nothing new comes."""

    _throttle_wish: float = 0.0

    def advance(self, period: float = PERIOD, steps: int = 10) -> None:
        """Move on by one period."""
        del self._brake_pipe[:-2]
        if len(self._brake_pipe) == 1:
            self._brake_pipe *= 2
        super().advance(period, steps)


class Bench:
    """Everything that a gateway's process needs around it, in real time as long as `run` runs."""

    def __init__(self, folder: Path, *, sender: bool = True, **changes: object) -> None:
        """Open the bench; without a `sender` of its own, setpoints come from the test while it runs."""
        self.folder, self.t0 = folder, time.monotonic()
        self.car, self.adapter = LiveCar(), Adapter()
        self.heard: list[Heard] = []
        self.feedbacks: list[link.Feedback] = []
        self._group: list[Frame] = []
        self._next = 0.0
        self._sequence = 0
        drive_end, self.drive_end = pair()  #: the end that the drive would hold; given away to a sender
        console_end, self.console = pair()
        tap_end, recorder_end = pair()
        to_recorder, spare = pair()
        self.spare = spare  # the drive's tap, which says nothing here
        _prefer_the_car(True)
        record = {"folder": str(folder), "resolved": RESOLVED, "epoch": EPOCH, "provenance": "{}", "log": None}
        self.recorder = start("recorder", record, {"drive": to_recorder, "gateway": recorder_end}, own_session=True)
        until(lambda: (folder / "latency.arrows").exists())
        channels = {"drive": drive_end, "console": console_end, "recorder": tap_end}
        self.gateway = start("gateway", self._config() | changes, channels, own_session=True)
        self.sender = self._start_sender() if sender else None

    def _config(self) -> dict[str, object]:
        return {
            "vehicle": dataclasses.asdict(FUSION),
            "calibration": dataclasses.asdict(vehicles.FUSION.calibration),
            "limits": dataclasses.asdict(Limits()),
            "interface": {"name": "dataspeed_dbw1", "settings": {"variant": self.car.variant.name.lower()}},
            "period": PERIOD,
            "bus": {"interface": "slcan", "channel": self.adapter.name, "bitrate": 500_000},
            "t0": self.t0,
            "epoch": EPOCH,
            "shadow": False,
            "wheel_bias": 0.0,
            "stop_can_id": None,
            "silent": False,
            "log": str(self.folder / "gateway.txt"),
        }

    def _start_sender(self) -> subprocess.Popen[bytes]:
        number = self.drive_end.fileno()
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.live.sender", str(number), repr(self.t0)],
            cwd=REPOSITORY,
            pass_fds=(number,),
        )
        self.drive_end.close()
        return process

    @property
    def now(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self.t0

    @property
    def state(self) -> ArmingState | None:
        """What the gateway last told the console."""
        return self.feedbacks[-1].status.state if self.feedbacks else None

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the gateway last told the console."""
        return self.feedbacks[-1].status.reasons if self.feedbacks else ()

    def act(self, command: OperatorCommand) -> None:
        """Do what an operator does."""
        self.console.send(link.encode_operator_command(command))

    def kill(self, process: subprocess.Popen[bytes] | None, number: int) -> None:
        """Send a signal to one of the processes."""
        assert process is not None
        os.kill(process.pid, number)

    def run(self, duration: float) -> None:
        """Let real time pass."""
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self._once()

    def run_until(self, condition: Callable[[], bool], patience: float = 20.0) -> None:
        """Let real time pass until a condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            failure = f"waited in vain: {self.state}, {self.reasons}, {self.car.speed:.2f} m/s"
            assert time.monotonic() < deadline, failure
            self._once()

    def drive(self, speed: float) -> bool:
        """Engage, go, and reach a speed; False where the machine that the test runs on was too slow for that.

        A machine that stands still for 40 ms stops the car, as it should, and then there is nothing to be tested.
        """
        self.run_until(lambda: self._stalled or self.state is ArmingState.READY)
        self.act(OperatorCommand.ENGAGE)
        self.run_until(lambda: self._stalled or WAITING in self.reasons)
        self.act(OperatorCommand.GO)
        self.run_until(lambda: self._stalled or self.car.speed > speed)
        return not self._stalled

    @property
    def _stalled(self) -> bool:
        reported = {reason for feedback in self.feedbacks for reason in feedback.status.reasons}
        state = self.state in (ArmingState.STOPPING, ArmingState.STOPPED, ArmingState.FAULT)
        return "timer_gap" in reported or state or self.gateway.poll() is not None

    def rest(self) -> None:
        """Let real time pass until the gateway has let go of the car and ended."""
        self.run_until(lambda: self.gateway.poll() is not None)
        self.run(2 * PERIOD)
        assert self.gateway.returncode == 0
        assert abs(self.car.speed) < 0.01

    def since(self, moment: float) -> list[Heard]:
        """What the car was commanded after a moment of drive time."""
        return [heard for heard in self.heard if heard.time > moment]

    def close(self) -> None:
        """End everything."""
        for process in (self.sender, self.gateway, self.recorder):
            if process is not None:
                process.kill()
                process.wait()
        _prefer_the_car(False)
        with contextlib.suppress(OSError):  # a test may have pulled it out
            self.adapter.close()

    def _setpoint(self) -> Setpoint:
        self._sequence += 1
        now = self.now
        return complete(
            0.0, 1.0, sequence=self._sequence, time=now, expires=now + LIFETIME, x=self.car.x, y=0.0, heading=0.0,
            speed=self.car.speed, yaw_rate=0.0,
        )  # fmt: skip

    def _once(self) -> None:
        for frame in self.adapter.receive():
            if frame.id == FIRST_ID:
                self._group.clear()  # of an earlier step that the bus did not take as a whole
            self._group.append(frame)
            if len(self._group) == 4 and [frame.id for frame in self._group] != COMMANDS:
                self._group.clear()  # the bus did not take all of this step
            elif len(self._group) == 4:
                self.heard.append(Heard(self.now, *(codec.decode(f, self.car.variant) for f in self._group)))
                self.car.hear(tuple(self._group))
                self._group.clear()
        for data in self.console.receive():
            self.feedbacks.append(link.decode_feedback(data))
        if self.now >= self._next:
            self._next += PERIOD
            if not self.drive_end.closed:
                self.drive_end.send(link.encode_setpoint(self._setpoint()))
            self.car.advance()
            self.adapter.send(self.car.reports())
        time.sleep(0.001)


def _prefer_the_car(on: bool) -> None:
    """Where the system allows it, let this process, which is the car, run before what else the machine does."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if on else os.SCHED_OTHER
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, policy, os.sched_param(VEHICLE_PRIORITY if on else 0))


def stop(bench: Bench, process: subprocess.Popen[bytes] | None, duration: float) -> None:
    """Freeze a process for a while, with time going on for everybody else."""
    bench.kill(process, signal.SIGSTOP)
    bench.run(duration)
    bench.kill(process, signal.SIGCONT)
