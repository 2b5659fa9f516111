"""The operator's side of a live drive: wishes become acts, what gateway and drive tell becomes words and bells.

The gateway hears its acts directly, so a drive that hangs can still be stopped. Nothing here computes anything that
moves the car, and nothing is done by itself but where the rig says that no person is there.
"""

from __future__ import annotations

import contextlib
import json
import select
import subprocess
import time
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.drive.lockstep import WAITING, Operator
from vve_sumo.live.channel import ALIVE, Channel
from vve_sumo.live.keys import Keys, Wish
from vve_sumo.live.screen import Screen
from vve_sumo.values import ArmingState
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, ENDING
from vve_sumo.vehicle.gateway import Act

#: between two looks at everything [s]
LOOK: Final = 0.1
#: for a drive that hangs: its last words to the recorder take 5 s at most, and its street is to be closed [s]
DRIVE_PATIENCE: Final = 8.0
#: a rig that drives by itself and is not ready by then never will be [s]
READY_LIMIT: Final = 60.0

_ACTS: Final = {Wish.ENGAGE: Act.ENGAGE, Wish.GO: Act.GO, Wish.RESET: Act.DISARM}


@dataclass(slots=True)
class Crew:
    """The processes of a live drive as the console holds them."""

    gateway: subprocess.Popen[bytes]
    drive: subprocess.Popen[bytes]
    recorder: subprocess.Popen[bytes]
    car: subprocess.Popen[bytes] | None  #: the hardware-free one
    to_gateway: Channel
    to_drive: Channel
    to_car: Channel | None

    def dismiss(self, patience: float) -> None:
        """Let every process end as it means to, drive before recorder before car; kill what hangs after the gateway.

        The gateway is never killed: as long as it runs it holds the car, or still tries to.
        """
        self.to_gateway.close()
        self.to_drive.close()
        self.gateway.wait()
        _end(self.drive, min(patience, DRIVE_PATIENCE))
        _end(self.recorder, patience)
        if self.car is not None and self.to_car is not None:
            self.to_car.close()
            _end(self.car, patience)


def _end(process: subprocess.Popen[bytes], patience: float) -> None:
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Console:
    """Runs until the gateway has let go of the car."""

    def __init__(self, crew: Crew, keys: Keys, screen: Screen, automatic: bool) -> None:
        """Have wishes come from `keys`, and with `automatic` from the rig itself."""
        self._crew, self._keys, self._screen = crew, keys, screen
        self._operator = Operator() if automatic else None
        self._state = ArmingState.DISARMED
        self._engaged = self._over = self._stops = False
        self._begun = time.monotonic()
        self._status: dict[str, Any] = {}
        self.why: tuple[str, ...] = ()  #: the gateway's last reasons for stopping the car, or for letting go of it
        self.refusal: tuple[str, int] | None = None  #: why the drive never began, and the exit code for that

    def run(self) -> None:
        """Look after the drive to its end."""
        crew = self._crew
        while crew.gateway.poll() is None:
            watched = [*self._keys.filenos(), *self._alive(crew.to_gateway), *self._alive(crew.to_drive)]
            select.select(watched, [], [], LOOK)
            for wish in self._keys.wishes():
                self._obey(wish)
            self._hear_drive()
            self._hear_gateway()
            self._judge()
            self._speak()
            self._screen.show(self._status)
        self._hear_gateway()
        if not self._engaged and not self._over:
            self._refuse("the gateway's process ended before anything moved; see gateway.log in the record", 3)

    @staticmethod
    def _alive(channel: Channel) -> list[int]:
        return [] if channel.closed else [channel.fileno()]

    def _obey(self, wish: Wish) -> None:
        if self._engaged and not (wish is Wish.GO and WAITING in self._status.get("reasons", ())):
            wish = Wish.STOP
        if wish is Wish.STOP:
            self._stops = True
            if not self._engaged:
                # Nothing moves yet: to stop is not to begin.
                self._leave()
        elif wish is not Wish.NOTHING:
            self._crew.to_gateway.send(link.encode_act(_ACTS[wish]))

    def _speak(self) -> None:
        """Show the gateway that somebody is there, and say stop until it is heard."""
        if self._crew.to_gateway.closed:
            return
        self._crew.to_gateway.send(ALIVE)
        if self._stops and self._state in (ArmingState.READY, ArmingState.ENGAGED):
            self._crew.to_gateway.send(link.encode_act(Act.STOP))

    def _leave(self) -> None:
        self._over = True
        self._crew.to_gateway.close()

    def _hear_drive(self) -> None:
        if self._crew.to_drive.closed:
            return
        for data in self._crew.to_drive.receive():
            told = json.loads(data)
            if "refused" in told:
                self.refusal = (told["refused"], told["exit_code"])
            else:
                self._status |= told

    def _hear_gateway(self) -> None:
        if self._crew.to_gateway.closed:
            return
        for data in self._crew.to_gateway.receive():
            feedback = link.decode_feedback(data)
            if not isinstance(feedback, link.Feedback):
                self._hear_refusal(data)
                continue
            verdict = feedback.verdict
            self._state = verdict.state
            self._engaged |= verdict.state in COMMANDING
            if verdict.state in ENDING:
                self.why = verdict.reasons
            self._status |= {
                "state": verdict.state.value,
                "reasons": list(verdict.reasons),
                "wheel_speed_mps": feedback.wheel_speed,
                "gear": feedback.gear,
            }
            if self._operator is not None and not self._over:
                self._operator.saw(verdict)
                act = self._operator.act()
                if act is not None:
                    self._crew.to_gateway.send(link.encode_act(act))

    def _hear_refusal(self, data: bytes) -> None:
        """Take what a gateway says whose bus cannot be opened."""
        with contextlib.suppress(ValueError):
            told = json.loads(data)
            self.refusal = (told["refused"], told["exit_code"])

    def _judge(self) -> None:
        """End what has come to its end, and what never begins."""
        if self._over:
            return
        if self._status.get("outcome") is not None and self._state is ArmingState.ENGAGED:
            self._over = self._stops = True
        elif not self._engaged and self._crew.drive.poll() is not None:
            self._refuse("the drive's process ended before anything moved", 4)
        elif not self._engaged and self._crew.recorder.poll() is not None:
            self._refuse("the recorder's process ended before anything moved", 3)
        elif self._operator is not None and not self._engaged and time.monotonic() - self._begun > READY_LIMIT:
            missing = ", ".join(self._status.get("reasons", ())) or "the gateway does not answer"
            self._refuse(f"not ready after {READY_LIMIT:.0f} s: {missing}", 3)

    def _refuse(self, why: str, exit_code: int) -> None:
        self._hear_drive()
        self.refusal = self.refusal or (why, exit_code)
        self._leave()
