"""Defines the interface of a controller, finds controllers by name, and turns their failures into reason codes.

It knows nothing of what controllers do with an observation; the shipped ones lie in the folder `controllers/`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Final, Protocol, runtime_checkable

from vve_sumo.commanded_path import flaw, plain
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.ports import Origin, Port, error_text
from vve_sumo.values import CommandedPath, ControlCommand, Observation, Vehicle

PORT: Final = Port(
    "controller",
    "vve_sumo.controllers",
    "(vehicle, tuning)",
    shipped={"fmu": "vve_sumo.bridges.fmu"},
    library="vve_sumo.controllers",
)

TuningValue = float | str | bool
Tuning = Mapping[str, TuningValue]


@runtime_checkable
class Controller(Protocol):
    """Anything that answers an observation with a control command, once a tick, in the order of the ticks."""

    def step(self, observation: Observation) -> ControlCommand:
        """Return steering [rad] and acceleration [m/s2], which the tick stamps into a setpoint."""
        ...


Maker = Callable[[Vehicle, Tuning], Controller]


def load(name: str, vehicle: Vehicle, tuning: Tuning, search: Sequence[Path]) -> Controller:
    """Make the controller of a name.

    `name` is a file's stem in one of the `search` folders, of which the first that has it counts; or
    `file.py:function`; or an entry point of the group `vve_sumo.controllers`. Each gives a function
    `make(vehicle, tuning)`. A file may import its neighbours: `from .preview import PreviewSteering`. It is read
    again at every call. Raises ConfigError, which names the controller, where nothing is found or `make` fails.
    """
    controller = PORT.make(name, PORT.find(name, search), vehicle, tuning)
    if not isinstance(controller, Controller):
        raise ConfigError(f"controller {name}: make returned a {type(controller).__name__} without step(observation)")
    return controller


def known(search: Sequence[Path]) -> tuple[str, ...]:
    """List the names that `load` would find, sorted."""
    return PORT.known(search)


def module(name: str, search: Sequence[Path]) -> ModuleType:
    """Import a file of the controller folders by its stem, such as the gain design; raises ConfigError."""
    return PORT.module(name, search)


def origin(name: str, search: Sequence[Path]) -> Origin:
    """Return where the code lies that `load` would take, as `Port.origin` does."""
    return PORT.origin(name, search)


def sources(name: str, search: Sequence[Path]) -> dict[str, Path]:
    """Return the code files of a controller that was just loaded, as `Port.sources` does."""
    return PORT.sources(name, search)


def settle(
    tuning: Tuning, defaults: Tuning, ranges: Mapping[str, tuple[float, float]] | None = None
) -> dict[str, TuningValue]:
    """Return the defaults overridden by a user's tuning; a key's type is the type of its default.

    Raises ConfigError, naming the key and what is allowed, for an unknown key, a wrong type, and a number that is not
    finite or lies outside the key's (least, greatest) in `ranges`.
    """
    for key, value in tuning.items():
        if key not in defaults:
            near = did_you_mean(key, defaults)
            unknown = f"tuning key {key!r} is unknown{f', {near}' if near else ''}"
            raise ConfigError(f"{unknown}; allowed are {', '.join(sorted(defaults))}")
        wanted, number = defaults[key], isinstance(value, (int, float)) and not isinstance(value, bool)
        if isinstance(wanted, float):
            if not number or not math.isfinite(value):  # type: ignore[arg-type]
                raise ConfigError(f"tuning key {key!r} must be a finite number, got {value!r}")
        elif type(value) is not type(wanted):
            raise ConfigError(f"tuning key {key!r} must be a {type(wanted).__name__}, got {value!r}")
    numbers = {key: float(value) for key, value in tuning.items() if isinstance(defaults[key], float)}
    settled = {**defaults, **tuning, **numbers}
    for key, (least, greatest) in (ranges or {}).items():
        if not least <= (came := float(settled[key])) <= greatest:
            raise ConfigError(f"tuning key {key!r} must be {least:g} to {greatest:g}, got {came:g}")
    return settled


class GuardedController(Protocol):
    """A controller whose failures are reason codes, as `Guarded` is."""

    @property
    def text(self) -> str:
        """Text of the last failure; empty where none ever failed."""
        ...

    def step(self, observation: Observation) -> tuple[ControlCommand | None, tuple[str, ...]]:
        """Return the command and no reason code, or None and the reason code of the failure."""
        ...


class Guarded:
    """Calls a controller; returns its failures as reason codes instead of raising them.

    Codes: controller_raised, controller_wrong_type, controller_not_finite, controller_path_invalid.
    """

    __slots__ = ("_controller", "text")

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.text = ""  #: text of the last failure, for the record

    def step(self, observation: Observation) -> tuple[ControlCommand | None, tuple[str, ...]]:
        """Return the controller's command and no reason code, or None and the reason code of the failure.

        The command holds plain floats and a printable ASCII note.
        """
        try:
            command: object = self._controller.step(observation)
            if not isinstance(command, ControlCommand) or not _has_types(command):
                return self._refused("controller_wrong_type", f"got {command!r}, expected a ControlCommand of floats")
            steering, acceleration = float(command.steering), float(command.acceleration)
            path, wrong = _checked(command.path, observation)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return self._refused("controller_raised", error_text(error, __file__))
        if not (math.isfinite(steering) and math.isfinite(acceleration)):
            return self._refused("controller_not_finite", f"steering {steering}, acceleration {acceleration}")
        if wrong:
            return self._refused("controller_path_invalid", f"path: {wrong}")
        note = command.note if command.note.isascii() and command.note.isprintable() else ascii(command.note)
        return ControlCommand(steering, acceleration, emergency=command.emergency, note=note, path=path), ()

    def _refused(self, code: str, text: str) -> tuple[None, tuple[str, ...]]:
        self.text = text
        return None, (code,)


def _has_types(command: ControlCommand) -> bool:
    steering: object = command.steering
    acceleration: object = command.acceleration
    flag: object = command.emergency
    note: object = command.note
    numbers = isinstance(steering, (float, int)) and isinstance(acceleration, (float, int))
    path: object = command.path
    whole = path is None or isinstance(path, CommandedPath)
    return numbers and isinstance(flag, bool) and isinstance(note, str) and whole


def _checked(path: CommandedPath | None, observation: Observation) -> tuple[CommandedPath | None, str]:
    """Return a command's path in plain floats, and in one line what is wrong with it."""
    if path is None:
        return None, ""
    try:
        checked = plain(path)
    except (TypeError, ValueError, OverflowError) as error:
        return None, f"x, y and speed must be sequences of numbers: {error}"
    return checked, flaw(checked, observation.pose)
