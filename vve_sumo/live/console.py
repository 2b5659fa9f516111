"""The operator's side of a live drive: turns keys into operator commands, status messages into text and bells.

Commands go straight to the gateways, so a car can be stopped while the drive's process hangs. Nothing here computes
anything that moves a car. The console engages and goes by itself only with a rig that declares `operator.automatic`.

One console serves all real cars of a drive. `e` engages those that are ready. No car goes before all are engaged, and
a stop stops all.
"""

from __future__ import annotations

import select
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from vve_sumo.drive.reasons import in_words
from vve_sumo.live import messages, spawn
from vve_sumo.live.car_console import CarConsole
from vve_sumo.live.channel import Channel
from vve_sumo.live.jitter_wait import CALM_TIMEOUT
from vve_sumo.live.keys import KeyCommand, OperatorInput
from vve_sumo.live.screen import Screen
from vve_sumo.live.wording import GatewayProcessState, answer, doctor_overridden, why
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming_machine import OperatorCommand

#: longest wait between two passes of the loop [s]
POLL_INTERVAL: Final = 0.05
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
#: commands that count only while a gateway waits for them, and their keys
_KEYS: Final = {KeyCommand.ENGAGE: "e", KeyCommand.GO: "g"}


@dataclass(slots=True)
class FurtherProcesses:
    """The processes of a further ego of a live drive, and the console's channels to them."""

    ego: str  #: its id
    recorder: subprocess.Popen[bytes]
    gateway: subprocess.Popen[bytes] | None = None  #: of a real car; a simulated ego has none, nor the following
    to_gateway: Channel | None = None
    automatic: bool = False  #: whether its operator is scripted
    car: subprocess.Popen[bytes] | None = None  #: where the rig's car is simulated
    to_car: Channel | None = None


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
    further: tuple[FurtherProcesses, ...] = ()  #: of further egos

    def shutdown(self, timeout: float) -> None:
        """Wait for gateways, drive, recorders and cars to end, in this order; kill a later one that hangs.

        A gateway is never killed: as long as it runs, it holds the car or still tries to. The page goes on until
        `end_view`.
        """
        if self.to_view is not None:
            self.to_view.send(b'{"kind": "ended"}')  # from here on nobody takes a page's request to stop
        self.to_gateway.close()
        for one in self.further:
            if one.to_gateway is not None:
                one.to_gateway.close()
        self.to_drive.close()
        self.gateway.wait()
        for one in self.further:
            if one.gateway is not None:
                one.gateway.wait()
        spawn.end(self.drive, min(timeout, DRIVE_TIMEOUT))
        if self.outputs is not None:
            spawn.end(self.outputs, DRIVE_TIMEOUT)
        if self.people is not None:
            spawn.end(self.people, VIEW_TIMEOUT)
        if self.stations is not None:
            spawn.end(self.stations, VIEW_TIMEOUT)
        for recorder in (self.recorder, *(one.recorder for one in self.further)):
            spawn.end(recorder, timeout)
        for car, to_car in ((self.car, self.to_car), *((one.car, one.to_car) for one in self.further)):
            if car is not None and to_car is not None:
                to_car.close()
                spawn.end(car, timeout)

    def end_view(self, verdict: Mapping[str, Any] | None = None) -> None:
        """Show a drive's verdict on the page, as `words.verdict_of` has it, and end the page; again is nothing."""
        if self.view is None or self.to_view is None:
            return
        if verdict is not None:
            self.to_view.send(messages.encode(messages.Verdict(dict(verdict))))
        self.to_view.close()
        spawn.end(self.view, VIEW_TIMEOUT)


