"""An FMU for co-simulation, FMI 2.0 or 3.0: its variables, and one instance that is stepped.

The only module of the package that imports fmpy. Knows nothing of controllers.
"""

from __future__ import annotations

import contextlib
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from vve_sumo.errors import ConfigError

VERSIONS: Final = ("2.0", "3.0")
#: types of FMI whose variables hold a number, and those that hold a truth value
NUMBERS: Final = ("Real", "Float64")
TRUTHS: Final = ("Boolean",)

Value = float | bool


class FmuVariable(NamedTuple):
    """A variable of an FMU."""

    name: str
    causality: str  #: input, output, parameter or another of FMI's
    type: str  #: of FMI, such as Real, Float64 or Boolean; of an array with "array" behind it
    reference: int  #: by which the FMU knows it

    @property
    def is_number(self) -> bool:
        """Whether it holds one number."""
        return self.type in NUMBERS

    @property
    def is_truth(self) -> bool:
        """Whether it holds one truth value."""
        return self.type in TRUTHS


class Fmu:
    """An FMU's file, opened: what it holds is unpacked into a folder that ends with this object."""

    def __init__(self, file: Path) -> None:
        """Read an FMU; raises ConfigError in a line for a file that is none, or none for co-simulation."""
        self.file = file
        if not file.is_file():
            raise ConfigError(f"{file}: there is no such file")
        try:
            self._description = fmpy.read_model_description(str(file))
        except Exception as error:  # fmpy has no error of its own: what it stumbles over is what it raises
            raise ConfigError(f"{file}: expected an FMU, it can't be read: {_line(error)}") from None
        version = self._description.fmiVersion
        if version not in VERSIONS:
            raise ConfigError(f"{file}: expected FMI {' or '.join(VERSIONS)}, got {version}")
        if self._description.coSimulation is None:
            raise ConfigError(f"{file}: expected an FMU for co-simulation, got one for model exchange alone")
        self._folder = tempfile.TemporaryDirectory(prefix="vve_sumo_fmu_")
        self.variables = {one.name: _variable(one) for one in self._description.modelVariables}

    def start(self, parameters: Mapping[FmuVariable, Value]) -> FmuInstance:
        """Start the FMU with values of its parameters; raises ConfigError where it does not start."""
        description = self._description
        of_version = FMU2Slave if description.fmiVersion == "2.0" else FMU3Slave
        try:
            fmpy.extract(str(self.file), self._folder.name)
            slave = of_version(
                guid=description.guid,
                unzipDirectory=self._folder.name,
                modelIdentifier=description.coSimulation.modelIdentifier,
                instanceName="vve_sumo",
            )
            slave.instantiate()
            instance = FmuInstance(slave, self)
            for variable, value in parameters.items():
                instance.set([variable], [value])
            if of_version is FMU2Slave:
                slave.setupExperiment(startTime=0.0)
                slave.enterInitializationMode()
            else:
                slave.enterInitializationMode(startTime=0.0)
            slave.exitInitializationMode()
        except Exception as error:
            raise ConfigError(f"{self.file}: the FMU does not start: {_line(error)}") from None
        return instance


class FmuInstance:
    """A running FMU; errors of its own are fmpy's."""

    def __init__(self, slave: Any, fmu: Fmu) -> None:
        self._slave, self._fmu = slave, fmu  # the FMU's folder has to outlive its instance
        weakref.finalize(self, _end, slave)  # while Python still stands: an FMU may be Python itself
        kinds = [kind for kind in (*NUMBERS, *TRUTHS) if hasattr(slave, f"set{kind}")]  # of this version of FMI
        self._set = {kind: getattr(slave, f"set{kind}") for kind in kinds}
        self._get = {kind: getattr(slave, f"get{kind}") for kind in kinds}

    def set(self, variables: Sequence[FmuVariable], values: Sequence[Value]) -> None:
        """Set variables that all have the type of the first."""
        self._set[variables[0].type]([variable.reference for variable in variables], list(values))

    def get(self, variable: FmuVariable) -> Value:
        """Return a variable's value."""
        (value,) = self._get[variable.type]([variable.reference])
        return bool(value) if variable.is_truth else float(value)

    def step(self, time: float, period: float) -> None:
        """Go on by a period from a time since the start [s]."""
        self._slave.doStep(currentCommunicationPoint=time, communicationStepSize=period)


def _end(slave: Any) -> None:
    for step in (slave.terminate, slave.freeInstance):
        with contextlib.suppress(Exception):  # an FMU that failed need not end well
            step()


def _variable(one: Any) -> FmuVariable:
    array = " array" if one.dimensions else ""
    return FmuVariable(one.name, one.causality, f"{one.type}{array}", one.valueReference)


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
