"""Gives each of several brains under test in parallel its own ports and links.

It knows a rig's wires and the placeholders of a brain's command; it must not know what is driven.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Final, Self

from vve_sumo.errors import ConfigError
from vve_sumo.pty_link import PREFIX
from vve_sumo.rig.connections import RigOutput
from vve_sumo.rig.schema import Rig

#: placeholder of the port that the setpoints go to; those of the wires are their kinds
SETPOINTS: Final = "setpoints"
_PLACEHOLDER: Final = re.compile(r"\{([a-z0-9_]+)\}")


@dataclass(frozen=True, slots=True)
class Place:
    """The ports and links of one brain and its drive."""

    rig: Rig
    command: str | None  #: command of the brain, with its placeholders filled; None: it is started by hand

    @property
    def ports(self) -> Mapping[int, str]:
        """Kinds of the wires that go to UDP ports of this machine, by port."""
        here = [output for output in self.rig.outputs if _is_here(output)]
        return {int((output.udp or "").rpartition(":")[2]): output.kind for output in here}

    def to_dict(self) -> dict[str, Any]:
        """Return the place for JSON, without the rest of the rig."""
        outputs = [[output.udp, output.channel] for output in self.rig.outputs]
        return {"command": self.command, "port": self.rig.brain.port, "outputs": outputs}

    @classmethod
    def from_dict(cls, rig: Rig, data: Mapping[str, Any]) -> Self:
        """Return the place of a rig that `to_dict` returned."""
        outputs = tuple(
            output.model_copy(update={"udp": udp, "channel": channel})
            for output, (udp, channel) in zip(rig.outputs, data["outputs"], strict=True)
        )
        brain = rig.brain.model_copy(update={"port": data["port"]})
        return cls(rig.model_copy(update={"brain": brain, "outputs": outputs}), data["command"])


def place_of(rig: Rig, command: str | None) -> Place:
    """Return the rig's own place; raises ConfigError for an unknown placeholder."""
    return Place(rig, None if command is None else _filled(command, _values(rig)))


def has_places(rig: Rig, command: str | None) -> bool:
    """Whether brains can be tested in parallel: the command takes every port and link of the rig."""
    return not list(_missing(rig, command))


def places_of(rig: Rig, command: str | None, count: int) -> list[Place]:
    """Return `count` places without common ports or links; raises ConfigError where that is impossible."""
    if count == 1:
        return [place_of(rig, command)]
    for line in _missing(rig, command):
        raise ConfigError(f"--workers {count}: {line}")
    assert command is not None
    with ExitStack() as held:
        return [place_of(_moved(rig, number, held), command) for number in range(count)]


def _missing(rig: Rig, command: str | None) -> Iterator[str]:
    """Yield the reasons why brains cannot be tested in parallel, a line each."""
    if command is None:
        yield "expected --brain: brains that are started by hand are tested one after the other"
        return
    kinds = [output.kind for output in rig.outputs]
    for number, output in enumerate(rig.outputs):
        pty = output.channel is not None and output.channel.startswith(PREFIX)
        if not (_is_here(output) or pty):
            yield f"outputs.{number}: expected a UDP port of this machine or a channel pty:FILE: each brain has its own"
        elif kinds.count(output.kind) > 1:
            yield f"outputs.{number}: expected one output of kind {output.kind!r}, got several"
        elif f"{{{output.kind}}}" not in command:
            yield _expected(output.kind, rig)
    if f"{{{SETPOINTS}}}" not in command:
        yield _expected(SETPOINTS, rig)


def _expected(name: str, rig: Rig) -> str:
    return f"expected {{{name}}} in the brain's command, in the place of {_values(rig)[name]}: each brain has its own"


def _is_here(output: RigOutput) -> bool:
    host = "" if output.udp is None else output.udp.rpartition(":")[0]
    return host.startswith("127.") or host == "localhost"


def _values(rig: Rig) -> dict[str, str]:
    """Return what each placeholder stands for: a UDP port, or the file of a link."""
    values = {SETPOINTS: str(rig.brain.port)}
    for output in rig.outputs:
        if output.udp is not None:
            values[output.kind] = output.udp.rpartition(":")[2]
        elif output.channel is not None:
            values[output.kind] = output.channel.removeprefix(PREFIX)
    return values


def _filled(command: str, values: Mapping[str, str]) -> str:
    def value(match: re.Match[str]) -> str:
        if match[1] not in values:
            known = ", ".join(f"{{{name}}}" for name in values)
            raise ConfigError(f"--brain: {match[0]} stands for no wire of the rig, expected one of {known}")
        return values[match[1]]

    return _PLACEHOLDER.sub(value, command)


def _moved(rig: Rig, number: int, stack: ExitStack) -> Rig:
    """Return a rig with free ports, which stay bound until all are chosen, and with links of another name."""

    def free() -> int:
        end = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        end.bind(("127.0.0.1", 0))
        return int(end.getsockname()[1])

    def moved(output: RigOutput) -> RigOutput:
        if output.udp is not None:
            return output.model_copy(update={"udp": f"{output.udp.rpartition(':')[0]}:{free()}"})
        return output.model_copy(update={"channel": f"{output.channel}.{number}"})

    brain = rig.brain.model_copy(update={"port": free()})
    return rig.model_copy(update={"brain": brain, "outputs": tuple(map(moved, rig.outputs))})
