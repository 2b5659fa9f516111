"""What a controller is, how one is found by its name, and how its failures become values.

It knows nothing of what controllers do with a situation; the shipped ones lie in the folder `controllers/`.
"""

from __future__ import annotations

import hashlib
import importlib
import math
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path as Folder
from types import ModuleType
from typing import Protocol, runtime_checkable

from vve_sumo.errors import ConfigError
from vve_sumo.values import Setpoint, Situation, Vehicle

ENTRY_POINTS = "vve_sumo.controllers"

#: what the package that a controllers' folder becomes is called, before a digest of the folder
PACKAGE = "vve_sumo_workspace_"

TuningValue = float | str | bool
Tuning = Mapping[str, TuningValue]


@runtime_checkable
class Controller(Protocol):
    """Anything that answers a situation with a setpoint, once a tick, in the order of the ticks."""

    def step(self, situation: Situation) -> Setpoint:
        """Return steering [rad] and acceleration [m/s2]; the tick stamps the rest."""
        ...


Maker = Callable[[Vehicle, Tuning], Controller]


def load(name: str, vehicle: Vehicle, tuning: Tuning, search: Sequence[Folder]) -> Controller:
    """Make the controller that a name stands for.

    `name` is a file's stem in one of the `search` folders, the first that has it; or `file.py:function`;
    or an entry point of the group `vve_sumo.controllers`. Each finds a `make(vehicle, tuning)`.
    A file's neighbours are its package: it may `from .preview import PreviewSteering`. It is read afresh.
    Raises ConfigError, which begins with the name, where nothing is found or `make` refuses.
    """
    make = _found(name, search)
    try:
        controller = make(vehicle, tuning)
    except ConfigError as error:
        raise ConfigError(f"controller {name}: {error}") from error
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name}: make raised {_told(error)}") from error
    if not isinstance(controller, Controller):
        raise ConfigError(f"controller {name}: make returned a {type(controller).__name__} without step(situation)")
    return controller


def known(search: Sequence[Folder]) -> tuple[str, ...]:
    """List the names that `load` would find, sorted."""
    files = (file for folder in search if folder.is_dir() for file in folder.glob("*.py"))
    offered = {file.stem for file in files if "\ndef make(" in file.read_text(encoding="utf-8", errors="replace")}
    return tuple(sorted(offered | {entry.name for entry in entry_points(group=ENTRY_POINTS)}))


def module(name: str, search: Sequence[Folder]) -> ModuleType:
    """Import a file of the controller folders by its stem, such as the gain design; raises ConfigError."""
    for folder in search:
        if (file := folder / f"{name}.py").is_file():
            return _read(name, file)
    raise ConfigError(f"controller file {name}.py: not in {', '.join(map(str, search)) or 'any folder'}")


def sources(controller: Controller) -> tuple[Folder, ...]:
    """Return the files that a controller's code came from, sorted: its own and the neighbours that it imported."""
    own = type(controller).__module__
    package = own.partition(".")[0]
    names = [key for key in sys.modules if key.startswith(f"{package}.")] if package.startswith(PACKAGE) else [own]
    files = (getattr(sys.modules.get(name), "__file__", None) for name in names)
    return tuple(sorted(Folder(file) for file in files if file))


def settle(tuning: Tuning, defaults: Tuning) -> dict[str, TuningValue]:
    """Lay a user's tuning over the defaults; a default's type is the key's type.

    Raises ConfigError, naming the key and what is allowed, on an unknown key, another type or a number
    that is not finite.
    """
    for key, value in tuning.items():
        if key not in defaults:
            raise ConfigError(f"tuning key {key!r} is unknown; allowed are {', '.join(sorted(defaults))}")
        wanted, number = defaults[key], isinstance(value, (int, float)) and not isinstance(value, bool)
        if isinstance(wanted, float):
            if not number or not math.isfinite(value):  # type: ignore[arg-type]
                raise ConfigError(f"tuning key {key!r} must be a finite number, got {value!r}")
        elif type(value) is not type(wanted):
            raise ConfigError(f"tuning key {key!r} must be a {type(wanted).__name__}, got {value!r}")
    numbers = {key: float(value) for key, value in tuning.items() if isinstance(defaults[key], float)}
    return {**defaults, **tuning, **numbers}


