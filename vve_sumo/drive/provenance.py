"""Collects what `provenance.json` says of a drive: code, library versions, host, begin and scenario file.

None of it enters the record's hash: the same scenario, seed and versions give the same record on every machine and with
any driver. Reads the package's own files and runs git; knows no wall clock.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, Final

import pyproj

from vve_sumo import values
from vve_sumo.config_file import read_json
from vve_sumo.drive.plugged_in import digest
from vve_sumo.drive.resolved_scenario import DECISIVE_LIBRARIES, ResolvedScenario, versions
from vve_sumo.record.layout import PROVENANCE

#: the package's own folder, and the folder in it with the shipped workspace, whose files a drive hashes as it uses them
PACKAGE: Final = Path(__file__).parent.parent
SHIPPED: Final = "shipped"
#: endings of the files that decide what the program does: its code, and the car's message layout
CODE_SUFFIXES: Final = (".py", ".dbc", ".toml")
#: time that git has to answer [s]
GIT_TIMEOUT: Final = 2.0


def provenance(resolved: ResolvedScenario, began_utc: str) -> dict[str, Any]:
    """Return a drive's provenance; `began_utc` is the wall-clock time at which the drive began.

    The hash of the scenario's file is None for a scenario that a program made without a file.
    """
    file = resolved.file
    scenario = digest(file) if file.is_file() else None
    return software() | {"host": host(), "began_utc": began_utc, "scenario_file_sha256": scenario}


@cache
def software() -> dict[str, Any]:
    """Return hash and commit of the code, whether it runs compiled, and the versions of Python and the libraries.

    Computed once per process.
    """
    return {
        "code": {"sha256": code_sha256(PACKAGE), "compiled": is_compiled(), **_checkout(PACKAGE)},
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "libraries": libraries(),
        "proj": pyproj.__proj_version__,
    }


@cache
def decisive_versions() -> dict[str, str]:
    """Return the versions of what decides how a drive goes, and the hash of the code, which a version may not tell.

    A checkout keeps its version while somebody works in it. Computed once per process.
    """
    return versions() | {"code": code_sha256(PACKAGE)}


def host() -> dict[str, str]:
    """Return name, kernel, architecture and C library of the machine; C libraries round `sin` differently."""
    try:
        library = os.confstr("CS_GNU_LIBC_VERSION")
    except (OSError, ValueError):
        library = None
    return {
        "name": platform.node(),
        "kernel": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
        "c_library": library or "unknown",
    }


def is_compiled() -> bool:
    """Return whether the modules of every tick are compiled ones."""
    return not values.__file__.endswith(".py")


def code_sha256(package: Path) -> str:
    """Return the hash of a package: relative path and bytes of every file with a code suffix, sorted (hex SHA-256).

    The shipped workspace inside a wheel is left out, so that a wheel and the checkout that it was built from have the
    same hash.
    """
    files = {
        file.relative_to(package).as_posix(): file for ending in CODE_SUFFIXES for file in package.rglob(f"*{ending}")
    }
    whole = hashlib.sha256()
    for name in sorted(name for name in files if not name.startswith(f"{SHIPPED}/")):
        data = files[name].read_bytes()
        whole.update(b"%d:%b%d:%b" % (len(name.encode()), name.encode(), len(data), data))
    return whole.hexdigest()


def _checkout(package: Path) -> dict[str, Any]:
    """Return the commit of the package's checkout, and whether its files differ from it; both None if there is none."""
    none = {"git_commit": None, "git_dirty": None}
    if not (package.parent / ".git").exists():
        return none  # an installed package; a checkout that may enclose it is not its own
    # fsmonitor is off so that git runs no program that the checkout's configuration names; without locks, git writes
    # nothing.
    ask = [
        "git",
        "-c",
        "core.fsmonitor=false",
        "status",
        "--porcelain=v2",
        "--branch",
        "--untracked-files=all",
        "--",
        ".",
    ]
    try:
        output = subprocess.run(
            ask,
            cwd=package,
            env=os.environ | {"GIT_OPTIONAL_LOCKS": "0"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT,
            check=True,
        ).stdout
    except (OSError, ValueError, subprocess.SubprocessError):
        return none
    commit = re.search(r"^# branch\.oid ([0-9a-f]{40,})$", output, re.MULTILINE)
    dirty = any(not line.startswith("#") for line in output.splitlines())
    return {"git_commit": commit[1], "git_dirty": dirty} if commit else none


def libraries() -> dict[str, str]:
    """Return the versions of all libraries that this package declares as required."""
    try:
        declared = requires("vve-sumo") or []
    except PackageNotFoundError:
        declared = []  # run from a checkout that was never installed
    named = (re.match(r"[A-Za-z0-9._-]+", line) for line in declared if "extra ==" not in line)
    known = versions()  # cached: reading a version takes one or two milliseconds
    names = sorted({*DECISIVE_LIBRARIES, *(found[0] for found in named if found)})
    return {name: known[name] if name in known else _version(name) for name in names}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def text_of(provenance: dict[str, Any]) -> str:
    """Return the content of `provenance.json`."""
    return json.dumps(provenance, indent=1, allow_nan=False) + "\n"


def read(folder: Path) -> dict[str, Any]:
    """Return a record's provenance; raises ConfigError where it cannot be read."""
    return read_json(folder / PROVENANCE, "a drive")


def same_code(provenance: dict[str, Any]) -> bool:
    """Return whether a record was driven by the code that is running."""
    code = provenance.get("code")
    return isinstance(code, dict) and code.get("sha256") == software()["code"]["sha256"]


def changed_since(provenance: dict[str, Any]) -> list[str]:
    """Return a line for the code, and for each library, where it differs from a provenance.

    Libraries in `versions()` are left out: `replay.changed_since` compares them with `scenario.json`.
    """
    mine = software()
    lines = [] if same_code(provenance) else ["the code of vve-sumo has changed since"]
    then = provenance.get("libraries")
    parts = then if isinstance(then, dict) else {}
    parts = {**parts, "python": provenance.get("python"), "proj": provenance.get("proj")}
    now = {**mine["libraries"], "python": mine["python"], "proj": mine["proj"]}
    compared_elsewhere = versions()
    return lines + [
        f"{part} was {parts.get(part)}, is {now[part]}"
        for part in sorted(now)
        if parts.get(part) != now[part] and part not in compared_elsewhere
    ]
