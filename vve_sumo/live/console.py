"""The operator's side of a live drive: turns keys into operator commands, status messages into text and bells.

Commands go straight to the gateway, so the car can be stopped while the drive's process hangs. Nothing here computes
anything that moves the car. The console engages and goes by itself only with a rig that declares `operator.automatic`.
"""

from __future__ import annotations

import math
import select
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from vve_sumo.drive.lockstep import ScriptedOperator
from vve_sumo.drive.reasons import in_words
from vve_sumo.live import messages, spawn
from vve_sumo.live.channel import ALIVE, Channel
from vve_sumo.live.jitter_wait import CALM_TIMEOUT
from vve_sumo.live.keys import KeyCommand, OperatorInput
from vve_sumo.live.screen import Screen
from vve_sumo.live.wording import GatewayProcessState, answer, doctor_overridden, why
from vve_sumo.values import ArmingState
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, ENDING, WAITING
from vve_sumo.vehicle.arming_machine import OperatorCommand

#: longest wait between two passes of the loop [s]
POLL_INTERVAL: Final = 0.05
#: a gateway without a message for this long counts as silent [s]: it sends one every 0.1 s, give or take a step; with
#: one more pass of the loop the alarm is on the screen within 0.3 s
SILENT: Final = 0.2
#: duration of the alarm for a gateway that ended while it commanded the car [s]
ALARM_TIME: Final = 3.0
#: time for the drive's process to end [s]: its last messages to the recorder take up to 5 s, and SUMO has to be closed
DRIVE_TIMEOUT: Final = 8.0
#: time for the page's process to end [s]
VIEW_TIMEOUT: Final = 3.0
#: an automatic rig that is not engaged by then is refused [s]; it may wait CALM_TIMEOUT for a calm second
READY_TIMEOUT: Final = 60.0 + CALM_TIMEOUT

_ACTS: Final = {
    KeyCommand.ENGAGE: OperatorCommand.ENGAGE,
    KeyCommand.GO: OperatorCommand.GO,
    KeyCommand.RESET: OperatorCommand.DISARM,
}
#: commands that count only while the gateway waits for them, and their keys
_KEYS: Final = {KeyCommand.ENGAGE: "e", KeyCommand.GO: "g"}
#: the gateway's reason code for a go that it rejected
GO_TOO_EARLY: Final = "go_too_early"


@dataclass(slots=True)
class ProcessGroup:
    """The processes of a live drive, and the console's channels to them."""

    gateway: subprocess.Popen[bytes]
    drive: subprocess.Popen[bytes]
    recorder: subprocess.Popen[bytes]
    car: subprocess.Popen[bytes] | None  #: the simulated one
    outputs: subprocess.Popen[bytes] | None  #: of the outgoing wires; it ends with the drive
    view: subprocess.Popen[bytes] | None  #: of the page in a browser
    people: subprocess.Popen[bytes] | None  #: of the people's pages; it ends with the drive
    stations: subprocess.Popen[bytes] | None  #: of a real on-board unit; it ends with the drive
    to_gateway: Channel
    to_drive: Channel
    to_car: Channel | None
    to_view: Channel | None  #: whatever comes out of it is a request to stop; the verdict goes in

    def shutdown(self, timeout: float) -> None:
        """Wait for the gateway, the drive, the recorder and the car to end, in this order; kill a later one that hangs.

        The gateway is never killed: as long as it runs, it holds the car or still tries to. The page goes on until
        `end_view`.
        """
        if self.to_view is not None:
            self.to_view.send(b'{"kind": "ended"}')  # from here on nobody takes a page's request to stop
        self.to_gateway.close()
        self.to_drive.close()
        self.gateway.wait()
        spawn.end(self.drive, min(timeout, DRIVE_TIMEOUT))
        if self.outputs is not None:
            spawn.end(self.outputs, DRIVE_TIMEOUT)
        if self.people is not None:
            spawn.end(self.people, VIEW_TIMEOUT)
        if self.stations is not None:
            spawn.end(self.stations, VIEW_TIMEOUT)
        spawn.end(self.recorder, timeout)
        if self.car is not None and self.to_car is not None:
            self.to_car.close()
            spawn.end(self.car, timeout)

    def end_view(self, verdict: Mapping[str, Any] | None = None) -> None:
        """Show a drive's verdict on the page, as `words.verdict_of` has it, and end the page; again is nothing."""
        if self.view is None or self.to_view is None:
            return
        if verdict is not None:
            self.to_view.send(messages.encode(messages.Verdict(dict(verdict))))
        self.to_view.close()
        spawn.end(self.view, VIEW_TIMEOUT)


