"""The operator's side of a live drive: keys become operator commands, status messages become words and bells.

The gateway hears its acts directly, so a drive that hangs can still be stopped. Nothing here computes anything that
moves the car, and nothing is done by itself but where the rig says that no person is there.
"""

from __future__ import annotations

import contextlib
import json
import math
import select
import subprocess
import time
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.drive.lockstep import WAITING, ScriptedOperator
from vve_sumo.live.channel import ALIVE, Channel
from vve_sumo.live.keys import KeyCommand, OperatorInput
from vve_sumo.live.screen import Screen
from vve_sumo.live.wording import Guard, answer, why
from vve_sumo.values import ArmingState
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, ENDING
from vve_sumo.vehicle.gateway import OperatorCommand

#: between two looks at everything [s]
POLL_INTERVAL: Final = 0.05
#: a gateway that has told nothing for so long is not run [s]: it tells something every 0.1 s, give or take a step; with
#: one look more this is on the screen within 0.3 s
SILENT: Final = 0.2
#: a gateway that ended while the car was its own is cried out for so long [s]
ALARM_TIME: Final = 3.0
#: for a drive that hangs: its last words to the recorder take 5 s at most, and its street is to be closed [s]
DRIVE_TIMEOUT: Final = 8.0
#: a rig that drives by itself and is not ready by then never will be [s]
READY_LIMIT: Final = 60.0

_ACTS: Final = {
    KeyCommand.ENGAGE: OperatorCommand.ENGAGE,
    KeyCommand.GO: OperatorCommand.GO,
    KeyCommand.RESET: OperatorCommand.DISARM,
}
#: commands that count only while the gateway waits for them, and their keys
_KEYS: Final = {KeyCommand.ENGAGE: "e", KeyCommand.GO: "g"}
#: the gateway's word for a go that it did not take
TOO_EARLY: Final = "go_too_early"


@dataclass(slots=True)
class ProcessGroup:
    """The processes of a live drive as the console holds them."""

    gateway: subprocess.Popen[bytes]
    drive: subprocess.Popen[bytes]
    recorder: subprocess.Popen[bytes]
    car: subprocess.Popen[bytes] | None  #: the simulated one
    to_gateway: Channel
    to_drive: Channel
    to_car: Channel | None

    def shutdown(self, timeout: float) -> None:
        """Let every process end as it means to, drive before recorder before car; kill what hangs after the gateway.

        The gateway is never killed: as long as it runs it holds the car, or still tries to.
        """
        self.to_gateway.close()
        self.to_drive.close()
        self.gateway.wait()
        _end(self.drive, min(timeout, DRIVE_TIMEOUT))
        _end(self.recorder, timeout)
        if self.car is not None and self.to_car is not None:
            self.to_car.close()
            _end(self.car, timeout)


