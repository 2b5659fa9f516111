"""What a controller is, how one is found by its name, and how its failures become values.

It knows nothing of what controllers do with an observation; the shipped ones lie in the folder `controllers/`.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import math
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import PathFinder
from importlib.metadata import entry_points
from pathlib import Path as Folder
from types import ModuleType
from typing import NamedTuple, Protocol, runtime_checkable

from vve_sumo.errors import ConfigError
from vve_sumo.values import ControlCommand, Observation, Vehicle

ENTRY_POINTS = "vve_sumo.controllers"

#: what the package that a controllers' folder becomes is called, before a digest of the folder
PACKAGE = "vve_sumo_workspace_"

TuningValue = float | str | bool
Tuning = Mapping[str, TuningValue]


@runtime_checkable
class Controller(Protocol):
    """Anything that answers an observation with a control command, once a tick, in the order of the ticks."""

    def step(self, observation: Observation) -> ControlCommand:
        """Return steering [rad] and acceleration [m/s2], which the tick stamps into a setpoint."""
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
        raise ConfigError(f"controller {name}: make raised {_described(error)}") from error
    if not isinstance(controller, Controller):
        raise ConfigError(f"controller {name}: make returned a {type(controller).__name__} without step(observation)")
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


class Origin(NamedTuple):
    """Where a controller's code lies."""

    root: Folder  #: what the names of its modules count from
    main: str  #: the module that offers it, dotted
    installed: bool  #: whether it belongs to an installed package, all of whose files count as its code

    def file(self, module: str) -> Folder | None:
        """Return the file that an import of one of its modules would run; None where there is none."""
        importlib.invalidate_caches()
        places, found = [str(self.root)], None
        for part in module.split("."):
            # Of a part with a slash the finder would look outside the root.
            found = None if "/" in part or not part else PathFinder.find_spec(part, places)
            if found is None:
                return None
            places = list(found.submodule_search_locations or ())
        return Folder(found.origin) if found is not None and found.has_location and found.origin else None


def origin(name: str, search: Sequence[Folder]) -> Origin:
    """Return where `load` would take a controller's code from; nothing of that code is run.

    Raises ConfigError where there is nothing of the name, or nothing that lies in files.
    """
    if ":" in name:
        file = Folder(name.rpartition(":")[0])
        if not file.is_file():
            raise ConfigError(f"controller {name}: there is no file {file}")
        return Origin(file.resolve().parent, file.stem, False)
    for folder in search:
        if (folder / f"{name}.py").is_file():
            return Origin((folder / f"{name}.py").resolve().parent, name, False)
    for entry in entry_points(group=ENTRY_POINTS, name=name):
        return _installed(name, entry.module)
    raise _unknown(name, search)


def _installed(name: str, module: str) -> Origin:
    """Return where an entry point's module lies; only its outermost package is looked for, which runs nothing."""
    top = module.partition(".")[0]
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        spec = None
    places = list(spec.submodule_search_locations or ()) if spec is not None else []
    if spec is None or not (places or spec.has_location):
        raise ConfigError(f"controller {name}: the package {top} of its entry point lies in no file")
    return Origin(Folder(places[0] if places else str(spec.origin)).parent, module, True)


def sources(name: str, search: Sequence[Folder]) -> dict[str, Folder]:
    """Return the files of the code of a controller that was just loaded, by the names of their modules.

    Of a file these are its own and those of the neighbours that it imported; of an entry point every file of its
    outermost package. Empty where the code lies in no file.
    """
    try:
        place = origin(name, search)
    except ConfigError:
        return {}
    if place.installed:
        return _files_of_package(place)
    package = _package(place.root)
    modules = {
        key.removeprefix(f"{package}."): sys.modules[key] for key in sys.modules if key.startswith(f"{package}.")
    }
    files = {module: getattr(modules[module], "__file__", None) for module in sorted(modules)}
    return {module: Folder(file) for module, file in files.items() if file}


def _files_of_package(place: Origin) -> dict[str, Folder]:
    top = place.main.partition(".")[0]
    own = place.file(top)
    inside = (place.root / top).rglob("*.py") if own is None or own.name == "__init__.py" else [own]
    named = {".".join(file.relative_to(place.root).with_suffix("").parts): file for file in inside}
    return {module.removesuffix(".__init__"): named[module] for module in sorted(named)}


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

    def step(self, observation: Observation) -> tuple[ControlCommand | None, tuple[str, ...]]:
        """Return the controller's command and no reason, or None and why there is none.

        What comes back holds plain numbers and a printable note.
        """
        try:
            command: object = self._controller.step(observation)
            if not isinstance(command, ControlCommand) or not _has_types(command):
                return self._refused("controller_wrong_type", f"got {command!r}, expected a ControlCommand of floats")
            steering, acceleration = float(command.steering), float(command.acceleration)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return self._refused("controller_raised", _described(error))
        if not (math.isfinite(steering) and math.isfinite(acceleration)):
            return self._refused("controller_not_finite", f"steering {steering}, acceleration {acceleration}")
        note = command.note if command.note.isascii() and command.note.isprintable() else ascii(command.note)
        return ControlCommand(steering, acceleration, emergency=command.emergency, note=note), ()

    def _refused(self, code: str, text: str) -> tuple[None, tuple[str, ...]]:
        self.text = text
        return None, (code,)


def _has_types(command: ControlCommand) -> bool:
    values: tuple[object, ...] = (command.steering, command.acceleration)
    flag: object = command.emergency
    note: object = command.note
    return all(isinstance(value, (float, int)) for value in values) and isinstance(flag, bool) and isinstance(note, str)


def _described(error: BaseException) -> str:
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
    raise _unknown(name, search)


def _unknown(name: str, search: Sequence[Folder]) -> ConfigError:
    return ConfigError(f"controller {name}: unknown; known are {', '.join(known(search)) or 'none'}")


def _loaded_entry(name: str, load_it: Callable[[], Maker]) -> Maker:
    try:
        return load_it()
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name}: its entry point raised {_described(error)}") from error


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
        raise ConfigError(f"controller {name}: reading {file} raised {_described(error)}") from error


def _package(folder: Folder) -> str:
    """Return the name of the package that a folder of controllers becomes."""
    return f"{PACKAGE}{hashlib.sha256(str(folder).encode()).hexdigest()[:16]}"


def _imported(file: Folder) -> ModuleType:
    """Import a file as a member of a package made of its folder, under a name nobody else can have."""
    folder = file.resolve().parent
    package = _package(folder)
    for stale in [key for key in sys.modules if key == package or key.startswith(f"{package}.")]:
        del sys.modules[stale]
    root = ModuleType(package)
    root.__path__ = [str(folder)]
    sys.modules[package] = root
    importlib.invalidate_caches()
    return importlib.import_module(f"{package}.{file.stem}")
