"""Finds a plug-in by its name: a controller, a drive-by-wire interface, a receiver or a sensor.

A name is `file.py:function`, a file of a search folder, a shipped part, or an entry point of an installed package. This
module knows nothing of what the parts do. Errors of a part's code become ConfigError.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.machinery import PathFinder
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from vve_sumo.errors import ConfigError, did_you_mean

Make = Callable[..., Any]

#: prefix of the name of the package that a part's folder becomes; a hash of folder and file follows
PACKAGE = "vve_sumo_workspace_"
#: prefix of the names of modules that are no part's own: those of a library of shipped parts
OWN = "vve_sumo."
#: number of characters of a name that a message repeats, where the name cannot be looked up
LONGEST = 80


class Origin(NamedTuple):
    """Where the code of a part lies."""

    root: Path  #: folder from which the names of the part's modules count
    main: str  #: dotted name of the module that offers the part
    installed: bool  #: whether the part belongs to an installed package, all of whose files count as its code

    def file(self, module: str) -> Path | None:
        """Return the file that an import of one of the part's modules would run; None where there is none."""
        importlib.invalidate_caches()
        if module.startswith(OWN):
            spec = importlib.util.find_spec(module)
            return Path(spec.origin) if spec is not None and spec.origin else None
        places, found = [str(self.root)], None
        for part in module.split("."):
            # With a slash in the name the finder would search outside the root.
            found = None if "/" in part or not part else PathFinder.find_spec(part, places)
            if found is None:
                return None
            places = list(found.submodule_search_locations or ())
        return Path(found.origin) if found is not None and found.has_location and found.origin else None


@dataclass(frozen=True, slots=True)
class Port:
    """One kind of plug-in; a ConfigError of any method begins with the kind and the name."""

    kind: str  #: name of the kind in messages
    group: str  #: group of entry points
    arguments: str  #: arguments of `make`, for messages
    shipped: Mapping[str, str] = field(default_factory=dict)  #: from the names of shipped parts to their modules
    library: str = ""  #: package of shipped parts that the code of others may import; empty for none

    def find(self, name: str, search: Sequence[Path] = ()) -> Make:
        """Return the function that makes the part of a name; a file is read again at every call."""
        if ":" in name:
            file, _, function = name.rpartition(":")
            return self._offered(name, Path(file), function)
        for folder in search:
            if self._is_file(name, file_there := folder / f"{name}.py"):
                return self._offered(name, file_there, "make")
        if name in self.shipped:
            make: Make = importlib.import_module(self.shipped[name]).make
            return make
        for entry in entry_points(group=self.group, name=name):
            return self._loaded_entry(name, entry.load)
        raise self._unknown(name, search)

    def make(self, name: str, make: Make, *arguments: object) -> Any:
        """Return the result of `make`; its errors become ConfigError."""
        try:
            return make(*arguments)
        except ConfigError as error:
            raise ConfigError(f"{self.kind} {name}: {error}") from error
        except (Exception, SystemExit) as error:
            raise ConfigError(f"{self.kind} {name}: make raised {error_text(error, __file__)}") from error

    def known(self, search: Sequence[Path] = ()) -> tuple[str, ...]:
        """List the names that `find` would find, sorted."""
        files = (file for folder in search if folder.is_dir() for file in folder.glob("*.py"))
        offered = {file.stem for file in files if "\ndef make(" in file.read_text(encoding="utf-8", errors="replace")}
        return tuple(sorted(offered | set(self.shipped) | {entry.name for entry in entry_points(group=self.group)}))

    def module(self, name: str, search: Sequence[Path]) -> ModuleType:
        """Import a file of the search folders by its stem, such as the gain design."""
        for folder in search:
            if self._is_file(name, file := folder / f"{name}.py"):
                return self._read(name, file)
        raise ConfigError(f"{self.kind} file {name}.py: not in {', '.join(map(str, search)) or 'any folder'}")

    def origin(self, name: str, search: Sequence[Path] = ()) -> Origin:
        """Return where the code of a part lies that `find` would take; none of that code is run.

        Raises ConfigError for an unknown name, for a shipped part, and where the code lies in no file.
        """
        if ":" in name:
            file = Path(name.rpartition(":")[0])
            if not self._is_file(name, file):
                raise ConfigError(f"{self.kind} {name}: there is no file {file}")
            return Origin(file.resolve().parent, file.stem, False)
        for folder in search:
            if self._is_file(name, folder / f"{name}.py"):
                return Origin((folder / f"{name}.py").resolve().parent, name, False)
        for entry in entry_points(group=self.group, name=name):
            return self._installed(name, entry.module)
        raise self._unknown(name, search)

    def sources(self, name: str, search: Sequence[Path] = ()) -> dict[str, Path]:
        """Return the code files of a part that was just found, by the names of their modules.

        For a part from a file these are the file, the neighbours that it imported, and what both took of the `library`,
        by its full name; for an entry point every file of its outermost package. Empty for a shipped part, and where
        the code lies in no file.
        """
        if self._is_shipped(name, search):
            return {}  # without the list of entry points, which takes 20 ms
        try:
            place = self.origin(name, search)
        except ConfigError:
            return {}
        if place.installed:
            return _files_of_package(place)
        package = _package(place.root, place.main)
        modules = {
            key.removeprefix(f"{package}."): sys.modules[key] for key in sys.modules if key.startswith(f"{package}.")
        }
        modules |= self._of_library(modules.values())
        files = {module: getattr(modules[module], "__file__", None) for module in sorted(modules)}
        return {module: Path(file) for module, file in files.items() if file}

    def _of_library(self, users: Iterable[ModuleType]) -> dict[str, ModuleType]:
        """Return the modules of the library that modules took names from, and those that these took names from."""
        found: dict[str, ModuleType] = {}
        left = list(users) if self.library else []
        while left:
            for value in list(vars(left.pop()).values()):
                name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
                if isinstance(name, str) and name.startswith(f"{self.library}.") and name not in found:
                    found[name] = sys.modules[name]
                    left.append(found[name])
        return found

    def _installed(self, name: str, module: str) -> Origin:
        """Return where an entry point's module lies; only its outermost package is looked up, which runs no code."""
        top = module.partition(".")[0]
        try:
            spec = importlib.util.find_spec(top)
        except (ImportError, ValueError):
            spec = None
        places = list(spec.submodule_search_locations or ()) if spec is not None else []
        if spec is None or not (places or spec.has_location):
            raise ConfigError(f"{self.kind} {name}: the package {top} of its entry point lies in no file")
        return Origin(Path(places[0] if places else str(spec.origin)).parent, module, True)

    def _is_shipped(self, name: str, search: Sequence[Path]) -> bool:
        return name in self.shipped and not any(self._is_file(name, folder / f"{name}.py") for folder in search)

    def _is_file(self, name: str, file: Path) -> bool:
        try:
            return file.is_file()
        except OSError as error:  # such as for a name that is too long for a file
            raise ConfigError(f"{self.kind} {name[:LONGEST]}…: cannot be looked up: {error.strerror}") from None

    def _unknown(self, name: str, search: Sequence[Path]) -> ConfigError:
        known = self.known(search)
        near = did_you_mean(name, known)
        unknown = f"{self.kind} {name}: unknown{f', {near}' if near else ''}"
        return ConfigError(f"{unknown}; known are {', '.join(known) or 'none'}")

    def _loaded_entry(self, name: str, load_it: Callable[[], Make]) -> Make:
        try:
            return load_it()
        except (Exception, SystemExit) as error:
            raise ConfigError(f"{self.kind} {name}: its entry point raised {error_text(error, __file__)}") from error

    def _offered(self, name: str, file: Path, function: str) -> Make:
        if not self._is_file(name, file):
            raise ConfigError(f"{self.kind} {name}: there is no file {file}")
        make: Make | None = getattr(self._read(name, file), function, None)
        if not callable(make):
            raise ConfigError(f"{self.kind} {name}: {file} offers no function {function}{self.arguments}")
        return make

    def _read(self, name: str, file: Path) -> ModuleType:
        try:
            return _imported(file)
        except (Exception, SystemExit) as error:
            raise ConfigError(f"{self.kind} {name}: reading {file} raised {error_text(error, __file__)}") from error


