"""Converts a rig to vehicle, limits, mounting, lot and geofence, in SI units and counter-clockwise radians.

Functions raise ConfigError, without the file's name, for impossible values; none of them opens a bus or device.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from vve_sumo.config_file import in_si
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame, Mounting, local_frame
from vve_sumo.lot.geofence import Geofence, StopModel
from vve_sumo.lot.polygon import Lot, distance_between
from vve_sumo.lot.turning import Turning
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.rig.schema import Rig
from vve_sumo.timing import NOTICED, SETPOINT_LIFETIME
from vve_sumo.values import Vehicle
from vve_sumo.vehicle import load as vehicles
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.drift import unseen_drift
from vve_sumo.vehicle.effective_deceleration import DRY_FRICTION, EffectiveDeceleration, effective_deceleration
from vve_sumo.vehicle.interface import InterfaceConfig, InterfaceFacts, load
from vve_sumo.vehicle.limits import Limits
from vve_sumo.vehicle.model import VehicleModel

if TYPE_CHECKING:
    from vve_sumo.plant.injected_faults import InjectedFault


def model_of(rig: Rig) -> VehicleModel:
    """Return the car as the rig declares and calibrates it."""
    return VehicleModel(
        name=Path(rig.vehicle.model).name.removesuffix(".toml"),
        vehicle=vehicle_of(rig),
        calibration=calibration_of(rig),
        simulated=vehicles.simulated(rig.simulated),
        mounting=mounting_of(rig),
        limits=limits_of(rig),
        interface=interface_of(rig),
        measured=vehicles.imperfections(rig.measured),
        steering_wheel_bias=steering_wheel_bias_of(rig),
        rig=rig.title,
    )


def vehicle_of(rig: Rig) -> Vehicle:
    """Return the car as declared."""
    return vehicles.declared(rig.vehicle)


def calibration_of(rig: Rig) -> Calibration:
    """Return the car's longitudinal calibration; mass and torque limit are the vehicle's."""
    return vehicles.calibrated(rig.calibration, vehicle_of(rig))


def steering_wheel_bias_of(rig: Rig) -> float:
    """Return the steering-wheel angle at which the wheels point straight [rad], left positive."""
    return math.radians(rig.calibration.steering_wheel_bias_deg)


def limits_of(rig: Rig) -> Limits:
    """Return the limits that the gateway enforces."""
    stated, usual = in_si(rig.limits), Limits()

    def changed(prefix: str) -> dict[str, float]:
        return {key.removeprefix(prefix): value for key, value in stated.items() if key.startswith(prefix)}

    rest = {key: value for key, value in stated.items() if not key.startswith(("comfort_", "emergency_"))}
    comfort, emergency = (
        replace(usual.comfort, **changed("comfort_")),
        replace(usual.emergency, **changed("emergency_")),
    )
    return Limits(comfort, emergency, **rest)


def braking_of(rig: Rig, facts: InterfaceFacts, friction: float = DRY_FRICTION) -> EffectiveDeceleration:
    """Return how hard the rig's car brakes by its interface's `facts`, on tyres of this friction."""
    return effective_deceleration(vehicle_of(rig), calibration_of(rig), limits_of(rig), facts, friction=friction)


def watchdog_deceleration_of(rig: Rig, facts: InterfaceFacts, friction: float = DRY_FRICTION) -> float | None:
    """Return how hard the car stops where the frames end [m/s2]; None where nobody tried it.

    The least of what was measured, what the interface says of its watchdog, and what the car can do.
    """
    test = rig.watchdog_test
    if test is None:
        return None
    car = braking_of(rig, facts, friction).without_gateway().value
    watchdog = facts.when_commands_stop.largest_deceleration(rig.calibration.brake_gain_kgm)
    return min(test.deceleration_mps2, car, watchdog if test.armed else math.inf)


def mounting_of(rig: Rig) -> Mounting:
    """Return where the receiver's output point sits."""
    mounting = rig.mounting
    return Mounting(mounting.forward_m, mounting.left_m, -math.radians(mounting.heading_misalignment_deg))


