"""Finds networks, scenarios, vehicles, rigs, … by name: the working folder first, then the shipped ones.

A name is a file's stem (`linden`); anything that looks like a path is taken as one.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from vve_sumo.errors import ConfigError, did_you_mean

#: what a name of each kind is looked up as: folder and the endings that it may have
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "network": ("networks", (".net.xml", ".net.xml.gz")),
    "demand": ("routes", (".rou.xml", ".rou.xml.gz")),
    "path": ("routes", (".csv",)),
    "speeds": ("routes", (".csv",)),
    "walk": ("routes", (".csv",)),
    "scenario": ("scenarios", (".toml",)),
    "rig": ("rigs", (".toml",)),
    "sweep": ("sweeps", (".toml",)),
    "vehicle": ("vehicles", (".toml",)),
}

#: folders that `vve-sumo init` lays out
WORKSPACE_FOLDERS = (
    "controllers",
    "examples",
    "networks",
    "notebooks",
    "rigs",
    "routes",
    "scenarios",
    "sweeps",
    "vehicles",
)
#: suites that any receiver, sensor, drive-by-wire interface and file of metrics must pass, with what they import, and
#: examples of each
CONFORMANCE_SUITES = (
    "tests/__init__.py",
    "tests/metrics/__init__.py",
    "tests/metrics/tables.py",
    "tests/ports/__init__.py",
    "tests/ports/interface_bench.py",
    "tests/ports/metric.py",
    "tests/ports/receiver.py",
    "tests/ports/sensor.py",
    "tests/ports/toy",
    "tests/ports/vehicle_interface.py",
    "tests/sensors/__init__.py",
    "tests/sensors/scenes.py",
    "tests/setpoints.py",
    "tests/vehicle/__init__.py",
    "tests/vehicle/whole_car.py",
    "tests/vehicles.py",
)
#: of them, the one that may be had by itself
NOTEBOOKS = "notebooks"


def shipped_root() -> Path:
    """Folder that holds the shipped workspace: inside the installed package, or the checkout it runs from."""
    package = Path(__file__).parent
    inside = package / "shipped"
    return inside if inside.is_dir() else package.parent


def documentation() -> Path:
    """Folder of the documentation's pages, such as `rigs.md`."""
    return shipped_root() / "docs"


def roots(working: Path) -> tuple[Path, ...]:
    """Where names are looked up, in order."""
    return (working, shipped_root())


def _stem(file: Path, endings: tuple[str, ...]) -> str | None:
    return next((file.name.removesuffix(e) for e in endings if file.name.endswith(e)), None)


def known(kind: str, working: Path) -> dict[str, Path]:
    """Every name of a kind with its file; the working folder's win over shipped ones of the same name."""
    folder, endings = KINDS[kind]
    found: dict[str, Path] = {}
    for root in reversed(roots(working)):
        for file in sorted((root / folder).glob("*")):
            stem = _stem(file, endings)
            if stem is not None and file.is_file():
                found[stem] = file
    return dict(sorted(found.items()))


def find(kind: str, name: str, working: Path, *, beside: Path | None = None) -> Path:
    """Return the file that `name` means; a relative path counts from `beside` (a scenario's folder) or `working`.

    Raises ConfigError naming the kind, what was asked for and what there is.
    """
    _folder, endings = KINDS[kind]
    if "/" in name or "\\" in name or name.endswith(endings):
        for base in (beside, working):
            if base is not None and (base / name).is_file():
                return base / name
        raise ConfigError(f"{kind} file {name!r} does not exist (looked from {beside or working})")
    found = known(kind, working)
    if name not in found:
        near = did_you_mean(name, found)
        unknown = f"no {kind} named {name!r}{f', {near}' if near else ''}"
        raise ConfigError(f"{unknown}; known: {', '.join(found) or 'none'}")
    return found[name]


def shared_file(folder: str, name: str, working: Path) -> Path:
    """Return a file of the workspace that is no kind of its own; raises ConfigError where there is none."""
    for root in roots(working):
        if (root / folder / name).is_file():
            return root / folder / name
    raise ConfigError(f"{folder}/{name} is neither in {working} nor shipped")


def controller_folders(working: Path) -> tuple[Path, ...]:
    """Folders in which a controller's name is looked up, in order."""
    return tuple(root / "controllers" for root in roots(working) if (root / "controllers").is_dir())


def lay_out(target: Path) -> list[Path]:
    """Copy the shipped workspace folders and the conformance suites into `target` and return the files written.

    Raises ConfigError, before anything is written, when a file of the same name stands there already.
    """
    return _copied(
        shipped_root(), [file for one in (*WORKSPACE_FOLDERS, *CONFORMANCE_SUITES) for file in _shipped(one)], target
    )


def lay_out_notebooks(target: Path) -> list[Path]:
    """Copy the shipped notebooks right into `target` and return the files written; raises as `lay_out` does."""
    return _copied(shipped_root() / NOTEBOOKS, _shipped(NOTEBOOKS), target)


def _shipped(name: str) -> list[Path]:
    """A shipped file, or those of a folder; notebooks themselves alone, not what they have made where they were run."""
    inside = shipped_root() / name
    if inside.is_file():
        return [inside]
    files = inside.glob("*.ipynb") if name == NOTEBOOKS else inside.rglob("*")
    return [file for file in sorted(files) if _belongs(file)]


def _copied(root: Path, sources: list[Path], target: Path) -> list[Path]:
    """Copy files from under `root` to the same places under `target`, all or none of them."""
    if target.exists() and not target.is_dir():
        raise ConfigError(f"{target} is a file, expected a folder to lay files out in")
    copies = [target / file.relative_to(root) for file in sources]
    taken = next((copy for copy in copies if copy.exists()), None)
    if taken is not None:
        raise ConfigError(f"{taken} is there already; choose an empty folder")
    for file, copy in zip(sources, copies, strict=True):
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    return copies


def _belongs(file: Path) -> bool:
    return file.is_file() and "__pycache__" not in file.parts and not file.name.startswith(".")
