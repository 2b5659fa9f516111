"""Schema of a vehicle file, as pydantic models: only here are units part of the names.

A rig states its own measurements in the same tables (`rig.schema`). The module does not know where files lie; their
resolved values are those of `vehicle.model`.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from vve_sumo.config_file import Finite, Name, NotNegative, Positive, Share, Short, Strength, Table

#: of an error, over what is measured
Small = Annotated[float, Field(ge=0.0, le=0.05)]
#: of an accelerometer's error [m/s2]
Sigma = Annotated[float, Field(ge=0.0, le=5.0)]
#: beginning of the source of a number that was neither measured nor published; the reason follows
ASSUMED = "assumed: "


class Declared(Table):
    """What is declared of the vehicle: geometry, inertia, limits and lags."""

    length_m: Annotated[float, Field(gt=1.0, le=20.0)] = Field(description="bumper to bumper")
    width_m: Annotated[float, Field(gt=0.5, le=3.0)] = Field(description="without mirrors")
    wheelbase_m: Annotated[float, Field(gt=0.5, le=10.0)] = Field(description="front axle to rear axle")
    front_overhang_m: Annotated[float, Field(ge=0.0, le=3.0)] = Field(description="front axle to front bumper")
    mass_kg: Annotated[float, Field(ge=300.0, le=20_000.0)] = Field(description="with occupants")
    yaw_inertia_kgm2: Annotated[float, Field(ge=100.0, le=1e5)] = Field(description="about the centre of mass")
    front_axle_to_mass_m: Annotated[float, Field(gt=0.0, le=10.0)] = Field(description="front axle to centre of mass")
    cornering_stiffness_front_npr: Annotated[float, Field(ge=1e4, le=1e6)] = Field(description="whole axle, N/rad")
    cornering_stiffness_rear_npr: Annotated[float, Field(ge=1e4, le=1e6)] = Field(description="whole axle, N/rad")
    wheel_radius_m: Annotated[float, Field(ge=0.1, le=1.0)] = Field(description="rolling")
    steering_ratio: Annotated[float, Field(ge=5.0, le=40.0)] = Field(
        description="steering-wheel angle over road-wheel angle"
    )
    steering_wheel_limit_deg: Annotated[float, Field(gt=0.0, le=1000.0)] = Field(description="steering-wheel angle")
    steering_wheel_rate_limit_radps: Annotated[float, Field(gt=0.0, le=30.0)] = Field(
        description="steering-wheel angle rate"
    )
    steering_delay_s: Short = Field(description="from frame to first movement")
    steering_lag_s: Short = Field(description="first-order, after the delay")
    brake_delay_s: Short = Field(description="from frame to first torque")
    brake_lag_s: Short = Field(description="first-order, after the delay")
    brake_torque_limit_nm: Annotated[float, Field(gt=0.0, le=20_000.0)] = Field(description="all wheels together")
    deceleration_limit_mps2: Strength = Field(description="reached at the torque limit, laden, on the level")


class PedalCalibration(Table):
    """What the pedals do: from brake torque and throttle opening to forces along the vehicle."""

    brake_gain_kgm: Positive = Field(description="brake torque for each m/s2 of deceleration")
    drive_force_limit_n: Positive = Field(description="at full throttle and low speed")
    drive_power_limit_w: Positive = Field(description="at full throttle and high speed")
    drive_lag_s: Short = Field(description="first-order, from throttle to drive force")
    creep_force_n: NotNegative = Field(description="in drive at standstill with no pedal pressed")
    creep_speed_mps: Positive = Field(description="where the creep force has fallen to zero")
    rolling_resistance: Share = Field(description="rolling drag over weight")
    drag_area_m2: Annotated[float, Field(ge=0.0, le=10.0)] = Field(description="drag coefficient times frontal area")
    wheel_speed_tolerance: Annotated[float, Field(ge=0.005, le=0.1)] = Field(
        description="share of the true speed by which the wheels may tell another one"
    )


class Simulated(Table):
    """What the simulated vehicle has besides, which nobody declares of a real one."""

    laden_mass_kg: Annotated[float, Field(ge=300.0, le=40_000.0)] = Field(
        description="largest permitted, with which suites drive it laden"
    )
    track_m: Annotated[float, Field(gt=0.5, le=3.0)] = Field(description="between the wheels of an axle")
    mass_height_m: Annotated[float, Field(gt=0.0, le=3.0)] = Field(description="of the centre of mass above ground")
    throttle_delay_s: Short = Field(description="from frame to first force")
    receiver_forward_m: Annotated[float, Field(ge=-5.0, le=8.0)] = Field(
        description="GNSS receiver's output point ahead of the rear axle"
    )
    receiver_left_m: Annotated[float, Field(ge=-2.0, le=2.0)] = Field(
        description="GNSS receiver's output point left of the rear axle"
    )


class MeasuredImperfections(Table):
    """How the simulated vehicle's sensors, brakes, tyres and receiver differ from ideal ones: fidelity `measured`."""

    wheel_runout_front_left: Small = Field(
        description="error of the wheel sensor once per revolution, amplitude over the wheel speed"
    )
    wheel_runout_front_right: Small = Field(description="the same")
    wheel_runout_rear_left: Small = Field(description="the same")
    wheel_runout_rear_right: Small = Field(description="the same")
    wheel_jitter: Small = Field(description="independent from report to report, 1 sigma over the wheel speed")
    wheel_quantum_radps: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        description="step in which wheel speeds are reported; 0: as finely as the interface does"
    )
    wheel_front_right_over_left: Annotated[float, Field(ge=-0.05, le=0.05)] = Field(
        description="by which the right front wheel turns faster than the left, over the wheel speed"
    )
    wheel_rear_right_over_left: Annotated[float, Field(ge=-0.05, le=0.05)] = Field(description="the same of the rear")
    longitudinal_acceleration_noise_mps2: Sigma = Field(description="1 sigma")
    lateral_acceleration_noise_mps2: Sigma = Field(description="1 sigma")
    acceleration_correlation_s: Short = Field(description="correlation time of both")
    longitudinal_acceleration_bias_mps2: Sigma = Field(
        description="1 sigma of what is drawn once for a drive: the sensor's zero and the road's slope"
    )
    lateral_acceleration_bias_mps2: Sigma = Field(
        description="1 sigma of what is drawn once for a drive: the sensor's zero and the road's camber"
    )
    brake_gain_factor: Annotated[float, Field(ge=0.3, le=2.0)] = Field(
        description="true brake force over what calibration.brake_gain_kgm gives"
    )
    combined_slip: bool = Field(
        description="longitudinal and lateral force of an axle are bounded together, by friction times its load"
    )
    receiver_short_gaps: Annotated[float, Field(ge=0.0, lt=0.95)] = Field(
        description="share of fixes that arrive together with the one before; 0: evenly spaced"
    )
    receiver_gap_p95_s: Short = Field(description="95 % quantile of the time between arrivals")
    receiver_gap_max_s: Short = Field(description="longest time between arrivals")
    receiver_float_every_s: NotNegative = Field(
        description="mean time between losses of the fixed ambiguities; 0: never lost"
    )
    receiver_float_time_s: NotNegative = Field(description="mean time until they are fixed again")
    receiver_float_sigma_m: NotNegative = Field(description="error of a float position, north and east each, 1 sigma")