def receiver_of(rig: Rig) -> Receiver:
    """Return the receiver; `rig.load` takes no table of another kind."""
    receiver = rig.pose
    assert isinstance(receiver, Receiver)
    return receiver


def interface_of(rig: Rig) -> InterfaceConfig:
    """Return the drive-by-wire interface; a file is resolved against the present working folder."""
    name, settings = rig.drive_by_wire.interface, dict(rig.drive_by_wire.settings)
    file, colon, function = name.rpartition(":")
    return InterfaceConfig(f"{Path(file).resolve()}:{function}" if colon else name, settings)


def frame_of(rig: Rig) -> MapFrame:
    """Return the lot's map: about the stored alignment's origin, or else about the outline's first corner."""
    latitude, longitude = rig.alignment.origin or rig.lot.outline[0]
    return local_frame(math.radians(latitude), math.radians(longitude))


def place_in_degrees(frame: MapFrame, x: float, y: float, heading: float) -> tuple[float, float, float]:
    """Return latitude, longitude [deg], WGS84, and heading [deg], clockwise from true north, of a pose in a map.

    `x` and `y` are in metres, `heading` in radians, counter-clockwise from the map's +x.
    """
    latitude, longitude = frame.to_geodetic(x, y)
    bearing = 90.0 - math.degrees(heading - frame.convergence(latitude, longitude))
    # Rounded first: what rounds to 360 is 0.
    return round(math.degrees(latitude), 9), round(math.degrees(longitude), 9), round(bearing % 360.0, 4) % 360.0


