"""Runs the gateway's process, sole owner of the car's bus: setpoints and operator commands in, frames out, one loop.

`vehicle.gateway` decides; this module gives it the clock, the bus and the channels. A fresh setpoint becomes frames at
once; without one, frames go out a little later. Each fault of this process goes to `vehicle.gateway` as a reason code.
Where an external controller commands the car, `vehicle.observer` stands in its place, and the process only listens.
"""

from __future__ import annotations

import contextlib
import gc
import math
import select
import sys
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from vve_sumo.bus import Bus
from vve_sumo.errors import RigError, VveError
from vve_sumo.live import messages, signals
from vve_sumo.live.channel import ALIVE, Channel
from vve_sumo.live.priority import GATEWAY_PRIORITY, OOM_NEVER, raise_priority, set_oom_score
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.live.spawn import receive_config
from vve_sumo.record.rows import GatewayRow
from vve_sumo.timing import LONE_STEP_INTERVAL, MAX_STEP_INTERVAL, MIN_STEP_INTERVAL
from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint, Vehicle
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.arming_machine import STOPS, OperatorCommand
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.gateway import Gateway, GatewayOutput
from vve_sumo.vehicle.interface import InterfaceConfig, load
from vve_sumo.vehicle.limits import EmergencyBraking, Envelope, Limits
from vve_sumo.vehicle.observer import Observer

CAR_BUS: Final = "can0"  #: the car's bus, as the record names it
#: between two polls of a bus whose driver has no file descriptor to wait on [s]
POLL_INTERVAL: Final = 0.001
#: between two status messages to the console while nothing changes [s]
STATUS_INTERVAL: Final = 0.1
#: longest time to send the last messages to the recorder [s]
RECORDER_TIMEOUT: Final = 2.0
#: a console that has given a sign of life and then none for this long counts as gone [s]
SILENCE: Final = 1.0
#: a DBW controller without an understood report for this long is gone [s]; the car stands or cannot be stopped
DBW_SILENCE_LIMIT: Final = 60.0


def next_step_time(last: float, fresh: bool, alone: bool, period: float) -> float:
    """Return when the step after the one at `last` is due; a missed step is not made up for.

    `fresh`: a setpoint or a first stop waits. `alone`: the last step had no setpoint.
    """
    return last + (MIN_STEP_INTERVAL if fresh else LONE_STEP_INTERVAL if alone else MAX_STEP_INTERVAL) * period


def dbw_is_gone(now: float, received: float) -> bool:
    """Whether no DBW controller is left to command; `received` is when its last understood report came.

    Other frames do not count, however many there are: a device that floods the bus cannot be commanded.
    """
    return now - received > DBW_SILENCE_LIMIT


class StepInputs(NamedTuple):
    """The inputs of one step that come over the channels."""

    setpoint: Setpoint | None
    datagram: bytes  #: the setpoint's, as received
    command: OperatorCommand | None
    process_faults: tuple[str, ...]  #: reason codes


class Inbox:
    """What drive and console sent since the last step: the newest setpoint, the next command, reason codes."""

    def __init__(self) -> None:
        self.refused = 0  #: operator commands that came from the drive, which may give none
        self._setpoint: Setpoint | None = None
        self._datagram = b""
        self._process_faults: list[str] = []
        self._commands: deque[OperatorCommand] = deque()
        self._stopped = False  # a stop has been handed on

    @property
    def fresh(self) -> bool:
        """Whether a setpoint or a first stop waits, for which a step comes early; a repeated stop does not count.

        The gateway counts in periods: an operator who hammers a key must not make them shorter.
        """
        return self._setpoint is not None or (not STOPS.isdisjoint(self._commands) and not self._stopped)

    def take_from_drive(self, datagram: bytes) -> None:
        """Take in a datagram of the drive."""
        setpoint = link.decode_setpoint(datagram)
        if isinstance(setpoint, Setpoint):
            if self._setpoint is not None:
                # A newer setpoint replaces this one, but the faults that this one reports count.
                self._process_faults += self._setpoint.faults
            self._setpoint, self._datagram = setpoint, datagram
        elif isinstance(link.decode_operator_command(datagram), OperatorCommand):
            self.refused += 1
        else:
            self._process_faults.append("setpoint_corrupt")

    def take_from_console(self, datagram: bytes) -> None:
        """Take in an operator command; a datagram that cannot be understood counts as the operator's stop.

        A stop goes before all that waits, the operator's before that of the page.
        """
        command = link.decode_operator_command(datagram)
        if not isinstance(command, OperatorCommand):
            command = OperatorCommand.STOP
        waiting = STOPS.intersection(self._commands)
        if command in STOPS and OperatorCommand.STOP not in waiting:
            self._commands.clear()
            self._commands.append(command)
        elif not waiting:
            self._commands.append(command)

    def take(self) -> StepInputs:
        """Return the inputs of the next step and remove them."""
        command = self._commands.popleft() if self._commands else None
        self._stopped |= command in STOPS
        taken = StepInputs(self._setpoint, self._datagram, command, tuple(self._process_faults))
        self._setpoint, self._datagram, self._process_faults = None, b"", []
        return taken


