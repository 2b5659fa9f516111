"""Reads vehicle files; every error is one line that names the file, the key, what was expected and what was found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from vve_sumo.config_file import complaint, in_si, numbers_of, read
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Mounting
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.effective_deceleration import ROUNDING
from vve_sumo.vehicle.interface import InterfaceConfig, SettingValue
from vve_sumo.vehicle.model import FIX_PERIOD, IDEAL, Imperfections, SimulatedParameters, VehicleModel
from vve_sumo.vehicle.schema import (
    Declared,
    DriveByWire,
    MeasuredImperfections,
    PedalCalibration,
    Simulated,
    VehicleFile,
)

#: ending of the names of an interface's settings that name files
FILE_SETTING: Final = "_file"


def declared(table: Declared) -> Vehicle:
    """Return the vehicle that a table declares; raises ConfigError, without the file's name, if it is impossible."""
    numbers = in_si(table, "sources", "model")
    ratio = numbers["steering_ratio"]
    limits = {name: numbers.pop(f"steering_wheel_{name}") / ratio for name in ("limit", "rate_limit")}
    vehicle = Vehicle(**numbers, steering_limit=limits["limit"], steering_rate_limit=limits["rate_limit"])
    if not vehicle.rear_overhang >= 0.0:
        raise ConfigError("vehicle: length_m is less than wheelbase_m and front_overhang_m together")
    if not vehicle.front_axle_to_mass < vehicle.wheelbase:
        raise ConfigError("vehicle: front_axle_to_mass_m is not less than wheelbase_m")
    return vehicle


def calibrated(table: PedalCalibration, vehicle: Vehicle) -> Calibration:
    """Return the longitudinal calibration of a vehicle; mass and torque limit are the vehicle's."""
    numbers = in_si(table, "sources", "date", "steering_wheel_bias_deg")
    return Calibration(mass=vehicle.mass, brake_torque_limit=vehicle.brake_torque_limit, **numbers)


def simulated(table: Simulated) -> SimulatedParameters:
    """Return the further parameters of the simulated vehicle."""
    return SimulatedParameters(**in_si(table, "sources", "receiver_forward_m", "receiver_left_m"))


def imperfections(table: MeasuredImperfections | None) -> Imperfections:
    """Return the simulated vehicle's imperfections, IDEAL where there is no table.

    Raises ConfigError, without the file's name, if they are impossible.
    """
    if table is None:
        return IDEAL
    measured = Imperfections(combined_slip=table.combined_slip, **in_si(table, "sources", "combined_slip"))
    share, late, latest = measured.receiver_short_gaps, measured.receiver_gap_p95, measured.receiver_gap_max
    if share > 0.0 and not FIX_PERIOD <= measured.receiver_gap_min <= late <= latest:
        raise ConfigError(
            "measured: receiver_short_gaps, receiver_gap_p95_s, receiver_gap_max_s: expected bursts at least "
            f"{FIX_PERIOD:g} s apart with a fix in every {FIX_PERIOD:g} s on average, got {share:g}, {late:g}, "
            f"{latest:g}, whose shortest time between bursts would be {measured.receiver_gap_min:.4f} s"
        )
    if measured.receiver_float_every > 0.0 and not measured.receiver_float_time > 0.0:
        raise ConfigError("measured.receiver_float_time_s: expected more than 0 beside receiver_float_every_s")
    return measured


def interface(table: DriveByWire, folder: Path) -> InterfaceConfig:
    """Return the drive-by-wire interface; its files are looked for in `folder`, else in the present working folder."""
    name, settings = table.interface, located(table.settings, folder)
    file, colon, function = name.rpartition(":")
    if not colon:
        return InterfaceConfig(name, settings)
    beside = folder / file
    return InterfaceConfig(f"{(beside if beside.is_file() else Path(file)).resolve()}:{function}", settings)


def located(settings: Mapping[str, SettingValue], folder: Path) -> dict[str, SettingValue]:
    """Return an interface's settings; what one whose name ends in `_file` names is looked for as in `interface`."""
    return {
        key: str((folder / value if (folder / value).is_file() else Path(value)).resolve())
        if key.endswith(FILE_SETTING) and isinstance(value, str)
        else value
        for key, value in settings.items()
    }


def parse(table: dict[str, Any], file: Path) -> VehicleModel:
    """Return the vehicle that a parsed table holds; `file` is named in the ConfigError of a wrong one."""
    try:
        tables = VehicleFile.model_validate(numbers_of(table, file, VehicleFile))
    except ValidationError as error:
        raise ConfigError(complaint(file, error, VehicleFile)) from None
    try:
        return _resolved(file, tables)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


def _resolved(file: Path, tables: VehicleFile) -> VehicleModel:
    vehicle = declared(tables.vehicle)
    calibration = calibrated(tables.calibration, vehicle)
    most = vehicle.brake_torque_limit / calibration.brake_gain
    if not vehicle.deceleration_limit <= ROUNDING * most:
        raise ConfigError(
            f"vehicle.deceleration_limit_mps2: expected {most:.2f} or less, which brake_torque_limit_nm and "
            f"calibration.brake_gain_kgm give, got {vehicle.deceleration_limit:g}"
        )
    numbers = simulated(tables.simulated)
    if not numbers.laden_mass >= vehicle.mass:
        raise ConfigError(
            f"simulated.laden_mass_kg: expected vehicle.mass_kg, {vehicle.mass:g}, or more, got {numbers.laden_mass:g}"
        )
    mounting = Mounting(tables.simulated.receiver_forward_m, tables.simulated.receiver_left_m)
    name, wire = file.name.removesuffix(".toml"), interface(tables.drive_by_wire, file.parent)
    measured = imperfections(tables.measured)
    return VehicleModel(name, vehicle, calibration, numbers, mounting, interface=wire, measured=measured)


def load(file: Path) -> VehicleModel:
    """Return the vehicle in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "vehicle"), file)
