"""What a scenario file may say: pydantic models, the edge where units are in the names.

Knows nothing of SUMO, files' places or how a drive is run.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Name = Annotated[str, Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Table(BaseModel):
    """One table of a scenario file: unknown keys are errors, nothing is coerced, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Street(Table):
    """The virtual street and its traffic."""

    network: Name = Field(description="SUMO network: a name under networks/ or a file")
    demand: tuple[Name, ...] = Field(default=(), strict=False, description="traffic: names under routes/ or files")
    warm_up_s: Annotated[float, Field(ge=0.0, le=3600.0)] = Field(
        default=0.0, description="simulated time the traffic runs before the ego enters"
    )


class Lot(Table):
    """Where the real car stands at the start; the place that is joined to the start of the path."""

    latitude_deg: Annotated[float, Field(ge=-85.0, le=85.0)] = Field(description="rear axle, WGS84")
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(description="rear axle, WGS84")
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = Field(description="clockwise from true north")


class Car(Table):
    """How the hardware-free car differs from the car that is declared."""

    noise: bool = Field(default=True, description="RTK and gyro noise on or off")
    mass_factor: Annotated[float, Field(ge=0.5, le=2.0)] = Field(default=1.0, description="true mass over declared")
    brake_gain_factor: Annotated[float, Field(ge=0.3, le=2.0)] = Field(
        default=1.0, description="true brake torque over commanded"
    )
    grade_percent: Annotated[float, Field(ge=-15.0, le=15.0)] = Field(default=0.0, description="uphill positive")
    steering_wheel_bias_deg: Annotated[float, Field(ge=-20.0, le=20.0)] = Field(
        default=0.0, description="steering-wheel angle at which the wheels point straight, left positive"
    )
    heading_misalignment_deg: Annotated[float, Field(ge=-10.0, le=10.0)] = Field(
        default=0.0, description="receiver's heading minus the car's, clockwise positive"
    )
    gnss_delay_s: Annotated[float, Field(ge=0.0, le=0.5)] = Field(
        default=0.01, description="from the epoch of a fix to the arrival of its bytes"
    )


class Ego(Table):
    """What the ego drives and how fast."""

    path: Name = Field(description="CSV of latitude_deg,longitude_deg of the rear axle: a name under routes/ or a file")
    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = Field(description="speed to keep where nothing forbids it")
    deviation_limit_m: Positive = Field(
        default=4.0, description="a car farther off its path than this is stopped; room for a lane change by default"
    )
    lot: Lot
    car: Car = Car()


class Radar(Table):
    """The virtual radar, where it differs from the Delphi ESR defaults."""

    ideal: bool = Field(default=False, description="no noise, no quanta, every visible target detected")
    range_limit_m: Positive | None = Field(default=None, description="blind beyond this range in every mode")


class Control(Table):
    """The system under test."""

    name: Name = Field(default="follow_and_stop", description="shipped name, file.py:make, or an entry point")
    tuning: dict[str, bool | Finite | int | str] = Field(default={}, description="handed to make(vehicle, tuning)")


class Obstacle(Table):
    """A parked vehicle on the ego's path."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    at_m: NotNegative = Field(description="distance along the path of the middle of the obstacle")
    offset_m: Annotated[float, Field(ge=-20.0, le=20.0)] = Field(default=0.0, description="left of the path positive")
    turned_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0, description="heading against the path's, counter-clockwise"
    )
    length_m: Annotated[float, Field(gt=0.2, le=25.0)] = 4.6
    width_m: Annotated[float, Field(gt=0.2, le=4.0)] = 1.8


class Band(Table):
    """An interval that a figure of the drive must lie in; either side may be open."""

    min: Finite | None = None
    max: Finite | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"least {self.min:g} is above greatest {self.max:g}")
        return self


class Criteria(Table):
    """What makes the drive pass; a criterion that is left out is not judged."""

    outcome: Literal["stopped", "arrived"] | None = Field(default=None, description="how the drive must end")
    collision: bool | None = Field(default=False, description="whether a contact may, or must not, happen")
    stop_gap_m: Band | None = None
    min_ttc_s: Band | None = None
    max_lateral_deviation_m: Band | None = None
    max_deceleration_mps2: Band | None = None
    duration_s: Band | None = None


class Scenario(Table):
    """One drive: where, who, what is in the way, and when it counts as passed."""

    title: Name
    description: str = ""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    duration_s: Annotated[float, Field(gt=0.0, le=36000.0)] = Field(
        default=180.0, description="the drive is ended then, wherever it is"
    )
    after_stop_s: Annotated[float, Field(ge=0.0, le=600.0)] = Field(
        default=2.0, description="the drive is over when the car has been at rest this long"
    )
    street: Street
    ego: Ego
    radar: Radar = Radar()
    controller: Control = Control()
    obstacles: tuple[Obstacle, ...] = Field(default=(), strict=False)
    criteria: Criteria = Criteria()