def _end(process: subprocess.Popen[bytes], timeout: float) -> None:
    try:
        process.wait(timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Console:
    """Runs until the gateway has let go of the car."""

    def __init__(self, processes: ProcessGroup, keys: OperatorInput, screen: Screen, automatic: bool) -> None:
        """Take commands from `keys`, and with `automatic` from the rig itself."""
        self._processes, self._keys, self._screen = processes, keys, screen
        self._operator = ScriptedOperator() if automatic else None
        self._state = ArmingState.DISARMED
        self._engaged = self._over = self._stops = self._ends = self._left = False
        self._heard_at = math.inf  # when the gateway last told something; never yet
        self._begun = time.monotonic()
        self._status: dict[str, Any] = {"went": False}  # a go has been sent, and was not refused
        self.why: tuple[str, ...] = ()  #: the gateway's last reasons for stopping the car, or for letting go of it
        self.refused: tuple[str, int] | None = None  #: why the drive never began, and the exit code for that

    def run(self) -> None:
        """Look after the drive to its end."""
        processes = self._processes
        while processes.gateway.poll() is None:
            watched = [*self._keys.filenos(), *self._alive(processes.to_gateway), *self._alive(processes.to_drive)]
            select.select(watched, [], [], POLL_INTERVAL)
            for command in self._keys.commands():
                self._obey(command)
            self._hear_drive()
            # Before listening: a console that was not run itself finds what it has missed, and takes it for no silence.
            begun = time.monotonic()
            self._hear_gateway()
            self._judge()
            self._speak()
            self._show(Guard.SILENT if begun - self._heard_at > SILENT else Guard.HEARD)
        self._hear_gateway()
        if not self._engaged and not self._over:
            self._refuse("the gateway's process ended before anything moved; see gateway.log in the record", 3)
        if self._state in COMMANDING:
            self._cry_out()
        else:
            self._show(Guard.ENDED)

    def _show(self, guard: Guard) -> None:
        if self._left or (self._processes.to_gateway.closed and guard is Guard.SILENT):
            # One that has let go of its channel is on its way out: it tells nothing because it is done.
            guard = Guard.LEFT if self._left else Guard.HEARD
        self._status |= {"gateway": guard.value, "engaged": self._engaged}
        self._screen.show(self._status)

    def _cry_out(self) -> None:
        """Tell for a while that nobody commands a car that was commanded."""
        until = time.monotonic() + ALARM_TIME
        while not self._left and time.monotonic() < until:
            self._show(Guard.GONE)
            time.sleep(POLL_INTERVAL)
        self._show(Guard.GONE)

    @staticmethod
    def _alive(channel: Channel) -> list[int]:
        return [] if channel.closed else [channel.fileno()]

    def _obey(self, command: KeyCommand) -> None:
        if command is KeyCommand.GONE:
            # The gateway finds nobody at the controls, and brings the car to rest for that.
            self._leave()
            return
        waited_for = self._waited_for(command)
        if command in _KEYS and not waited_for and self._is_early(command):
            self._screen.say(answer(_KEYS[command], self._status))
        if self._engaged and not waited_for:
            command = KeyCommand.STOP
        if command is KeyCommand.STOP:
            self._stops = True
            if not self._engaged:
                # Nothing moves yet: to stop is not to begin.
                self._leave()
        elif command is KeyCommand.RESET or waited_for:
            self._act(_ACTS[command])

    def _waited_for(self, command: KeyCommand) -> bool:
        """Whether the gateway waits for this now."""
        if command is KeyCommand.GO:
            return self._state is ArmingState.ENGAGED and WAITING in self._status.get("reasons", ())
        return command is KeyCommand.ENGAGE and self._state is ArmingState.READY

    def _is_early(self, command: KeyCommand) -> bool:
        """Whether somebody is to be told that the time for this has not come; once the car goes, every key stops."""
        if not self._engaged:
            return not self._over
        return command is KeyCommand.GO and self._state is ArmingState.ENGAGED and not self._status["went"]

    def _act(self, act: OperatorCommand) -> None:
        self._processes.to_gateway.send(link.encode_operator_command(act))
        if act is OperatorCommand.GO:
            self._status["went"] = True

    def _speak(self) -> None:
        """Show the gateway that somebody is there, and say stop until it is heard."""
        if self._processes.to_gateway.closed:
            return
        self._processes.to_gateway.send(ALIVE)
        if (self._stops or self._ends) and self._state in (ArmingState.READY, ArmingState.ENGAGED):
            command = OperatorCommand.STOP if self._stops else OperatorCommand.END
            self._processes.to_gateway.send(link.encode_operator_command(command))

    def _leave(self) -> None:
        self._over = self._left = True
        self._processes.to_gateway.close()

    def _hear_drive(self) -> None:
        if self._processes.to_drive.closed:
            return
        for data in self._processes.to_drive.receive():
            message = json.loads(data)
            if "refused" in message:
                self.refused = (message["refused"], message["exit_code"])
            else:
                self._status |= message

    def _hear_gateway(self) -> None:
        if self._processes.to_gateway.closed:
            return
        for data in self._processes.to_gateway.receive():
            feedback = link.decode_feedback(data)
            if not isinstance(feedback, link.Feedback):
                self._hear_refusal(data)
                continue
            verdict = feedback.verdict
            self._heard_at = time.monotonic()
            if TOO_EARLY in verdict.reasons:
                self._status["went"] = False
            self._state = verdict.state
            self._engaged |= verdict.state in COMMANDING
            if verdict.state in ENDING:
                self.why = verdict.reasons
            self._status |= {
                "time_s": feedback.time,
                "state": verdict.state.value,
                "reasons": list(verdict.reasons),
                "wheel_speed_mps": feedback.wheel_speed,
                "gear": feedback.gear,
            }
            if self._operator is not None and not self._over:
                self._operator.observe(verdict)
                act = self._operator.next_command()
                if act is not None:
                    self._act(act)

    def _hear_refusal(self, data: bytes) -> None:
        """Take what a gateway says whose bus cannot be opened."""
        with contextlib.suppress(ValueError):
            message = json.loads(data)
            self.refused = (message["refused"], message["exit_code"])

    def _judge(self) -> None:
        """End what has come to its end, and what never begins."""
        if self._over:
            return
        if self._status.get("outcome") is not None and self._state is ArmingState.ENGAGED:
            self._over = self._ends = True
        elif not self._engaged and self._processes.drive.poll() is not None:
            self._refuse("the drive's process ended before anything moved", 4)
        elif not self._engaged and self._processes.recorder.poll() is not None:
            self._refuse("the recorder's process ended before anything moved", 3)
        elif self._operator is not None and not self._engaged and time.monotonic() - self._begun > READY_LIMIT:
            missing = "; ".join(why(self._status)) or "the gateway does not answer"
            self._refuse(f"not ready after {READY_LIMIT:.0f} s: {missing}", 3)

    def _refuse(self, why: str, exit_code: int) -> None:
        self._hear_drive()
        self.refused = self.refused or (why, exit_code)
        self._leave()
