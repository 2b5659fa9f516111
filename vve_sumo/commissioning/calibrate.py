"""Calibrates a car from the records of one or several drives: reads the folders, runs the fits, writes the numbers.

Any records will do, in lockstep or live, if the car was driven with enough variety. This module handles files and
texts; the fits are those of `vehicle.identification`.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo import bus
from vve_sumo.config_file import read_json
from vve_sumo.drive.resolved_scenario import recorded_model
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Mounting
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.pose.ncom import Decoder
from vve_sumo.record.reader import read_pose_chunks
from vve_sumo.rig import edit
from vve_sumo.rig import load as rigs
from vve_sumo.rig.resolve import model_of, receiver_of
from vve_sumo.values import Fix, Floats
from vve_sumo.vehicle.identification import Estimate, Identified, Log, Series, identify, joined
from vve_sumo.vehicle.interface import (
    BrakeState,
    Commanded,
    Gear,
    GearState,
    InterfaceConfig,
    Malformed,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    load,
)
from vve_sumo.vehicle.model import VehicleModel

PICTURE = "calibration.png"
#: time for the car to settle after it was engaged and in drive [s]
SETTLING = 0.5
#: what no drive of this kind can tell, printed with every table
NOTE: Final = (
    "Forces are for the declared mass, the steering ratio for the declared wheelbase: neither shows by itself. "
    "Rolling resistance holds engine braking and whatever slope the receiver does not report."
)
SUBSYSTEMS: Final = (BrakeState, ThrottleState, SteeringState)


#: attributes of the model that must be the same in the rig file and in the drive: else it is another car
SAME: Final = ("vehicle.mass", "vehicle.wheelbase", "mounting.forward", "mounting.left", "interface")


def declared_in(resolved: dict[str, Any]) -> VehicleModel:
    """Return the vehicle that a drive was made with; raises ConfigError for a receiver that does not send NCOM."""
    if "rig" in resolved:
        rig = rigs.parse_json(resolved["rig"], Path(str(resolved.get("rig_name", "rig"))))
        if not isinstance(receiver_of(rig).decoder(), Decoder):
            raise ConfigError(f"calibration takes a receiver that speaks NCOM, got pose.kind {rig.pose.kind!r}")
    return recorded_model(resolved)


class Quantity(NamedTuple):
    """One number of a car: its words, its unit, where it is declared and its key in a rig file."""

    words: str
    unit: str
    attribute: str = ""  #: of the model, that declares it; empty for none
    key: str = ""  #: of the rig file, with its table; empty for a number that is only shown
    factor: float = 1.0  #: from SI to the unit
    optional: bool = False  #: may stay as declared where a drive does not determine it

    def declared(self, model: VehicleModel) -> float:
        """Return what a model declares, in SI; NaN where it declares nothing."""
        return float(attrgetter(self.attribute)(model)) if self.attribute else math.nan

    @property
    def place(self) -> tuple[str, str]:
        """Table and key of the rig file."""
        table, _, key = self.key.partition(".")
        return table, key


_DEGREES: Final = math.degrees(1.0)

#: every identified number, in the order of the table
QUANTITIES: Final[dict[str, Quantity]] = {
    "brake_gain": Quantity("brake torque for 1 m/s²", "kg m", "calibration.brake_gain", "calibration.brake_gain_kgm"),
    "brake_delay": Quantity("brakes: dead time", "s", "vehicle.brake_delay", "vehicle.brake_delay_s"),
    "brake_lag": Quantity("brakes: lag", "s", "vehicle.brake_lag", "vehicle.brake_lag_s"),
    "drive_force_limit": Quantity(
        "force at full throttle", "N", "calibration.drive_force_limit", "calibration.drive_force_limit_n"
    ),
    "drive_delay": Quantity("throttle: dead time", "s"),
    "drive_lag": Quantity("throttle: lag", "s", "calibration.drive_lag", "calibration.drive_lag_s"),
    "creep_force": Quantity("creep at rest", "N", "calibration.creep_force", "calibration.creep_force_n"),
    "creep_speed": Quantity("creep ends at", "m/s", "calibration.creep_speed", "calibration.creep_speed_mps"),
    "rolling_resistance": Quantity(
        "rolling resistance", "", "calibration.rolling_resistance", "calibration.rolling_resistance"
    ),
    "drag_area": Quantity("air drag area", "m²", "calibration.drag_area", "calibration.drag_area_m2", optional=True),
    "steering_ratio": Quantity("steering ratio", "", "vehicle.steering_ratio", "vehicle.steering_ratio"),
    "steering_wheel_bias": Quantity(
        "steering wheel, straight on", "°", "steering_wheel_bias", "calibration.steering_wheel_bias_deg", _DEGREES
    ),
    "steering_delay": Quantity("steering: dead time", "s", "vehicle.steering_delay", "vehicle.steering_delay_s"),
    "steering_lag": Quantity("steering: lag", "s", "vehicle.steering_lag", "vehicle.steering_lag_s"),
    "wheel_radius": Quantity("rolling radius", "m", "vehicle.wheel_radius", "vehicle.wheel_radius_m"),
    "heading_misalignment": Quantity(
        "receiver's heading, clockwise", "°", "mounting.heading_misalignment", "mounting.heading_misalignment_deg",
        -_DEGREES,
    ),
    "acceleration_bias": Quantity("receiver's acceleration", "m/s²"),
}  # fmt: skip

#: Share by which a measured rolling radius may still be off: the tyres' pressure, load and temperature on another day.
EARNED_TOLERANCE: Final = 0.01


@dataclass(frozen=True, slots=True)
class Calibrated:
    """Result of a calibration: the numbers that drives gave of their car."""

    folders: tuple[Path, ...]
    declared: VehicleModel
    identified: Identified

    @property
    def poor(self) -> dict[str, Estimate]:
        """Numbers that a rig needs and this drive did not determine well enough, by name."""
        return {
            name: self.identified.estimates[name]
            for name, quantity in QUANTITIES.items()
            if quantity.key and not quantity.optional and not self.identified.estimates[name].good
        }


def calibrate(folders: Sequence[Path]) -> Calibrated:
    """Return the car's numbers by the drives recorded in the folders, all together.

    Raises ConfigError for a folder that is no such record, and for drives that were not of one car, declared alike.
    """
    drives = [_resolved(folder) for folder in folders]
    models = [declared_in(resolved) for resolved in drives]
    for folder, model in zip(folders, models, strict=True):
        if model != models[0]:
            raise ConfigError(f"{folder}: its car is declared otherwise than in {folders[0]}, expected one car")
    log = joined([read(folder, resolved, models[0]) for folder, resolved in zip(folders, drives, strict=True)])
    return Calibrated(tuple(folders), models[0], identify(log, models[0].vehicle, models[0].calibration))


def _resolved(folder: Path) -> dict[str, Any]:
    file = folder / "scenario.json"
    resolved = read_json(file, "a drive", "epoch_gnss_s")
    if not isinstance(resolved["epoch_gnss_s"], float):
        raise ConfigError(f"{file}: epoch_gnss_s: expected a number, got {resolved['epoch_gnss_s']!r}")
    return resolved


def read(folder: Path, resolved: dict[str, Any], declared: VehicleModel) -> Log:
    """Read a record's commands, reports and fixes onto the drive's clock; raises ConfigError naming what is missing.

    Also for a car that is commanded an acceleration: what its pedals did is not in the record.
    """
    facts = load(declared.interface).facts
    if facts.acceleration_limits is not None:
        raise ConfigError(
            f"{folder}: {facts.title} is commanded an acceleration: what its pedals do is not in a drive of it, "
            "expected a car that is commanded pedals"
        )
    messages_by_kind = _messages(folder / "can.log", float(resolved["epoch_gnss_s"]), declared.interface)
    obedient = (_obedient(folder, messages_by_kind),)
    fixes = _fixes(folder / "pose.bin")

    def series(kind: type, value: Callable[[Any], float]) -> Series:
        if kind not in messages_by_kind:
            raise ConfigError(f"{folder / 'can.log'}: no {kind.__name__} in it, expected a drive of the car")
        return _series([(time, value(message)) for time, message in messages_by_kind[kind]])

    return Log(
        brake_torque=series(Commanded, attrgetter("brake_torque")),
        throttle=series(Commanded, attrgetter("throttle")),
        wheel_command=series(Commanded, attrgetter("wheel_angle")),
        wheel_angle=series(SteeringState, attrgetter("wheel_angle")),
        wheels=series(WheelSpeeds, lambda wheels: 0.5 * (wheels.rear_left + wheels.rear_right)),
        **_motion(folder, fixes, declared.mounting),
        obedient=obedient,
    )


def _messages(file: Path, epoch: float, config: InterfaceConfig) -> dict[type, list[tuple[float, Any]]]:
    """All decoded messages of the bus, reports and commands, by kind, with drive times [s]."""
    interface = load(config)
    messages_by_kind: dict[type, list[tuple[float, Any]]] = {}
    for time, _channel, frame in bus.read_log(file):
        reports, command = interface.decode(frame), interface.commanded(frame)
        messages = [*(() if isinstance(reports, Malformed) else reports), *(() if command is None else (command,))]
        for message in messages:
            messages_by_kind.setdefault(type(message), []).append((time - epoch, message))
    return messages_by_kind


def _fixes(file: Path) -> list[Fix]:
    decoder, fixes = Decoder(), []
    for time, data in read_pose_chunks(file):
        fixes += decoder.feed(data, time)
    return fixes


def _obedient(folder: Path, messages_by_kind: dict[type, list[tuple[float, Any]]]) -> tuple[float, float]:
    """When the car follows commands [s]: from all modules enabled in drive until one of these conditions is lost."""
    news: list[tuple[float, type, bool]] = [
        (time, kind, message.enabled) for kind in SUBSYSTEMS for time, message in messages_by_kind.get(kind, ())
    ]
    news += [(time, GearState, gear.gear is Gear.DRIVE) for time, gear in messages_by_kind.get(GearState, ())]
    state: dict[type, bool] = dict.fromkeys((*SUBSYSTEMS, GearState), False)
    begin = time = math.nan
    for time, kind, good in sorted(news, key=lambda one: one[0]):
        state[kind] = good
        if math.isnan(begin) and all(state.values()):
            begin = time
        elif not (math.isnan(begin) or all(state.values())):
            break
    if math.isnan(begin):
        raise ConfigError(f"{folder}: the car was never engaged and in drive: nothing to calibrate it from")
    return begin + SETTLING, time


def _series(samples: Sequence[tuple[float, float]]) -> Series:
    """Samples in order of time, without those that are not numbers."""
    table = np.array(samples, dtype=np.float64).reshape(-1, 2)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Series(table[:, 0], table[:, 1])


def _motion(folder: Path, fixes: Sequence[Fix], mounting: Mounting) -> dict[str, Series]:
    """Motion of the rear axle by the receiver: that of its output point, moved there; formulas as in `frames`.

    The receiver's clock is mapped to the drive's by the fix that arrived soonest. The delay of that fix remains as an
    error; the fits that depend on it identify it too.
    """
    columns = (
        "time_received",
        "time",
        "heading",
        "velocity_east",
        "velocity_north",
        "yaw_rate",
        "acceleration",
        "pitch",
    )
    table: Floats = np.array([[getattr(fix, name) for name in columns] for fix in fixes], dtype=np.float64)
    table = table.reshape(-1, len(columns))
    table[:, -1] = np.nan_to_num(table[:, -1])  # without a pitch the receiver is assumed to be level
    table = table[np.isfinite(table).all(axis=1)]
    if not len(table):
        raise ConfigError(f"{folder / 'pose.bin'}: no fix with heading, velocity, yaw rate and acceleration in it")
    received, epoch, heading, east, north, yaw_rate, acceleration, pitch = table.T
    time = epoch + (received - epoch).min()
    cosine, sine = np.cos(heading), np.sin(heading)
    forward, left = cosine * east + sine * north, cosine * north - sine * east
    speed, lateral = forward + yaw_rate * mounting.left, left - yaw_rate * mounting.forward
    felt = acceleration + yaw_rate * left - GRAVITY * np.sin(pitch)
    values = {
        "speed": speed,
        "slip": np.arctan2(lateral, speed),
        "yaw_rate": yaw_rate,
        "acceleration": felt,
        "grade": pitch,
    }
    return {name: Series(time, value) for name, value in values.items()}


class CalibrationRow(NamedTuple):
    """A line of the table, in the quantity's own unit."""

    words: str
    declared: str
    identified: str
    uncertainty: str
    verdict: str