class DriveByWire(Table):
    """The drive-by-wire interface that the car is commanded through."""

    interface: Name = Field(
        description="a shipped one, such as `dataspeed_dbw1` or `generic`, `file.py:make`, or an installed package's "
        "entry point"
    )
    settings: dict[str, bool | Finite | int | str] = Field(
        description="handed to make(settings); of `dataspeed_dbw1` the one key `variant`, the firmware's generation, "
        "`dbw1_2018` or `dbw1_2024`: to be verified on the car. What a key that ends in `_file` names is looked for "
        "beside this file, then in the working folder"
    )


class Sourced(Table):
    """A table each of whose numbers has a source."""

    sources: dict[str, Name] = Field(
        description="for each of the table's keys where its number comes from, or `assumed: ` and why"
    )

    @model_validator(mode="after")
    def _each_has_one(self) -> Self:
        numbers = [name for name in type(self).model_fields if name != "sources"]
        for name in numbers:
            if name not in self.sources:
                raise ValueError(f"{name} has no source, expected one under sources, or '{ASSUMED}' and the reason")
        for name, source in self.sources.items():
            if name not in numbers:
                raise ValueError(f"sources.{name}: no number of this table is called so")
            word, _colon, reason = source.partition(":")
            if word.strip() == ASSUMED.rstrip(": ") and not reason.strip():
                raise ValueError(f"sources.{name}: expected the reason after '{ASSUMED}'")
        return self


class SourcedDeclared(Declared, Sourced):
    """`[vehicle]` of a vehicle file."""


class SourcedCalibration(PedalCalibration, Sourced):
    """`[calibration]` of a vehicle file."""


class SourcedSimulated(Simulated, Sourced):
    """`[simulated]` of a vehicle file."""


class SourcedMeasured(MeasuredImperfections, Sourced):
    """`[measured]` of a vehicle file."""


class VehicleFile(Table):
    """One vehicle model: its wire, what is declared of it, what its pedals do, and what its simulated one has."""

    title: Name
    drive_by_wire: DriveByWire
    vehicle: SourcedDeclared
    calibration: SourcedCalibration
    simulated: SourcedSimulated
    measured: SourcedMeasured | None = None
