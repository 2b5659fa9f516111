"""One console for two real cars: what its keys say to which gateway."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from vve_sumo.live.channel import ALIVE, pair
from vve_sumo.live.console import Console
from vve_sumo.live.keys import KeyCommand
from vve_sumo.live.messages import DriveStatus, encode
from vve_sumo.values import ArmingState, GatewayStatus
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import WAITING
from vve_sumo.vehicle.arming_machine import OperatorCommand

CARS = ("ego", "second")
ENGAGE, GO, STOP, END = OperatorCommand.ENGAGE, OperatorCommand.GO, OperatorCommand.STOP, OperatorCommand.END


class At:
    """A console of two cars, with the other ends of its channels."""

    def __init__(self, *, automatic: bool = False) -> None:
        ours, theirs = zip(*(pair() for _ in CARS), strict=True)
        self.gateways = dict(zip(CARS, theirs, strict=True))
        drive, self.drive = pair()
        self.said: list[str] = []
        process: Any = SimpleNamespace(poll=lambda: None)
        second: Any = SimpleNamespace(
            ego="second", recorder=process, gateway=process, to_gateway=ours[1], automatic=automatic
        )
        processes: Any = SimpleNamespace(
            to_gateway=ours[0], gateway=process, recorder=process, drive=process, to_drive=drive, to_view=None,
            further=(second,),
        )  # fmt: skip
        screen: Any = SimpleNamespace(say=self.said.append)
        keys: Any = SimpleNamespace(filenos=list, commands=list)
        self.console = Console(processes, keys, screen, automatic=automatic)

    def hears(self, car: str, state: ArmingState, *reasons: str) -> At:
        """Let a gateway report a state."""
        status = GatewayStatus(state, reasons, 0.0, 0.0, (), 0.0, 0.0)
        self.gateways[car].send(link.encode_feedback(link.Feedback(1.0, 1, 1.0, status, 0.0, 5.0, "drive", 1)))
        self.console._read_gateway()
        return self

    def ended(self, car: str, outcome: str) -> At:
        """Let the drive tell of a car's outcome."""
        status = DriveStatus(1, 1.0, (), {}, (), 0.0, 0.0, 0.0, None, "", {}, 0, {}, outcome, car)
        self.drive.send(encode(status))
        self.console._read_drive()
        self.console._judge()
        return self

    def key(self, command: KeyCommand) -> dict[str, list[Any]]:
        """Press a key; return what goes to each gateway in this pass of the console's loop."""
        self.console._apply_key(command)
        return self.sent()

    def sent(self) -> dict[str, list[Any]]:
        self.console._give_commands()
        return {
            car: [link.decode_operator_command(data) for data in end.receive() if data != ALIVE]
            for car, end in self.gateways.items()
        }


def test_e_engages_the_cars_that_are_ready_and_no_other() -> None:
    at = At().hears("ego", ArmingState.READY).hears("second", ArmingState.DISARMED)
    assert at.key(KeyCommand.ENGAGE) == {"ego": [ENGAGE], "second": []}
    at.hears("ego", ArmingState.ENGAGED, WAITING).hears("second", ArmingState.READY)
    assert at.key(KeyCommand.ENGAGE) == {"ego": [], "second": [ENGAGE]}


def test_no_car_goes_before_all_are_engaged() -> None:
    """A go that comes too early is a stop of both, as it is for one car."""
    at = At().hears("ego", ArmingState.ENGAGED, WAITING).hears("second", ArmingState.READY)
    assert at.key(KeyCommand.GO)["ego"] == [STOP]
    assert at.said == ["  g came too early and stops the drive: second is not engaged and held"]
    at = At().hears("ego", ArmingState.ENGAGED, WAITING).hears("second", ArmingState.ENGAGED, WAITING)
    assert at.key(KeyCommand.GO) == {"ego": [GO], "second": [GO]}


def test_a_scripted_operator_waits_for_the_other_car_too() -> None:
    at = At(automatic=True).hears("ego", ArmingState.READY)
    assert at.sent() == {"ego": [ENGAGE], "second": []}
    assert at.hears("ego", ArmingState.ENGAGED, WAITING).sent()["ego"] == []
    at.hears("second", ArmingState.READY).sent()
    at.hears("second", ArmingState.ENGAGED, WAITING)
    assert at.sent()["second"] == [GO]
    assert at.hears("ego", ArmingState.ENGAGED, WAITING).sent()["ego"] == [GO]


@pytest.mark.parametrize("command", [KeyCommand.STOP, KeyCommand.ENGAGE])
def test_any_key_under_way_stops_both(command: KeyCommand) -> None:
    at = At().hears("ego", ArmingState.ENGAGED).hears("second", ArmingState.ENGAGED)
    assert at.key(command) == {"ego": [STOP], "second": [STOP]}


def test_a_car_at_its_end_is_held_until_the_other_has_come_to_its_own() -> None:
    at = At().hears("ego", ArmingState.ENGAGED).hears("second", ArmingState.ENGAGED)
    assert at.ended("ego", "arrived").sent() == {"ego": [], "second": []}
    assert at.ended("second", "arrived").sent() == {"ego": [END], "second": [END]}


def test_a_car_that_goes_on_alone_ends_with_its_own_outcome() -> None:
    at = At().hears("ego", ArmingState.ENGAGED).hears("second", ArmingState.ENGAGED)
    at.gateways["second"].close()
    at.hears("ego", ArmingState.ENGAGED)
    assert at.console.cars[1].gateway.closed
    at.console._judge()
    at.drive.send(encode(DriveStatus(1, 1.0, (), {}, (), 0.0, 0.0, 0.0, None, "", {}, 0, {}, "arrived", "ego")))
    at.console._read_drive()
    at.console._judge()
    at.console._give_commands()
    heard = [link.decode_operator_command(data) for data in at.gateways["ego"].receive() if data != ALIVE]
    assert heard == [END]