def rows(calibrated: Calibrated) -> list[CalibrationRow]:
    """The table of all identified numbers."""
    return [
        _row(quantity, quantity.declared(calibrated.declared), calibrated.identified.estimates[name])
        for name, quantity in QUANTITIES.items()
    ]


def _row(quantity: Quantity, declared: float, estimate: Estimate) -> CalibrationRow:
    sigma = abs(quantity.factor) * estimate.sigma
    # As many decimals as show the uncertainty's first two digits, within reason.
    decimals = min(max(1 - math.floor(math.log10(sigma)), 0), 5) if 0.0 < sigma < math.inf else 3

    def in_digits(value: float) -> str:
        return "" if math.isnan(value) else f"{quantity.factor * value:z.{decimals}f} {quantity.unit}".strip()

    verdict = "good" if estimate.good else f"poor: {estimate.problem}"
    if quantity.optional and not estimate.good:
        verdict = f"left as declared: {estimate.problem}"
    return CalibrationRow(quantity.words, in_digits(declared), in_digits(estimate.value), f"{sigma:.2g}", verdict)


def _values(calibrated: Calibrated, leave: Sequence[str]) -> dict[tuple[str, str], float]:
    """Values for a rig file, by table and key; raises ConfigError naming a poor one that is not in `leave`."""
    unknown = [name for name in leave if name not in QUANTITIES]
    if unknown:
        raise ConfigError(f"no such quantity: {unknown[0]!r}; known are {', '.join(QUANTITIES)}")
    for name, estimate in calibrated.poor.items():
        if name not in leave:
            raise ConfigError(
                f"{calibrated.folders[0]}: {name} is poor ({estimate.problem}): drive again, or leave it as it is"
            )
    found = calibrated.identified.estimates
    values = {
        quantity.place: float(f"{quantity.factor * found[name].value:.6g}")
        for name, quantity in QUANTITIES.items()
        if quantity.key and name not in leave and found[name].good
    }
    radius = found["wheel_radius"]
    if QUANTITIES["wheel_radius"].place in values:
        values["calibration", "wheel_speed_tolerance"] = max(
            EARNED_TOLERANCE, round(5.0 * radius.sigma / radius.value, 4)
        )
    return values


