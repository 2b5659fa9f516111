"""Starts, steps and closes the one SUMO simulation of this process, with the options that an external car needs.

Must not know the ego, its synchronisation or any obstacle; the rest of the room talks to `libsumo` through this module.
"""

from __future__ import annotations

import gzip
import math
import os
import tempfile
import xml.parsers.expat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import libsumo

from vve_sumo.errors import ConfigError, SimulationError

#: The release whose moveToXY, ghost and stop behaviour the tests of this room pin down.
SUMO_VERSION = "1.28.0"

#: FatalTraCIError is not a TraCIException, so both have to be named.
SUMO_ERRORS = (libsumo.TraCIException, libsumo.FatalTraCIError)

NETWORK_ROOTS = ("net",)
DEMAND_ROOTS = ("routes", "additional")

#: Warnings of one kind that are kept in full; a car pushed into traffic can cause thousands.
WARNINGS_KEPT = 20

OPTIONS = (
    # Own rectangle tests decide about contact; these make SUMO's own opinion mean physical contact too.
    ("--collision.action", "warn"),
    ("--collision.mingap-factor", "0"),
    ("--collision.check-junctions", "true"),
    # Nobody is lifted out of a jam that a standing ego causes.
    ("--time-to-teleport", "-1"),
    # Without it a car that changes lanes is on the other one a step later: no radar ever saw a car jump sideways.
    ("--lanechange.duration", "3"),
    # All demand is read at start, so that a bad route is found before the car moves.
    ("--route-steps", "0"),
    # SUMO wants it as soon as a type acts less often than every step, and would warn and set it by itself.
    ("--step-method.ballistic", "true"),
    ("--no-step-log", "true"),
    ("--duration-log.disable", "true"),
    ("--aggregate-warnings", str(WARNINGS_KEPT)),
)


def check_version(installed: str = libsumo.__version__) -> None:
    """Raise ConfigError unless this is the SUMO release that the room was tested against."""
    if installed != SUMO_VERSION:
        raise ConfigError(f"libsumo: version {SUMO_VERSION} is required, {installed} is installed")


def check_input(file: Path, roots: Sequence[str]) -> str:
    """Return the name of an XML file's root element, having read it to the end.

    libsumo dies of a segmentation fault on a network that is not well-formed, so it never sees one.
    Raises ConfigError where the file is missing, not XML, or of another kind than one of `roots`.
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
    except xml.parsers.expat.ExpatError as error:
        raise ConfigError(f"{file}: not well-formed XML ({error})") from error
    if seen[0] not in roots:
        raise ConfigError(f"{file}: root element <{'> or <'.join(roots)}> expected, found <{seen[0]}>")
    return seen[0]


class Simulation:
    """The SUMO simulation; one at a time in a process.

    What SUMO writes to stderr is caught: causes of errors become their text, warnings are kept in `warnings`.
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
        self._console = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - lives as long as the simulation
        try:
            with self._caught():
                libsumo.start(arguments)
        except SUMO_ERRORS as error:
            cause = self._cause(error)
            self._console.close()
            names = ", ".join(str(file) for file in (network, *demand))
            raise ConfigError(f"{names}: SUMO does not start: {cause}") from error

    def step(self) -> None:
        """Advance by one period; raises SimulationError with SUMO's reason."""
        try:
            with self._caught():
                libsumo.simulationStep()
        except SUMO_ERRORS as error:
            raise SimulationError(f"SUMO's step failed: {self._cause(error)}") from error

    def run_until(self, time: float) -> None:
        """Advance to a SUMO time [s] in one go; raises SimulationError with SUMO's reason."""
        try:
            with self._caught():
                libsumo.simulationStep(time)
        except SUMO_ERRORS as error:
            raise SimulationError(f"SUMO's warm-up failed: {self._cause(error)}") from error

    @property
    def warnings(self) -> tuple[str, ...]:
        """What SUMO complained about so far, a line each."""
        return tuple(line for line in self._written().splitlines() if line.strip())

    def close(self) -> None:
        """End the simulation.

        One more step first: a process whose last moveToXY was not followed by a step dies at its next start.
        """
        if self._console.closed:
            return
        with self._caught():
            for action in (libsumo.simulationStep, libsumo.close):
                try:
                    action()
                except SUMO_ERRORS:
                    continue
        self._console.close()

    @contextmanager
    def _caught(self) -> Iterator[None]:
        # SUMO writes to file descriptor 2 itself. No Python thread can write there meanwhile: libsumo holds
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
