"""The console's side of one real car: what its gateway says, what its operator may do now, the commands to it.

Knows one gateway's channel; no key, no screen and no other car.
"""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Callable
from typing import Any, Final

from vve_sumo.drive.lockstep import ScriptedOperator
from vve_sumo.live import messages
from vve_sumo.live.channel import ALIVE, Channel
from vve_sumo.live.keys import KeyCommand
from vve_sumo.live.wording import GatewayProcessState
from vve_sumo.values import EGO, ArmingState
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, ENDING, WAITING
from vve_sumo.vehicle.arming_machine import OperatorCommand

#: a gateway without a message for this long counts as silent [s]: it sends one every 0.1 s, give or take a step; with
#: one more pass of the loop the alarm is on the screen within 0.3 s
SILENT: Final = 0.2
#: the gateway's reason code for a go that it rejected
GO_TOO_EARLY: Final = "go_too_early"


class CarConsole:
    """What the console knows of one real car, and its channel to that car's gateway."""

    def __init__(
        self, gateway: Channel, process: subprocess.Popen[bytes] | None, automatic: bool, ego: str = EGO
    ) -> None:
        """Begin before the gateway has said anything; with `automatic` a `ScriptedOperator` gives commands too."""
        self.gateway, self._process, self.ego = gateway, process, ego
        self.operator = ScriptedOperator() if automatic else None
        self.state = ArmingState.DISARMED
        self.engaged = False  #: whether the gateway has ever commanded the car
        self._heard_at = math.inf  # time of the gateway's last message; inf before the first
        #: for the screen; `went`: a go has been sent, and was not refused
        self.status: dict[str, Any] = {"went": False}
        self.why: tuple[str, ...] = ()  #: the gateway's last reasons for stopping the car, or for letting go of it
        self.refused: messages.Refused | None = None  #: why the gateway cannot open its bus

    @property
    def running(self) -> bool:
        """Whether the gateway's process has not ended."""
        return self._process is not None and self._process.poll() is None

    @property
    def lost(self) -> bool:
        """Whether the gateway ended while it commanded the car."""
        return self.state in COMMANDING and not self.running

    @property
    def outcome(self) -> str | None:
        """The outcome of the car's drive, None before there is one."""
        outcome: str | None = self.status.get("outcome")
        return outcome

    @property
    def over(self) -> bool:
        """Whether nothing is left to be waited for: the car has its outcome, or is no longer engaged."""
        if self.state is ArmingState.ENGAGED and self.running and not self.gateway.closed:
            return self.outcome is not None
        return self.engaged

    def waits_for(self, command: KeyCommand) -> bool:
        """Whether the gateway waits for this command now."""
        if command is KeyCommand.GO:
            return self.state is ArmingState.ENGAGED and WAITING in self.status.get("reasons", ())
        return command is KeyCommand.ENGAGE and self.state is ArmingState.READY

    def give(self, command: OperatorCommand) -> None:
        """Send a command to the gateway."""
        self.gateway.send(link.encode_operator_command(command))
        if command is OperatorCommand.GO:
            self.status["went"] = True

    def keep_alive(self, repeated: OperatorCommand | None) -> None:
        """Send the gateway a sign of life, and a command that is repeated until the gateway acts on it."""
        if self.gateway.closed:
            return
        self.gateway.send(ALIVE)
        if repeated is not None and self.state in (ArmingState.READY, ArmingState.ENGAGED):
            self.gateway.send(link.encode_operator_command(repeated))

    def read(self, answer: Callable[[CarConsole, OperatorCommand], None]) -> None:
        """Take in what the gateway has said; `answer` is called with a command of the scripted operator."""
        if self.gateway.closed:
            return
        for data in self.gateway.receive():
            feedback = link.decode_feedback(data)
            if not isinstance(feedback, link.Feedback):
                self._read_refusal(data)
                continue
            status = feedback.status
            self._heard_at = time.monotonic()
            if GO_TOO_EARLY in status.reasons:
                self.status["went"] = False
            self.state = status.state
            self.engaged |= status.state in COMMANDING
            if status.state in ENDING:
                self.why = status.reasons
            self.status |= {
                "time_s": feedback.time,
                "state": status.state.value,
                "reasons": list(status.reasons),
                "wheel_speed_mps": feedback.wheel_speed,
                "gear": feedback.gear,
            }
            if self.operator is not None:
                self.operator.observe(status)
                if (command := self.operator.next_command()) is not None:
                    answer(self, command)

    def process_state(self, read_at: float) -> GatewayProcessState:
        """Return what is known of the gateway's process, whose messages were last read at `read_at` (monotonic) [s]."""
        silent = read_at - self._heard_at > SILENT
        return GatewayProcessState.SILENT if silent else GatewayProcessState.RESPONDING

    def _read_refusal(self, data: bytes) -> None:
        """Take the refusal of a gateway that cannot open its bus."""
        if isinstance(message := messages.decode(data), messages.Refused):
            self.refused = message