def error_text(error: BaseException, hidden: str) -> str:
    """Return type and text of an error, and the innermost line of its traceback outside the file `hidden`."""
    frames = traceback.extract_tb(error.__traceback__)
    place = next((f" ({Path(f.filename).name}, line {f.lineno})" for f in reversed(frames) if f.filename != hidden), "")
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = "(an error that cannot say what it is)"
    return f"{type(error).__name__}: {text}{place}"


def _files_of_package(place: Origin) -> dict[str, Path]:
    top = place.main.partition(".")[0]
    own = place.file(top)
    inside = (place.root / top).rglob("*.py") if own is None or own.name == "__init__.py" else [own]
    named = {".".join(file.relative_to(place.root).with_suffix("").parts): file for file in inside}
    return {module.removesuffix(".__init__"): named[module] for module in sorted(named)}


def _package(folder: Path, stem: str) -> str:
    """Return the name of the package that the folder of a part's file becomes, different for every file."""
    return f"{PACKAGE}{hashlib.sha256(str(folder / stem).encode()).hexdigest()[:16]}"


def _imported(file: Path) -> ModuleType:
    """Import a file as a module of a package made of its folder, under a name that no other code uses.

    Another part of the same folder gets its own package, so that neither removes the other's modules.
    """
    folder = file.resolve().parent
    package = _package(folder, file.stem)
    for stale in [key for key in sys.modules if key == package or key.startswith(f"{package}.")]:
        del sys.modules[stale]
    root = ModuleType(package)
    root.__path__ = [str(folder)]
    sys.modules[package] = root
    importlib.invalidate_caches()
    return importlib.import_module(f"{package}.{file.stem}")
