"""A controller as an FMU for co-simulation: its variables are set, stepped and read once a tick.

The scenario names the FMU and the mapping of its variables, both as files that count from the working folder:

    [controller]
    name = "fmu"
    tuning = { fmu = "brake.fmu", mapping = "brake.toml" }
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from vve_sumo import workspace
from vve_sumo.bridges.fmu_mapping import FmuMapping, read_mapping
from vve_sumo.bridges.observed_numbers import FEATURES, ObservationEncoder
from vve_sumo.controller import Controller, Tuning, load, settle
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.timing import PERIOD
from vve_sumo.values import ControlCommand, Observation, Vehicle

EXTRA: Final = "an FMU takes fmpy: pip install 'vve-sumo[fmi]'"
try:
    from vve_sumo.bridges.fmu_instance import Fmu, FmuVariable
except ImportError as missing:
    raise ConfigError(EXTRA) from missing

#: steps of an FMU at one tick at most, where a drive has skipped ticks
MAX_STEPS: Final = 50


def make(vehicle: Vehicle, tuning: Tuning) -> FmuController:
    """Return the FMU that a tuning names, started; raises ConfigError in a line for what is wrong."""
    settled = settle(tuning, {"fmu": "", "mapping": ""})
    for key, value in settled.items():
        if not value:
            raise ConfigError(f"tuning key {key!r}: expected a file, got none")
    file = Path(str(settled["mapping"]))
    mapping = read_mapping(file)
    ports = FmuPorts(Fmu(Path(str(settled["fmu"]))), mapping, file)
    steering = None
    if mapping.outputs.steering_rad is None:
        steering = load(mapping.steered_by, vehicle, {}, workspace.controller_folders(Path.cwd()))
    return FmuController(ports, ObservationEncoder(vehicle), steering)


class FmuPorts:
    """A running FMU behind the names of what its variables mean."""

    def __init__(self, fmu: Fmu, mapping: FmuMapping, file: Path) -> None:
        """Start the FMU; raises ConfigError, naming the mapping's `file` and key, for what does not fit."""
        self._fmu, self._file = fmu, file
        places = {feature.name: place for place, feature in enumerate(FEATURES)}
        wanted = mapping.outputs
        self._inputs = [self._number(f"inputs.{name}", name, "input") for name in mapping.inputs]
        self._places = [places[observed] for observed in mapping.inputs.values()]
        self._acceleration = self._number("outputs.acceleration_mps2", wanted.acceleration_mps2, "output")
        self._steering = self._emergency = None
        if wanted.steering_rad is not None:
            self._steering = self._number("outputs.steering_rad", wanted.steering_rad, "output")
        if wanted.emergency is not None:
            self._emergency = self._truth("outputs.emergency", wanted.emergency, "output")
        parameters = {}
        for name, value in mapping.parameters.items():
            find = self._truth if isinstance(value, bool) else self._number
            parameters[find(f"parameters.{name}", name, "parameter")] = value
        self._instance = fmu.start(parameters)

    def step(self, numbers: list[float], time: float) -> tuple[float, float | None, bool]:
        """Step from a time since the start [s]; return acceleration, steering where the FMU steers, and emergency."""
        instance = self._instance
        if self._inputs:
            instance.set(self._inputs, [numbers[place] for place in self._places])
        instance.step(time, PERIOD)
        steering = None if self._steering is None else float(instance.get(self._steering))
        emergency = self._emergency is not None and bool(instance.get(self._emergency))
        return float(instance.get(self._acceleration)), steering, emergency

    def _number(self, key: str, name: str, causality: str) -> FmuVariable:
        variable = self._variable(key, name, causality)
        if not variable.is_number:
            raise ConfigError(f"{self._file}: {key}: expected a number, {name!r} of the FMU is {variable.type}")
        return variable

    def _truth(self, key: str, name: str, causality: str) -> FmuVariable:
        variable = self._variable(key, name, causality)
        if not variable.is_truth:
            raise ConfigError(f"{self._file}: {key}: expected a truth value, {name!r} of the FMU is {variable.type}")
        return variable

    def _variable(self, key: str, name: str, causality: str) -> FmuVariable:
        variables = self._fmu.variables
        if name in variables and variables[name].causality == causality:
            return variables[name]
        known = [one.name for one in variables.values() if one.causality == causality]
        near = did_you_mean(name, known)
        came = f"{name!r} is its {variables[name].causality}" if name in variables else f"it has no {name!r}"
        wrong = f"{self._file}: {key}: expected an {causality} of {self._fmu.file}, {came}{f', {near}' if near else ''}"
        raise ConfigError(f"{wrong}; {causality}: {', '.join(known) or 'none'}".replace("an parameter", "a parameter"))


class FmuController:
    """Answers every observation with what the FMU's outputs are after its step."""

    def __init__(self, ports: FmuPorts, encoder: ObservationEncoder, steering: Controller | None) -> None:
        """`steering` steers; None where the FMU does."""
        self._ports, self._encoder, self._steering = ports, encoder, steering
        self._last: float | None = None  # time of the tick before [s]
        self._steps = 0

    def step(self, observation: Observation) -> ControlCommand:
        """Return the command of a tick; an FMU whose step fails raises what fmpy says of it.

        Ticks that the drive has skipped are stepped too, with the numbers of this one: the FMU's time is the drive's.
        """
        numbers = self._encoder.numbers(observation)
        passed = 1 if self._last is None else round((observation.time - self._last) / PERIOD)
        self._last = observation.time
        for _ in range(min(max(passed, 1), MAX_STEPS)):
            acceleration, steering, emergency = self._ports.step(numbers, self._steps * PERIOD)
            self._steps += 1
        if steering is None:
            assert self._steering is not None
            steering = self._steering.step(observation).steering
        return ControlCommand(steering, acceleration, emergency=emergency, note="fmu")