class Console:
    """The operator's console; runs until the processes of all gateways have ended."""

    def __init__(
        self, processes: ProcessGroup, keys: OperatorInput, screen: Screen, automatic: bool, overridden: str = ""
    ) -> None:
        """Take commands from `keys`, and with `automatic` also from a `ScriptedOperator`.

        `overridden` is why the car is armed without the doctor's GO; the screen shows it for the whole drive.
        """
        self.processes, self._keys, self._screen = processes, keys, screen
        self.cars = [CarConsole(processes.to_gateway, processes.gateway, automatic)]  #: that of [ego] first
        for one in processes.further:
            if one.to_gateway is not None:
                self.cars.append(CarConsole(one.to_gateway, one.gateway, one.automatic, one.ego))
        self._over = self._ends = self._left_by_operator = False
        self._stop: OperatorCommand | None = None  # whose stop is to be sent: the operator's, or the page's
        self._begun = time.monotonic()
        for car in self.cars:
            car.status |= {"doctor_overridden": overridden}
            if len(self.cars) > 1:
                car.status["car"] = car.ego
        if overridden:
            screen.say(doctor_overridden(overridden))
        self._refused: messages.Refused | None = None

    @property
    def refused(self) -> messages.Refused | None:
        """Why the drive never began, and the exit code for that."""
        return self._refused or next((car.refused for car in self.cars if car.refused is not None), None)

    def why(self, ego: str) -> tuple[str, ...]:
        """Return a gateway's last reasons for stopping the car of an ego, or for letting go of it."""
        return next(car.why for car in self.cars if car.ego == ego)

    @property
    def _engaged(self) -> bool:
        return any(car.engaged for car in self.cars)

    def run(self) -> None:
        """Serve the operator until the gateways' processes have ended."""
        while any(car.running for car in self.cars):
            channels = (*(car.gateway for car in self.cars), self.processes.to_drive, self.processes.to_view)
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
            self._show({car.ego: self._seen(car, begun) for car in self.cars})
        self._read_gateway()
        if not self._engaged and not self._over:
            self._refuse("the gateway's process ended before anything moved; see gateway.log in the record", 3)
        if any(car.lost for car in self.cars):
            self._show_gateway_lost()
        else:
            self._show(self._ended())

    def _seen(self, car: CarConsole, read_at: float) -> GatewayProcessState:
        """Return what is known of a gateway's process while another's, or this one, may still run."""
        if car.running or len(self.cars) == 1:
            return car.process_state(read_at)
        return GatewayProcessState.GONE if car.lost else GatewayProcessState.ENDED

    def _ended(self) -> dict[str, GatewayProcessState]:
        return {car.ego: GatewayProcessState.GONE if car.lost else GatewayProcessState.ENDED for car in self.cars}

    def _show(self, states: Mapping[str, GatewayProcessState]) -> None:
        for car in self.cars:
            state = states[car.ego]
            if self._left_by_operator or (car.gateway.closed and state is GatewayProcessState.SILENT):
                # A gateway that has closed its channel is ending: its silence is no alarm.
                state = GatewayProcessState.LEFT if self._left_by_operator else GatewayProcessState.RESPONDING
            car.status |= {"gateway": state.value, "engaged": car.engaged}
        self._screen.show(*(car.status for car in self.cars))

    def _show_gateway_lost(self) -> None:
        """Show for ALARM_TIME that a car that was commanded is commanded no more."""
        until = time.monotonic() + ALARM_TIME
        while not self._left_by_operator and time.monotonic() < until:
            self._show(self._ended())
            time.sleep(POLL_INTERVAL)
        self._show(self._ended())

    @staticmethod
    def _alive(channel: Channel | None) -> list[int]:
        return [] if channel is None or channel.closed else [channel.fileno()]

    def _apply_key(self, command: KeyCommand) -> None:
        if command is KeyCommand.GONE:
            # The gateways report operator_gone and bring their cars to rest.
            self._leave()
            return
        waiting = [car for car in self.cars if car.waits_for(command)]
        if command is KeyCommand.GO and not self._all_may_go():
            waiting = []
        early = next((car for car in self.cars if self._is_early(command, car)), None)
        if command in _KEYS and not waiting and early is not None:
            self._screen.say(self._answer(command, early))
        if self._engaged and not waiting:
            command = KeyCommand.STOP
        if command is KeyCommand.STOP:
            self._ask_to_stop(OperatorCommand.STOP)
        elif command is KeyCommand.RESET or waiting:
            for car in waiting or self.cars:
                car.give(_ACTS[command])

    def _answer(self, command: KeyCommand, early: CarConsole) -> str:
        """Return the line that answers a key that comes too early for a car."""
        missing = [car.ego for car in self.cars if not car.waits_for(KeyCommand.GO)]
        if command is KeyCommand.GO and self._engaged and len(self.cars) > 1 and missing:
            return f"  g came too early and stops the drive: {', '.join(missing)} is not engaged and held"
        return answer(_KEYS[command], early.status)

    def _all_may_go(self) -> bool:
        """Whether no car is left that is not engaged: one that goes alone would drive where another is expected."""
        return all(car.waits_for(KeyCommand.GO) or (car.status["went"] and car.engaged) for car in self.cars)

    def _ask_to_stop(self, command: OperatorCommand) -> None:
        """Have a stop sent; the operator's counts before that of the page."""
        if self._stop is not OperatorCommand.STOP:
            self._stop = command
        if not self._engaged:
            # Nothing moves yet, so a stop ends the drive before it begins.
            self._leave()

    def _is_early(self, command: KeyCommand, car: CarConsole) -> bool:
        """Whether to answer that this command comes too early; once the car goes, every key is a stop instead."""
        if not self._engaged:
            return not self._over and not car.waits_for(command)
        return command is KeyCommand.GO and car.state is ArmingState.ENGAGED and not car.status["went"]

    def _answer_itself(self, car: CarConsole, command: OperatorCommand) -> None:
        """Give a command of a scripted operator; a go waits until all cars are engaged."""
        if not self._over and (command is not OperatorCommand.GO or self._all_may_go()):
            car.give(command)

    def _give_commands(self) -> None:
        """Send the gateways a sign of life, and repeat a stop or an end until they act on it."""
        repeated = self._stop or (OperatorCommand.END if self._ends else None)
        for car in self.cars:
            car.keep_alive(repeated)

    def _leave(self) -> None:
        self._over = self._left_by_operator = True
        for car in self.cars:
            car.gateway.close()

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
                    self._refused = refused
                case messages.Notice(text):
                    self._screen.say(text)
                case messages.DriveStatus() as status:
                    for car in self.cars:
                        if car.ego == status.ego:
                            car.status |= msgspec.structs.asdict(status)

    def _read_gateway(self) -> None:
        for car in self.cars:
            car.read(self._answer_itself)

    def _judge(self) -> None:
        """End a drive whose cars all have their outcomes, and refuse one that cannot begin."""
        if self._over:
            return
        recorders = (self.processes.recorder, *(one.recorder for one in self.processes.further))
        if any(car.outcome is not None and car.state is ArmingState.ENGAGED for car in self.cars):
            if len(self.cars) == 1 or all(car.over for car in self.cars):
                self._over = self._ends = True
        elif not self._engaged and self.processes.drive.poll() is not None:
            self._refuse("the drive's process ended before anything moved", 4)
        elif not self._engaged and any(recorder.poll() is not None for recorder in recorders):
            self._refuse("the recorder's process ended before anything moved", 3)
        elif not self._engaged and len(self.cars) > 1 and not all(car.running for car in self.cars):
            self._read_gateway()
            self._refuse("a gateway's process ended before anything moved; see gateway.log in the record", 3)
        elif time.monotonic() - self._begun > READY_TIMEOUT:
            self._refuse_the_late()

    def _refuse_the_late(self) -> None:
        """Refuse a drive in which a car with a scripted operator is still not engaged."""
        for car in self.cars:
            if car.operator is not None and not car.engaged:
                missing = "; ".join(why(car.status)) or "the gateway does not answer"
                self._refuse(f"not ready after {READY_TIMEOUT:.0f} s: {missing}", 3)
                return

    def _refuse(self, why: str, exit_code: int) -> None:
        self._read_drive()
        self._refused = self.refused or messages.Refused(why, exit_code)
        self._leave()
