"""A stop that a browser asks for: it goes the operator's way, under a name of its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from vve_sumo.live.channel import ALIVE, Channel, pair
from vve_sumo.live.console import Console
from vve_sumo.live.keys import KeyCommand
from vve_sumo.values import ArmingState, GatewayStatus
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand


class At:
    """A console, with the other ends of its channels; `said` are the lines on its screen."""

    def __init__(self) -> None:
        gateway, self.gateway = pair()
        view, self.view = pair()
        drive, self.drive = pair()
        self.said: list[str] = []
        processes: Any = SimpleNamespace(
            to_gateway=gateway, gateway=None, to_drive=drive, to_view=view, to_car=None, further=()
        )
        screen: Any = SimpleNamespace(say=self.said.append)
        keys: Any = SimpleNamespace(filenos=list, commands=list)
        self.console = Console(processes, keys, screen, automatic=False)

    def hears(self, state: ArmingState) -> At:
        """Let the gateway report a state."""
        status = GatewayStatus(state, (), 0.0, 0.0, (), 0.0, 0.0)
        self.gateway.send(link.encode_feedback(link.Feedback(1.0, 1, 1.0, status, 0.0, 5.0, "drive", 1)))
        self.console._read_gateway()
        return self

    def asks(self) -> At:
        """Let the page ask for a stop."""
        self.view.send(b"stop")
        self.console._read_view()
        return self

    def sent(self) -> list[Any]:
        """What the console sends the gateway in one pass of its loop, without its signs of life."""
        self.console._give_commands()
        return [link.decode_operator_command(data) for data in self.gateway.receive() if data != ALIVE]


def test_the_page_stops_the_car_and_is_not_taken_for_the_operator() -> None:
    at = At().hears(ArmingState.ENGAGED)
    assert at.sent() == []
    at.asks()
    assert at.sent() == [OperatorCommand.STOP_BY_PAGE]
    assert at.sent() == [OperatorCommand.STOP_BY_PAGE], "again and again, until the gateway acts on it"
    at.hears(ArmingState.STOPPING)
    assert at.sent() == []


def test_the_operators_stop_counts_before_that_of_the_page() -> None:
    at = At().hears(ArmingState.ENGAGED).asks()
    at.console._apply_key(KeyCommand.STOP)
    assert at.asks().sent() == [OperatorCommand.STOP]


def test_before_anything_moves_the_page_ends_the_drive_and_the_operator_is_told_who_did() -> None:
    at = At().hears(ArmingState.READY).asks()
    gateway: Channel = at.console.processes.to_gateway
    assert gateway.closed
    assert at.said == ["  somebody asked to stop over the page in a browser: the drive is over before it began"]