def put_into(rig: Path, calibrated: Calibrated, date: str, leave: Sequence[str] = ()) -> None:
    """Write the identified numbers into a rig file, dated `date` (YYYY-MM-DD); comments and all else stay.

    Quantities in `leave` stay as they are in the file. Raises ConfigError, the file untouched, for a poor number that
    is not in `leave`, for a rig of another car than the drive's, and for a result that would not load.
    """
    _same_car(rig, calibrated.declared, model_of(rigs.load(rig)))
    edit.put(rig, _dated(_values(calibrated, leave), date))


def _same_car(rig: Path, driven: VehicleModel, written: VehicleModel) -> None:
    for name in SAME:
        then, now = attrgetter(name)(driven), attrgetter(name)(written)
        if then != now:
            raise ConfigError(f"rig {rig}: {name} is {now} there, but {then} in the drive: not the rig that drove")


def _dated(values: dict[tuple[str, str], float], date: str) -> dict[tuple[str, str], Any]:
    """Return the values for a rig file, with the date in all tables that keep one."""
    try:
        day = datetime.date.fromisoformat(date)
    except ValueError:
        raise ConfigError(f"date of the calibration: expected YYYY-MM-DD, got {date!r}") from None
    dated: dict[tuple[str, str], Any] = {**values, ("calibration", "date"): day}
    if any(table == "mounting" for table, _key in values):
        dated["mounting", "calibrated"] = day
    return dated


def draw(calibrated: Calibrated) -> Path:
    """Write `calibration.png` into the first record and return its place."""
    from vve_sumo.plotting.calibration import draw as paint

    poor = list(calibrated.poor)
    subtitle = f"poor: {', '.join(poor)}" if poor else "every number that a rig needs is good"
    file = calibrated.folders[0] / PICTURE
    names = ", ".join(folder.name for folder in calibrated.folders)
    paint(calibrated.identified.curves, f"Calibration from {names}", subtitle, file)
    return file
