"""Starts the processes that a live drive has only where its rig or scenario asks for them.

These are the page, the outgoing wires, the people's pages and the real on-board unit. Each says when it is ready; where
one cannot start, those that were started before it end, and there is no drive.
"""

from __future__ import annotations

import select
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from msgspec import to_builtins

from vve_sumo.errors import ConfigError, RigError, SimulationError, VveError
from vve_sumo.live import messages, spawn
from vve_sumo.live.brain_link import key_of, needs_signals
from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.plan import DrivePlan
from vve_sumo.live.view_token import certificate_of, token_of
from vve_sumo.messages import MalformedMessage
from vve_sumo.world.intersections import intersections

#: longest time for a process to be ready [s]; that of the people's pages reads the scenario again
TIMEOUT, PEOPLE_TIMEOUT = 20.0, 40.0
_ERRORS: Final = {2: ConfigError, 3: RigError, 4: SimulationError}

#: takes a line for the operator that needs no answer
Notify = Callable[[str], None]


@dataclass(slots=True)
class OptionalProcesses:
    """What a drive has of these processes, and the drive's ends of the channels to them."""

    view: subprocess.Popen[bytes] | None = None
    outputs: subprocess.Popen[bytes] | None = None
    people: subprocess.Popen[bytes] | None = None
    stations: subprocess.Popen[bytes] | None = None
    to_view: Channel | None = None  #: the console's channel to the page
    feeds: dict[str, Channel] = field(default_factory=dict)  #: by the name of the process

    def end(self) -> None:
        """End all of them, for a drive that does not begin: each ends with its channel."""
        for end in self.feeds.values():
            end.close()
        if self.view is not None and self.to_view is not None:
            self.to_view.close()
            self.view.wait(TIMEOUT)


def start(plan: DrivePlan, common: dict[str, Any], content: dict[str, Any], notify: Notify) -> OptionalProcesses:
    """Start the processes that a plan asks for; raises VveError where one cannot open what it serves.

    `common` is what every process of a drive is told, `content` the scenario as it is handed from process to process.
    """
    started = OptionalProcesses()
    try:
        _start_view(started, plan, content, notify)
        _start_outputs(started, plan, common, content["vehicle"])
        _start_people(started, plan, common, content, notify)
        _start_stations(started, plan, common)
    except VveError:
        started.end()
        raise
    return started


def error_of(message: messages.ConsoleMessage | MalformedMessage, otherwise: str = "") -> VveError:
    """Return the error of a process that refused its work; of one that said nothing, `otherwise`."""
    if isinstance(message, messages.Refused):
        return _ERRORS.get(message.exit_code, VveError)(message.text)
    return RigError(otherwise)


def _start_view(started: OptionalProcesses, plan: DrivePlan, content: dict[str, Any], notify: Notify) -> None:
    if not plan.view:
        return
    wanted = plan.rig.view
    config = {
        "folder": str(plan.folder),
        "resolved": content,
        "foxglove": plan.foxglove,
        "address": wanted.address,
        "port": wanted.port,
        "token": token_of(wanted, plan.working),
        "certificate": certificate_of(wanted, plan.working),
        "log": str(plan.folder / "view.log"),
    }
    process, console, feed, stops, ready = _started("view", config, TIMEOUT)
    if stops:
        _kill(process, feed)
        raise RigError("view: a page asked to stop before the drive began; close it, or begin again")
    for name, address in zip(("view", "foxglove"), ready.address, strict=False):
        notify(f"{name}: {address}")
    started.view, started.to_view, started.feeds["view"] = process, console, feed


def _start_outputs(
    started: OptionalProcesses, plan: DrivePlan, common: dict[str, Any], vehicle: dict[str, Any]
) -> None:
    if not plan.rig.outputs:
        return
    known = intersections(plan.resolved.network.path) if needs_signals(plan.rig) else ()
    config = common | {
        "outputs": [output.model_dump(mode="json") for output in plan.rig.outputs],
        "vehicle": vehicle,
        "projection": plan.resolved.map_frame.projection,
        "map_offset": plan.resolved.map_frame.offset,
        "intersections": to_builtins(known),
        "key": key_of(plan.rig.brain, plan.working).hex(),
        "log": str(plan.folder / "outputs.log"),
    }
    started.outputs, console, started.feeds["outputs"], _, _ = _started("outputs", config, TIMEOUT)
    console.close()


def _start_people(
    started: OptionalProcesses, plan: DrivePlan, common: dict[str, Any], content: dict[str, Any], notify: Notify
) -> None:
    if not plan.resolved.people:
        return
    wanted = plan.rig.people_page
    config = common | {
        "resolved": content,
        "working": str(plan.working),
        "address": wanted.address,
        "port": wanted.port,
        "token": token_of(wanted, plan.working, "people_page"),
        "certificate": certificate_of(wanted, plan.working),
        "log": str(plan.folder / "people.log"),
    }
    started.people, console, started.feeds["people"], _, ready = _started("people", config, PEOPLE_TIMEOUT)
    console.close()
    for address in ready.address:
        notify(f"people: {address}")


def _start_stations(started: OptionalProcesses, plan: DrivePlan, common: dict[str, Any]) -> None:
    if (wanted := plan.rig.v2x) is None:
        return
    config = common | {
        "listen": wanted.listen,
        "sender": wanted.sender,
        "log": str(plan.folder / "stations.log"),
    }
    started.stations, console, started.feeds["stations"], _, _ = _started("stations", config, TIMEOUT)
    console.close()


def _started(
    name: str, config: dict[str, Any], timeout: float
) -> tuple[subprocess.Popen[bytes], Channel, Channel, list[bytes], messages.Ready]:
    """Start a process and wait until it is ready; raises the VveError that it says, RigError where it says nothing.

    Return it, the console's and the drive's ends of its channels, what it said after that it is ready, and that.
    """
    drive, drives = pair()
    console, consoles = pair()
    process = spawn.start(name, config, {"drive": drives, "console": consoles}, own_session=True)
    select.select([console], [], [], timeout)
    first, *more = console.receive() or [b""]
    ready = messages.decode(first)
    if not isinstance(ready, messages.Ready):
        console.close()
        _kill(process, drive)
        raise error_of(ready, f"{name}: the process did not start")
    return process, console, drive, more, ready


def _kill(process: subprocess.Popen[bytes], feed: Channel) -> None:
    feed.close()
    process.kill()
    process.wait()