class GatewayProcess:
    """The loop around a `Gateway`, from its first step until it has let go of the car."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel], bus: Bus) -> None:
        self._gateway = build_gateway(config)
        self._period: float = config["period"]
        self._t0: float = config["t0"]
        self._stop_id: int | None = config["stop_can_id"]
        self._drive, self._console = channels["drive"], channels["console"]
        self._recorder = channels["recorder"]
        self._recorder_client = RecorderClient(self._recorder)
        self._bus = bus
        self._bus_number = bus.fileno()
        self._inbox = Inbox()
        self._received: list[Frame] = []
        self._last_heartbeat = math.inf  # time of the console's last sign of life; inf before the first
        self._record_failed = False  # sending or recording a step failed
        self._receive_failed = self._send_failed = False  # whether the last receive, the last send on the bus failed
        self._last = -math.inf
        self._alone = True
        self._steps = 0
        self._has_engaged = False
        self._last_status: tuple[ArmingState, tuple[str, ...]] | None = None
        self._last_status_time = -math.inf
        self._logged_error = ""  # of the interface's own code

    def run(self) -> None:
        """Step until the drive is over, the console is gone before it began, or the DBW controller is gone."""
        while True:
            self._wait()
            status = self._step()
            self._has_engaged |= status.state in COMMANDING
            if self._gateway.done or (self._console.closed and not self._has_engaged):
                break
            if self._has_engaged and dbw_is_gone(self._last, self._gateway.monitor.last_dbw_report):
                _say(f"no report of the DBW controller for {DBW_SILENCE_LIMIT:.0f} s: there is nothing to command")
                break
        # Closed first, so that the console raises no alarm for the silence from here on.
        self._console.close()
        self._recorder_client.finish(RECORDER_TIMEOUT)

    def report(self) -> str:
        """Return the log's last line."""
        return f"{self._steps} steps, {self._inbox.refused} acts refused that came from the drive"

    def _clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self._t0

    # Between two steps.

    def _wait(self) -> None:
        while (left := next_step_time(self._last, self._inbox.fresh, self._alone, self._period) - self._clock()) > 0.0:
            # select, because poll rounds to whole milliseconds.
            ready, _, _ = select.select(
                self._descriptors(), [], [], left if self._bus_number is not None else min(left, POLL_INTERVAL)
            )
            for channel in ready:
                if channel is self._drive:
                    self._read_drive()
                elif channel is self._console:
                    self._read_console()
            if self._bus_number is None or self._bus_number in ready:
                self._read_bus()

    def _descriptors(self) -> list[Channel | int]:
        # select always finds a closed channel or a failed bus ready, which would make this a busy loop.
        descriptors: list[Channel | int] = [channel for channel in (self._drive, self._console) if not channel.closed]
        if self._bus_number is not None and not self._receive_failed:
            descriptors.append(self._bus_number)
        return descriptors

    def _read_drive(self) -> None:
        for datagram in self._drive.receive():
            self._inbox.take_from_drive(datagram)

    def _read_console(self) -> None:
        for datagram in self._console.receive():
            if datagram == ALIVE:
                self._last_heartbeat = self._clock()
            else:
                self._inbox.take_from_console(datagram)

    def _read_bus(self) -> None:
        try:
            frames = self._bus.drain()
        except RigError:
            self._receive_failed = True
            return
        self._receive_failed = False
        if frames:
            self._recorder_client.saw_frames(self._clock(), CAR_BUS, frames)
            self._received += frames

    # A step.

    def _step(self) -> GatewayStatus:
        self._read_bus()
        self._read_drive()
        self._read_console()
        taken = self._inbox.take()
        received, self._received = self._received, []
        found = tuple(dict.fromkeys([*taken.process_faults, *self._find(received)]))
        now = self._clock()
        output = self._gateway.step(now, taken.setpoint, received, taken.command, found)
        if (error := self._gateway.interface_error) not in ("", self._logged_error):
            self._logged_error = error
            _say(f"the drive-by-wire interface raised {error}")
        count = self._send(output.frames)
        sent = self._clock() if count else math.nan
        self._last, self._alone = now, taken.setpoint is None
        self._steps += 1
        try:
            self._tell(now, sent, output)
            self._keep(now, taken, found, len(received), count, output)
        except Exception as error:
            # A bug in sending or recording must not keep the gateway from stopping the car.
            self._record_failed = True
            _say(f"a step could not be sent or recorded: {type(error).__name__}: {error}")
        return output.status

    def _find(self, received: list[Frame]) -> list[str]:
        """Return the reason codes of the faults that this process sees now."""
        found = []
        if self._receive_failed or self._send_failed:
            found.append("bus_down")
        if self._stop_id is not None and any(frame.id == self._stop_id for frame in received):
            found.append("stop_input")
        if self._drive.closed:
            found.append("drive_gone")
        if self._console.closed or self._clock() - self._last_heartbeat > SILENCE:
            found.append("operator_gone")
        if self._recorder_client.failure or self._record_failed:
            found.append(self._recorder_client.failure or "record_lost")
        return found

    def _send(self, frames: tuple[Frame, ...]) -> int:
        """Send a step's frames in order; return how many the bus took. After one that it refuses, none is sent.

        A brake command without its steering is better than none; a later frame in an earlier one's place is not.
        """
        self._send_failed = False
        for count, frame in enumerate(frames):
            try:
                self._bus.send(frame)
            except RigError:
                self._send_failed = True
                return count
        return len(frames)

    def _tell(self, now: float, sent: float, output: GatewayOutput) -> None:
        """Send feedback to the drive at every step, to the console at every change and every STATUS_INTERVAL."""
        monitor = self._gateway.monitor
        word = link.encode_feedback(
            link.Feedback(
                time=now,
                sequence=monitor.sequence,
                sent=sent,
                status=output.status,
                measured_steering=monitor.measured_steering,
                wheel_speed=monitor.wheel_speed,
                gear=monitor.gear,
                steps=self._steps,
            )
        )
        self._drive.send(word)
        news = (output.status.state, output.status.reasons)
        if news != self._last_status or now - self._last_status_time >= STATUS_INTERVAL:
            self._last_status, self._last_status_time = news, now
            self._console.send(word)

    def _keep(
        self, now: float, taken: StepInputs, faults: tuple[str, ...], received: int, sent: int, output: GatewayOutput
    ) -> None:  # fmt: skip
        """Hand the step to the recorder."""
        monitor, status = self._gateway.monitor, output.status
        self._recorder_client.saw_frames(now, CAR_BUS, output.frames[:sent])
        self._recorder_client.stepped(
            GatewayRow(
                step=self._steps - 1,
                time_s=now,
                setpoint=taken.datagram,
                operator_command="" if taken.command is None else taken.command.value,
                process_faults="+".join(faults),
                frames_received=received,
                frames_sent=sent,
                sequence=monitor.sequence,
                state=status.state.value,
                reasons="+".join(status.reasons),
                limited="+".join(status.limited),
                steering_rad=status.steering,
                granted_acceleration_mps2=status.acceleration,
                brake_torque_nm=status.brake_torque,
                throttle_percent=100.0 * status.throttle,
                measured_steering_rad=monitor.measured_steering,
                wheel_speed_mps=monitor.wheel_speed,
                gear=monitor.gear,
            )
        )
        self._recorder_client.flush()