def lot_of(rig: Rig) -> Lot:
    """Return the ground that the car may cover, in the lot's map."""
    frame = frame_of(rig)

    def placed(corners: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
        return [frame.to_map(math.radians(latitude), math.radians(longitude)) for latitude, longitude in corners]

    try:
        return Lot(placed(rig.lot.outline), [placed(hole) for hole in rig.lot.holes], rig.lot.margin_m)
    except ConfigError as error:
        raise ConfigError(f"lot.{error}") from None


def outline_in(rig: Rig, frame: MapFrame) -> tuple[tuple[float, float], ...]:
    """Return the corners of the lot's outline in another map [m]."""
    return tuple(
        frame.to_map(math.radians(latitude), math.radians(longitude)) for latitude, longitude in rig.lot.outline
    )


def distance_between_lots(rig: Rig, other: Rig) -> float:
    """Return the distance between the grounds of two rigs' lots on Earth [m]; 0 where they overlap or touch."""
    frame = local_frame(*(math.radians(degrees) for degrees in rig.lot.outline[0]))
    return distance_between(outline_in(rig, frame), outline_in(other, frame))


def alignment_of(rig: Rig, network: str) -> Alignment | None:
    """Return the alignment of the lot's map with the virtual road's; None where it is matched at the start.

    `network` is the name of the virtual road's. Raises ConfigError for an alignment that was made for another one, and
    for surveyed pairs that do not fit each other.
    """
    wanted = rig.alignment
    if wanted.kind == "matched_start":
        return None
    if wanted.network != network:
        raise ConfigError(f"alignment.network: made for {wanted.network!r}, but the drive is in {network!r}")
    return _stored(rig) if wanted.kind == "stored" else _surveyed(rig)


def with_alignment_for(rig: Rig, scenario: str) -> Rig:
    """Return a rig with the one alignment that it has for a scenario of this name, and else as it is.

    A simulated vehicle then stands where that alignment has the path's start. The lot's map may be about another place
    than the whole rig's: it is that of the alignment.
    """
    wanted = rig.alignments.get(scenario)
    if wanted is None:
        return rig
    changed: dict[str, object] = {"alignment": wanted, "alignments": {}}
    if rig.car_start is not None and wanted.start is not None:
        keys = ("latitude_deg", "longitude_deg", "heading_deg")
        changed["car_start"] = rig.car_start.model_copy(update=dict(zip(keys, wanted.start, strict=True)))
    return rig.model_copy(update=changed)


def _stored(rig: Rig) -> Alignment:
    wanted = rig.alignment
    rotation, x, y = wanted.rotation_deg, wanted.x_m, wanted.y_m
    assert rotation is not None and x is not None and y is not None  # noqa: PT018
    return Alignment(math.radians(rotation), x, y, (wanted.residual_m or 0.0,))


def _surveyed(rig: Rig) -> Alignment:
    wanted, frame = rig.alignment, frame_of(rig)
    points, street, limit = wanted.lot_points, wanted.street_points_m, wanted.residual_m
    assert points is not None and street is not None and limit is not None  # noqa: PT018
    lot = [frame.to_map(math.radians(latitude), math.radians(longitude)) for latitude, longitude in points]
    try:
        return Alignment.from_surveyed_pairs(lot, street, limit)
    except ConfigError as error:
        raise ConfigError(f"alignment: {error}") from None


class RigStops(NamedTuple):
    """How each layer stops the rig's car; no stop is stronger than the lot's friction allows."""

    gateway: StopModel
    watchdog: StopModel  #: the gateway's where the watchdog was never tried: then the car cannot be armed
    downhill: float  #: sine of the lot's worst slope, positive


def stops_of(rig: Rig) -> RigStops:
    """Return how the gateway and the DBW controller's watchdog stop the car, as the geofence reckons with them."""
    vehicle, limits, lag = vehicle_of(rig), limits_of(rig), calibration_of(rig).drive_lag
    comfort = limits.comfort
    slope = math.atan(rig.lot.grade_percent / 100.0)
    grip = rig.lot.friction * GRAVITY * math.cos(slope)
    deceleration = min(limits.stop_deceleration, grip)
    gateway = StopModel(
        deceleration,
        SETPOINT_LIFETIME + NOTICED + vehicle.brake_delay + vehicle.brake_lag,
        deceleration / limits.stop_jerk,
        lag,
        comfort.jerk,
        comfort.acceleration,
    )
    test = rig.watchdog_test
    strength = watchdog_deceleration_of(rig, load(interface_of(rig)).facts)
    watchdog = gateway
    if test is not None and strength is not None:
        watchdog = replace(gateway, deceleration=min(strength, grip), delay=SETPOINT_LIFETIME + test.delay_s, rise=0.0)
    return RigStops(gateway, watchdog, math.sin(slope))


def geofence_of(rig: Rig, alignment: Alignment) -> Geofence:
    """Return the geofence of the lot, which `alignment` maps to the virtual road."""
    vehicle, comfort, stops = vehicle_of(rig), limits_of(rig).comfort, stops_of(rig)
    return Geofence(
        lot_of(rig),
        vehicle,
        alignment,
        gateway=stops.gateway,
        watchdog=stops.watchdog,
        downhill=stops.downhill,
        turning=Turning.of(vehicle, comfort.lateral_jerk, SETPOINT_LIFETIME + NOTICED, comfort.acceleration),
        drift=unseen_drift,
    )


def faults_of(rig: Rig) -> tuple[InjectedFault, ...]:
    """Return the faults that are injected into the simulated vehicle, and the actions of its driver.

    One that cannot be injected through the rig's drive-by-wire interface is refused.
    """
    from vve_sumo.plant.injectable import require_injectable
    from vve_sumo.plant.injected_faults import InjectedFault

    faults = []
    for number, wanted in enumerate(rig.faults):
        try:
            fault = InjectedFault.from_dict(wanted.model_dump())
            require_injectable((fault,), interface_of(rig), receiver_of(rig))
            faults.append(fault)
        except ConfigError as error:
            raise ConfigError(f"faults.{number}: {error}") from None
    return tuple(faults)