class Console:
    """The operator's console; runs until the gateway's process has ended."""

    def __init__(
        self, processes: ProcessGroup, keys: OperatorInput, screen: Screen, automatic: bool, overridden: str = ""
    ) -> None:
        """Take commands from `keys`, and with `automatic` also from a `ScriptedOperator`.

        `overridden` is why the car is armed without the doctor's GO; the screen shows it for the whole drive.
        """
        self.processes, self._keys, self._screen = processes, keys, screen
        self._operator = ScriptedOperator() if automatic else None
        self._state = ArmingState.DISARMED
        self._engaged = self._over = self._ends = self._left_by_operator = False
        self._stop: OperatorCommand | None = None  # whose stop is to be sent: the operator's, or the page's
        self._heard_at = math.inf  # time of the gateway's last message; inf before the first
        self._begun = time.monotonic()
        # `went`: a go has been sent, and was not refused
        self._status: dict[str, Any] = {"went": False, "doctor_overridden": overridden}
        if overridden:
            screen.say(doctor_overridden(overridden))
        self.why: tuple[str, ...] = ()  #: the gateway's last reasons for stopping the car, or for letting go of it
        self.refused: messages.Refused | None = None  #: why the drive never began, and the exit code for that

    def run(self) -> None:
        """Serve the operator until the gateway's process ends."""
        processes = self.processes
        while processes.gateway.poll() is None:
            channels = (processes.to_gateway, processes.to_drive, processes.to_view)
            watched = [*self._keys.filenos(), *(number for channel in channels for number in self._alive(channel))]
            select.select(watched, [], [], POLL_INTERVAL)
            for command in self._keys.commands():
                self._apply_key(command)
            self._read_view()
            self._read_drive()
            # Taken before reading: if the console itself was not scheduled, the waiting messages reset the silence.
            begun = time.monotonic()
            self._read_gateway()
            self._judge()
            self._give_commands()
            self._show(
                GatewayProcessState.SILENT if begun - self._heard_at > SILENT else GatewayProcessState.RESPONDING
            )
        self._read_gateway()
        if not self._engaged and not self._over:
            self._refuse("the gateway's process ended before anything moved; see gateway.log in the record", 3)
        if self._state in COMMANDING:
            self._show_gateway_lost()
        else:
            self._show(GatewayProcessState.ENDED)

    def _show(self, state: GatewayProcessState) -> None:
        if self._left_by_operator or (self.processes.to_gateway.closed and state is GatewayProcessState.SILENT):
            # A gateway that has closed its channel is ending: its silence is no alarm.
            state = GatewayProcessState.LEFT if self._left_by_operator else GatewayProcessState.RESPONDING
        self._status |= {"gateway": state.value, "engaged": self._engaged}
        self._screen.show(self._status)

    def _show_gateway_lost(self) -> None:
        """Show for ALARM_TIME that a car that was commanded is commanded no more."""
        until = time.monotonic() + ALARM_TIME
        while not self._left_by_operator and time.monotonic() < until:
            self._show(GatewayProcessState.GONE)
            time.sleep(POLL_INTERVAL)
        self._show(GatewayProcessState.GONE)

    @staticmethod
    def _alive(channel: Channel | None) -> list[int]:
        return [] if channel is None or channel.closed else [channel.fileno()]

    def _apply_key(self, command: KeyCommand) -> None:
        if command is KeyCommand.GONE:
            # The gateway reports operator_gone and brings the car to rest.
            self._leave()
            return
        waited_for = self._waited_for(command)
        if command in _KEYS and not waited_for and self._is_early(command):
            self._screen.say(answer(_KEYS[command], self._status))
        if self._engaged and not waited_for:
            command = KeyCommand.STOP
        if command is KeyCommand.STOP:
            self._ask_to_stop(OperatorCommand.STOP)
        elif command is KeyCommand.RESET or waited_for:
            self._give_command(_ACTS[command])

    def _ask_to_stop(self, command: OperatorCommand) -> None:
        """Have a stop sent; the operator's counts before that of the page."""
        if self._stop is not OperatorCommand.STOP:
            self._stop = command
        if not self._engaged:
            # Nothing moves yet, so a stop ends the drive before it begins.
            self._leave()

    def _waited_for(self, command: KeyCommand) -> bool:
        """Whether the gateway waits for this command now."""
        if command is KeyCommand.GO:
            return self._state is ArmingState.ENGAGED and WAITING in self._status.get("reasons", ())
        return command is KeyCommand.ENGAGE and self._state is ArmingState.READY

    def _is_early(self, command: KeyCommand) -> bool:
        """Whether to answer that this command comes too early; once the car goes, every key is a stop instead."""
        if not self._engaged:
            return not self._over
        return command is KeyCommand.GO and self._state is ArmingState.ENGAGED and not self._status["went"]

    def _give_command(self, command: OperatorCommand) -> None:
        self.processes.to_gateway.send(link.encode_operator_command(command))
        if command is OperatorCommand.GO:
            self._status["went"] = True

    def _give_commands(self) -> None:
        """Send the gateway a sign of life, and repeat a stop or an end until the gateway acts on it."""
        if self.processes.to_gateway.closed:
            return
        self.processes.to_gateway.send(ALIVE)
        if (self._stop or self._ends) and self._state in (ArmingState.READY, ArmingState.ENGAGED):
            command = self._stop or OperatorCommand.END
            self.processes.to_gateway.send(link.encode_operator_command(command))

    def _leave(self) -> None:
        self._over = self._left_by_operator = True
        self.processes.to_gateway.close()

    def _read_view(self) -> None:
        """Take the page's requests to stop: whatever it says is a stop of nobody known, and nothing else."""
        view = self.processes.to_view
        if view is not None and not view.closed and view.receive():
            if not self._engaged and not self._over:
                self._screen.say(f"  {in_words('stop_asked_by_page')}: the drive is over before it began")
            self._ask_to_stop(OperatorCommand.STOP_BY_PAGE)

    def _read_drive(self) -> None:
        if self.processes.to_drive.closed:
            return
        for data in self.processes.to_drive.receive():
            match messages.decode(data):
                case messages.Refused() as refused:
                    self.refused = refused
                case messages.Notice(text):
                    self._screen.say(text)
                case messages.DriveStatus() as status:
                    self._status |= msgspec.structs.asdict(status)

    def _read_gateway(self) -> None:
        if self.processes.to_gateway.closed:
            return
        for data in self.processes.to_gateway.receive():
            feedback = link.decode_feedback(data)
            if not isinstance(feedback, link.Feedback):
                self._read_refusal(data)
                continue
            status = feedback.status
            self._heard_at = time.monotonic()
            if GO_TOO_EARLY in status.reasons:
                self._status["went"] = False
            self._state = status.state
            self._engaged |= status.state in COMMANDING
            if status.state in ENDING:
                self.why = status.reasons
            self._status |= {
                "time_s": feedback.time,
                "state": status.state.value,
                "reasons": list(status.reasons),
                "wheel_speed_mps": feedback.wheel_speed,
                "gear": feedback.gear,
            }
            if self._operator is not None and not self._over:
                self._operator.observe(status)
                command = self._operator.next_command()
                if command is not None:
                    self._give_command(command)

    def _read_refusal(self, data: bytes) -> None:
        """Take the refusal of a gateway that cannot open its bus."""
        if isinstance(message := messages.decode(data), messages.Refused):
            self.refused = message

    def _judge(self) -> None:
        """End a drive that has its outcome, and refuse one that cannot begin."""
        if self._over:
            return
        if self._status.get("outcome") is not None and self._state is ArmingState.ENGAGED:
            self._over = self._ends = True
        elif not self._engaged and self.processes.drive.poll() is not None:
            self._refuse("the drive's process ended before anything moved", 4)
        elif not self._engaged and self.processes.recorder.poll() is not None:
            self._refuse("the recorder's process ended before anything moved", 3)
        elif self._operator is not None and not self._engaged and time.monotonic() - self._begun > READY_TIMEOUT:
            missing = "; ".join(why(self._status)) or "the gateway does not answer"
            self._refuse(f"not ready after {READY_TIMEOUT:.0f} s: {missing}", 3)

    def _refuse(self, why: str, exit_code: int) -> None:
        self._read_drive()
        self.refused = self.refused or messages.Refused(why, exit_code)
        self._leave()
