"""Errors, named by what the person who meets one can do about it."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class VveError(Exception):
    """Base of every error that the package raises on purpose; its text is one line for a person.

    >>> import vve_sumo as vve
    >>> try:
    ...     vve.load("nowhere")
    ... except vve.VveError as error:
    ...     print(error)
    nowhere: not there; expected a drive's record (scenario.json) or a sweep's folder (sweep.json)
    """

    exit_code = 1


class ConfigError(VveError, ValueError):
    """A file, key, option or name is wrong: edit it. Nothing was written or moved.

    >>> import vve_sumo as vve
    >>> try:
    ...     vve.Scenario("parked_car").replace({"ego.sped_mps": 12})
    ... except vve.ConfigError as error:
    ...     print(str(error).rpartition(": ")[2])
    unknown key 'ego.sped_mps', did you mean 'speed_mps'?
    """

    exit_code = 2


class RigError(VveError, RuntimeError):
    """The car, its sensors or its bus are not ready: check the rig.

    >>> import vve_sumo as vve
    >>> vve.RigError.exit_code  # of a command that ends with it
    3
    """

    exit_code = 3


class SimulationError(VveError, RuntimeError):
    """SUMO broke or contradicted itself: report it with the record.

    >>> import vve_sumo as vve
    >>> vve.SimulationError.exit_code  # of a command that ends with it
    4
    """

    exit_code = 4


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is spelt most like one that is not known; empty for none that is near."""
    return next(iter(get_close_matches(name, list(known), 1, 0.65)), "")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `closest` as a question; empty for none that is near."""
    near = closest(name, known)
    return f"did you mean {near!r}?" if near else ""


def hint(name: str, known: Iterable[str]) -> str:
    """Return `did_you_mean`, where a known name is near, and all that are known."""
    there = list(known)
    return "; ".join(filter(None, (did_you_mean(name, there), f"there are {', '.join(there) or 'none'}")))
