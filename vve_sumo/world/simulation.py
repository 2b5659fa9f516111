"""Starts, steps and closes the one SUMO simulation of this process, with the options that an external car needs.

Must not know the ego, its synchronisation or any obstacle.
"""

from __future__ import annotations

import gzip
import math
import os
import tempfile
import xml.parsers.expat
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import libsumo

from vve_sumo.errors import ConfigError, SimulationError

#: The release whose behaviour of moveToXY, proxies and stops the tests of this package check.
SUMO_VERSION = "1.28.0"

#: libsumo's errors; FatalTraCIError is not a TraCIException, so both are listed.
SUMO_ERRORS = (libsumo.TraCIException, libsumo.FatalTraCIError)

NETWORK_ROOTS = ("net",)
DEMAND_ROOTS = ("routes", "additional")

#: Number of warnings of one kind that are kept in full; a car placed in traffic can cause thousands.
WARNINGS_KEPT = 20

OPTIONS = (
    # Contact is decided by our own test of rectangles; with these SUMO's collision warnings mean physical contact too.
    # SUMO looks for it along lanes only: inside junctions it would compare every body, which took half of a step.
    ("--collision.action", "warn"),
    ("--collision.mingap-factor", "0"),
    ("--collision.check-junctions", "false"),
    # No vehicle is teleported out of a jam that a standing ego causes.
    ("--time-to-teleport", "-1"),
    # A lane change takes time; by default SUMO's cars jump to the other lane in one step.
    ("--lanechange.duration", "3"),
    # All demand is read at start, so that a bad route is found before the car moves.
    ("--route-steps", "0"),
    # SUMO needs this if a vehicle type acts less often than every step, and would otherwise warn and set it itself.
    ("--step-method.ballistic", "true"),
    ("--no-step-log", "true"),
    ("--duration-log.disable", "true"),
    ("--aggregate-warnings", str(WARNINGS_KEPT)),
)


def check_version(installed: str = libsumo.__version__) -> None:
    """Raise ConfigError unless this is the SUMO release against which this package was tested."""
    if installed != SUMO_VERSION:
        raise ConfigError(f"libsumo: version {SUMO_VERSION} is required, {installed} is installed")


def check_input(file: Path, roots: Sequence[str]) -> str:
    """Read an XML file to its end and return the name of its root element.

    A network that is not well-formed makes libsumo crash with a segmentation fault; this check prevents it.
    Raises ConfigError where the file is missing, not XML, or its root element is not one of `roots`.
    """
    parser = xml.parsers.expat.ParserCreate()
    seen: list[str] = []

    def first(name: str, _: dict[str, str]) -> None:
        seen.append(name)
        parser.StartElementHandler = None

    parser.StartElementHandler = first
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            parser.ParseFile(stream)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read ({error.strerror or error})") from error
    except (EOFError, zlib.error) as error:  # a file that was cut short, or damaged
        raise ConfigError(f"{file}: cannot be read ({error})") from error
    except xml.parsers.expat.ExpatError as error:
        raise ConfigError(f"{file}: not well-formed XML ({error})") from error
    if seen[0] not in roots:
        raise ConfigError(f"{file}: root element <{'> or <'.join(roots)}> expected, found <{seen[0]}>")
    return seen[0]


def _console() -> IO[bytes]:
    return tempfile.TemporaryFile(buffering=0)


class Simulation:
    """The SUMO simulation; one at a time in a process.

    SUMO's output on stderr is captured: it gives the text of errors, and `warnings`.
    """

    def __init__(self, network: Path, demand: Sequence[Path], seed: int, period: float) -> None:
        """Start SUMO.

        Raises ConfigError where a file, the seed or the period [s] is not usable, SimulationError where this
        process already runs a simulation.
        """
        check_version()
        if libsumo.isLoaded():
            raise SimulationError("SUMO already runs in this process, and it can run only once in each")
        if not 0.0 < period < math.inf or abs(math.remainder(period * 1000.0, 1.0)) > 1e-9:
            raise ConfigError(f"period: a positive whole number of milliseconds expected, got {period} s")
        check_input(network, NETWORK_ROOTS)
        kinds = {file: check_input(file, DEMAND_ROOTS) for file in demand}
        arguments = ["sumo", "--net-file", str(network), "--seed", str(seed), "--step-length", f"{period:.3f}"]
        for option, root in (("--route-files", "routes"), ("--additional-files", "additional")):
            files = [str(file) for file, kind in kinds.items() if kind == root]
            arguments += [option, ",".join(files)] if files else []
        arguments += [word for option in OPTIONS for word in option]
        self.may_write = "additional" in kinds.values()  #: to files, which SUMO opens when it starts
        self._console = _console()
        self._inherited = False  #: whether another process started SUMO, of which this one is a fork
        try:
            with self._caught():
                libsumo.start(arguments)
        except SUMO_ERRORS as error:
            cause = self._cause(error)
            self._console.close()
            names = ", ".join(str(file) for file in (network, *demand))
            raise ConfigError(f"{names}: SUMO does not start: {cause}") from error

    def inherit(self) -> None:
        """Go on in a fork of the process that started SUMO, with what SUMO has said so far; SUMO ends with the fork."""
        console = _console()
        console.write(self._written().encode())
        self._console, self._inherited = console, True

    def step(self) -> None:
        """Advance by one period; raises SimulationError with SUMO's reason."""
        # As `_caught` does it, without the cost of a context manager at every tick.
        kept = os.dup(2)
        os.dup2(self._console.fileno(), 2)
        try:
            libsumo.simulationStep()
        except SUMO_ERRORS as error:
            raise SimulationError(f"SUMO's step failed: {self._cause(error)}") from error
        finally:
            os.dup2(kept, 2)
            os.close(kept)

    def run_until(self, time: float) -> None:
        """Advance to a SUMO time [s] in one call; raises SimulationError with SUMO's reason."""
        try:
            with self._caught():
                libsumo.simulationStep(time)
        except SUMO_ERRORS as error:
            raise SimulationError(f"SUMO's warm-up failed: {self._cause(error)}") from error

    @property
    def warnings(self) -> tuple[str, ...]:
        """SUMO's warnings so far, one line each."""
        return tuple(line for line in self._written().splitlines() if line.strip())

    def close(self) -> None:
        """End the simulation.

        One more step is made first: if no step followed the last moveToXY, libsumo crashes at its next start.
        """
        if self._console.closed:
            return
        if not self._inherited:
            with self._caught():
                for action in (libsumo.simulationStep, libsumo.close):
                    with suppress(*SUMO_ERRORS):
                        action()
        self._console.close()

    @contextmanager
    def _caught(self) -> Iterator[None]:
        # SUMO writes directly to file descriptor 2. No Python thread can write there meanwhile, because libsumo holds
        # the interpreter lock during a step.
        kept = os.dup(2)
        os.dup2(self._console.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)

    def _written(self) -> str:
        size = os.fstat(self._console.fileno()).st_size
        return os.pread(self._console.fileno(), size, 0).decode(errors="replace")

    def _cause(self, error: Exception) -> str:
        text = str(error)
        if text == "Process Error" or text.startswith("Could not parse"):
            text = self._written() or text
        return " ".join(text.removeprefix("Error: ").split())