def build_gateway(config: Mapping[str, Any]) -> Gateway | Observer:
    """Return the gateway that a configuration describes; raises ConfigError where its interface can't be made.

    A `silent` one, where an external controller commands the car, is an `Observer`: it has no frames to send.
    """
    if config["silent"]:
        return Observer(
            Vehicle(**config["vehicle"]),
            Calibration(**config["calibration"]),
            load(InterfaceConfig(**config["interface"])),
            config["wheel_bias"],
        )
    limits = config["limits"]
    nested = {"comfort": Envelope(**limits["comfort"]), "emergency": EmergencyBraking(**limits["emergency"])}
    return Gateway(
        Vehicle(**config["vehicle"]),
        Calibration(**config["calibration"]),
        Limits(**{**limits, **nested}),
        config["period"],
        load(InterfaceConfig(**config["interface"])),
        config["shadow"],
        config["wheel_bias"],
    )


def _say(line: str) -> None:
    """Write a line to the log; ignore a log that can't be written."""
    with contextlib.suppress(OSError, ValueError):
        print(f"gateway: {line}", file=sys.stderr, flush=True)  # noqa: T201 (the log of a process without a terminal)


def main() -> int:
    """Run the gateway of one drive; return the error's exit code if the bus cannot be opened, else 0."""
    # Signals are ignored: this process ends once it has let go of the car, or if its console goes before an engagement.
    signals.ignore()
    config, channels = receive_config()
    bus_config = config["bus"]
    _say(set_oom_score(OOM_NEVER))
    _say(raise_priority(GATEWAY_PRIORITY))  # before the bus is opened, so that its thread has the priority too
    try:
        bus = Bus(bus_config["interface"], bus_config["channel"], bus_config["bitrate"])
    except VveError as error:
        _say(str(error))
        channels["console"].send(messages.refusal(error))
        return error.exit_code
    with bus:
        process = GatewayProcess(config, channels, bus)
        # A garbage collection takes milliseconds, and the steps make no reference cycles.
        gc.collect()
        gc.freeze()
        gc.disable()
        process.run()
    _say(process.report())
    return 0


if __name__ == "__main__":
    sys.exit(main())