class Guarded:
    """A controller whose failures are values: what cannot be acted on comes back as None and reason codes.

    Codes: controller_raised, controller_wrong_type, controller_not_finite.
    """

    __slots__ = ("_controller", "text")

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.text = ""  #: what the last failure said, for the record

    def step(self, situation: Situation) -> tuple[Setpoint | None, tuple[str, ...]]:
        """Return the controller's setpoint and no reason, or None and why there is none.

        What comes back holds the four fields that a controller fills, as plain numbers and a printable note.
        """
        try:
            setpoint: object = self._controller.step(situation)
            if not isinstance(setpoint, Setpoint) or not _has_types(setpoint):
                return self._refused("controller_wrong_type", f"got {setpoint!r}, expected a Setpoint of floats")
            steering, acceleration = float(setpoint.steering), float(setpoint.acceleration)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return self._refused("controller_raised", _told(error))
        if not (math.isfinite(steering) and math.isfinite(acceleration)):
            return self._refused("controller_not_finite", f"steering {steering}, acceleration {acceleration}")
        note = setpoint.note if setpoint.note.isascii() and setpoint.note.isprintable() else ascii(setpoint.note)
        return Setpoint(steering, acceleration, emergency=setpoint.emergency, note=note), ()

    def _refused(self, code: str, text: str) -> tuple[None, tuple[str, ...]]:
        self.text = text
        return None, (code,)


def _has_types(setpoint: Setpoint) -> bool:
    commands: tuple[object, ...] = (setpoint.steering, setpoint.acceleration)
    told: tuple[object, ...] = (setpoint.emergency, setpoint.note)
    numbers = all(isinstance(command, (float, int)) for command in commands)
    return numbers and isinstance(told[0], bool) and isinstance(told[1], str)


def _told(error: BaseException) -> str:
    """What an error says, and the line of a controller's file that it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    place = next(
        (f" ({Folder(f.filename).name}, line {f.lineno})" for f in reversed(frames) if f.filename != __file__), ""
    )
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = "(an error that cannot say what it is)"
    return f"{type(error).__name__}: {text}{place}"


def _found(name: str, search: Sequence[Folder]) -> Maker:
    if ":" in name:
        file, _, function = name.rpartition(":")
        return _offered(name, Folder(file), function)
    for folder in search:
        if (file_there := folder / f"{name}.py").is_file():
            return _offered(name, file_there, "make")
    for entry in entry_points(group=ENTRY_POINTS, name=name):
        return _loaded_entry(name, entry.load)
    raise ConfigError(f"controller {name}: unknown; known are {', '.join(known(search)) or 'none'}")


def _loaded_entry(name: str, load_it: Callable[[], Maker]) -> Maker:
    try:
        return load_it()
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name}: its entry point raised {_told(error)}") from error


def _offered(name: str, file: Folder, function: str) -> Maker:
    if not file.is_file():
        raise ConfigError(f"controller {name}: there is no file {file}")
    make: Maker | None = getattr(_read(name, file), function, None)
    if not callable(make):
        raise ConfigError(f"controller {name}: {file} offers no function {function}(vehicle, tuning)")
    return make


def _read(name: str, file: Folder) -> ModuleType:
    try:
        return _imported(file)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name}: reading {file} raised {_told(error)}") from error


def _imported(file: Folder) -> ModuleType:
    """Import a file as a member of a package made of its folder, under a name nobody else can have."""
    folder = file.resolve().parent
    package = f"{PACKAGE}{hashlib.sha256(str(folder).encode()).hexdigest()[:16]}"
    for stale in [key for key in sys.modules if key == package or key.startswith(f"{package}.")]:
        del sys.modules[stale]
    root = ModuleType(package)
    root.__path__ = [str(folder)]
    sys.modules[package] = root
    importlib.invalidate_caches()
    return importlib.import_module(f"{package}.{file.stem}")
