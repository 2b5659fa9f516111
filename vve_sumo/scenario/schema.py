"""What a scenario file may say: pydantic models, the edge where units are in the names.

Knows nothing of SUMO, files' places or how a drive is run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    create_model,
    model_serializer,
    model_validator,
)

from vve_sumo.config_file import Finite, Name, NotNegative, Positive, Table
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.per_drive import OF_RIDE, PER_DRIVE
from vve_sumo.scenario.road_users import Actor, ParkedObstacle, Person
from vve_sumo.scenario.story_schema import Groups
from vve_sumo.sensors.radar_settings import RadarSettings

#: the vehicle model of whoever names none
DEFAULT_VEHICLE = "ford_fusion"
#: controlled cars of a scenario at most, that of [ego] among them
MAX_EGOS = 8


class Road(Table):
    """The virtual road and its traffic."""

    network: Name = Field(description="SUMO network: a name under networks/ or a file")
    demand: tuple[Name, ...] = Field(default=(), strict=False, description="traffic: names under routes/ or files")
    warm_up_s: Annotated[float, Field(ge=0.0, le=3600.0)] = Field(
        default=0.0, description="simulated time the traffic runs before the ego enters"
    )


class StartPose(Table):
    """Where the real car stands at the start; the place that is joined to the start of the path."""

    latitude_deg: Annotated[float, Field(ge=-85.0, le=85.0)] = Field(description="rear axle, WGS84")
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(description="rear axle, WGS84")
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = Field(description="clockwise from true north")


class CarDifferences(Table):
    """How the simulated vehicle differs from the car that is declared."""

    fidelity: Literal["ideal", "measured"] | None = Field(
        default=None,
        description="of sensors, brakes, tyres and receiver; `measured`: as the vehicle model's table `[measured]` "
        "has them; left out: `measured` where the model has that table, otherwise `ideal`",
    )
    noise: bool = Field(default=True, description="RTK and gyro noise on or off, and what `measured` adds to them")
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        default=1.0, description="size of that noise over what the receiver says of itself"
    )
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
        default=0.01, description="from the epoch of a fix to the arrival of its bytes; the pipeline predicts it away"
    )
    gnss_hidden_delay_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, description="by which a fix is older than its epoch says; nothing in the pipeline can know of it"
    )
    steering_delay_s: Annotated[float, Field(ge=0.0, le=5.0)] = Field(
        default=0.0, description="dead time of the steering beyond the declared one, as on a slow link to the car"
    )

    @model_serializer(mode="wrap")
    def _without_a_delay_that_is_not_stated(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a delay of the steering that there is not: such records stay what they were."""
        written: dict[str, Any] = handler(self)
        if self.steering_delay_s == 0.0:
            written.pop("steering_delay_s", None)
        return written


class DeclaredStretch(Table):
    """How far beside a stretch of its path the ego may go; a lot is given this room as well as the path's own.

    Where stretches overlap, the wider one counts.
    """

    from_m: NotNegative = Field(default=0.0, description="where it begins, distance along the path")
    to_m: Positive | None = Field(default=None, description="where it ends; left out: at the end of the path")
    left_m: Annotated[float, Field(ge=0.0, le=50.0)] = Field(
        default=0.0, description="how far the rear axle may go to the left of the path, while it heads along it"
    )
    right_m: Annotated[float, Field(ge=0.0, le=50.0)] = Field(default=0.0, description="the same, to the right")

    @model_validator(mode="after")
    def _wide_and_long(self) -> Self:
        if self.left_m == self.right_m == 0.0:
            raise ValueError("expected left_m or right_m above 0")
        if self.to_m is not None and not self.from_m < self.to_m:
            raise ValueError(f"to_m {self.to_m:g} is not beyond from_m {self.from_m:g}")
        return self


class EgoSettings(Table):
    """What the ego drives and how fast."""

    vehicle: Name = Field(
        default=DEFAULT_VEHICLE, description="vehicle model: a name under vehicles/ or a file; a rig brings its own"
    )
    path: Name = Field(description="CSV of latitude_deg,longitude_deg of the rear axle: a name under routes/ or a file")
    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = Field(description="speed to keep where nothing forbids it")
    initial_speed_mps: Annotated[float, Field(ge=1.0, le=40.0)] | None = Field(
        default=None, description="speed with which the drive begins; left out: the car starts from rest"
    )
    initial_s_m: NotNegative = Field(
        default=0.0, description="distance along the path at which the drive begins; needs initial_speed_mps"
    )
    deviation_limit_m: Positive = Field(
        default=4.0, description="a car farther off its path than this is stopped; room for a lane change by default"
    )
    speed_margin_mps: Positive = Field(
        default=2.0, description="a car faster than its speed by more than this is stopped"
    )
    corridor: tuple[DeclaredStretch, ...] = Field(
        default=(), strict=False, description="where a controller may leave the path on purpose: room for it in a lot"
    )
    lot: StartPose
    car: CarDifferences = CarDifferences()

    @model_validator(mode="after")
    def _not_too_fast(self) -> Self:
        if self.initial_speed_mps is not None and self.initial_speed_mps > self.speed_mps:
            raise ValueError(f"initial_speed_mps {self.initial_speed_mps:g} is above speed_mps {self.speed_mps:g}")
        if self.initial_speed_mps is None and self.initial_s_m > 0.0:
            raise ValueError("initial_s_m needs initial_speed_mps: from rest a drive begins at the start of its path")
        return self

    @model_serializer(mode="wrap")
    def _without_what_is_not_declared(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a corridor and a rolling start that are not declared: such records stay what they were."""
        written: dict[str, Any] = handler(self)
        if not self.corridor:
            written.pop("corridor", None)
        if self.initial_speed_mps is None:
            written = {key: value for key, value in written.items() if not key.startswith("initial_")}
        return written


class Control(Table):
    """The system under test."""

    name: Name = Field(default="follow_and_stop", description="shipped name, file.py:make, or an entry point")
    tuning: dict[str, bool | Finite | int | str] = Field(default={}, description="handed to make(vehicle, tuning)")


def _ordered(least: float | None, greatest: float | None) -> None:
    if least is not None and greatest is not None and least > greatest:
        raise ValueError(f"least {least:g} is above greatest {greatest:g}")


class CriterionBand(Table):
    """An interval that a figure of the drive must lie in; either side may be open."""

    min: Finite | None = None
    max: Finite | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        _ordered(self.min, self.max)
        return self


def _kind_of_limit(value: object) -> str:
    return "switch" if isinstance(value, bool) else "band"


#: what a criterion on a user's metric may be: true or false, or a band
Limit = Annotated[Annotated[bool, Tag("switch")] | Annotated[CriterionBand, Tag("band")], Discriminator(_kind_of_limit)]


class PassCriteria(Table):
    """What makes the drive pass; a criterion that is left out is not judged.

    Beside the fields, the keys may be names of metrics that the scenario's `metrics` bring.
    """

    model_config = ConfigDict(extra="allow")
    OTHERS: ClassVar[Any] = Limit
    __pydantic_extra__: dict[str, Limit] = Field(init=False)

    outcome: Literal["stopped", "arrived", "completed", "fault"] | None = Field(
        default=None, description="how the drive must end; fault: stopped by the gateway"
    )

    @model_serializer(mode="wrap")
    def _without_later_ones_that_are_not_judged(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out later criteria that are not stated: records of drives without them stay what they were."""
        written: dict[str, Any] = handler(self)
        later = {*OF_RIDE, "red_lights_run", "stop_signs_run", "min_crossing_pet_s"}
        return {name: value for name, value in written.items() if value is not None or name not in later}


def _criterion(metric: Metric) -> tuple[Any, Any]:
    """Return type and default of a metric as a criterion; contact alone is judged where nothing is said of it."""
    annotation = (bool if metric.kind == "bool" else CriterionBand) | None
    return annotation, Field(default=False if metric.name == "collision" else None, description=metric.meaning)


if TYPE_CHECKING:
    Criteria: TypeAlias = PassCriteria
else:
    #: the end of a drive, and every metric of a drive that may be a criterion
    Criteria = create_model(
        "Criteria",
        __base__=PassCriteria,
        __doc__=PassCriteria.__doc__,
        **{name: _criterion(metric) for name, metric in PER_DRIVE.items() if metric.judges},
    )


class EndTrigger(Table):
    """What ends the drive before its time, with the outcome `completed`; the criteria judge the drive as any other.

    A drive that touched something has the outcome `contact` all the same.
    """

    contact: bool = Field(default=False, description="at the first contact, instead of when the car is at rest")
    ego_at_m: NotNegative | None = Field(default=None, description="the ego's front bumper has come so far on its path")
    lateral_deviation_m: Positive | None = Field(default=None, description="the ego is farther off its path")
    ttc_s: Positive | None = Field(default=None, description="the time to collision has fallen below this")
    when: Groups = Field(
        default=(), strict=False, description="groups of conditions as in an actor's story, of one of which all hold"
    )

    @model_serializer(mode="wrap")
    def _without_groups_that_there_are_not(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out groups of conditions where there are none: such records stay what they were."""
        written: dict[str, Any] = handler(self)
        if not self.when:
            written.pop("when", None)
        return written


class SensorSettings(Table):
    """A virtual sensor beside the radar of `[radar]`."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")] = Field(
        description="its name in `observation.sensors` and in the record, each once; `radar` is that of `[radar]`"
    )
    kind: Name = Field(description="`radar`, `lidar`, `camera`, `file.py:make`, or an installed package's entry point")
    settings: dict[str, bool | Finite | int | str | list[Finite]] = Field(
        default={}, description="the keys of its kind; of `radar` those of `[radar]`"
    )


class Weather(Table):
    """What of the weather changes how the car drives."""

    friction: Annotated[float, Field(ge=0.05, le=1.2)] = Field(
        default=0.9, description="of tyre on road: about 0.9 dry, 0.6 wet, 0.3 snow, 0.1 ice"
    )


class Parameter(Table):
    """A figure of the scenario with a name of its own, that a sweep may vary within bounds."""

    sets: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        strict=False, description="keys that take the value, such as ego.speed_mps or actors.lead.ahead_m"
    )
    min: Finite | None = Field(default=None, description="no sweep goes below")
    max: Finite | None = Field(default=None, description="no sweep goes above")
    meaning: str = ""

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        _ordered(self.min, self.max)
        return self


def _as_in_ego(key: str) -> tuple[Any, Any]:
    """Return type and default of a key of [ego] in the table of a further ego."""
    field = EgoSettings.model_fields[key]
    annotation: Any = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
    return annotation | None, Field(default=None, description=field.description)


class FurtherEgoTable(Table):
    """A controlled car beside that of [ego]; a key of [ego] that is left out is as it is there."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    controller: Control | None = Field(default=None, description="the system under test; left out: as in [controller]")
    radar: RadarSettings | None = Field(default=None, description="left out: as in [radar]")
    sensors: tuple[SensorSettings, ...] | None = Field(
        default=None, strict=False, description="beside its radar; left out: as in [[sensors]]"
    )
    criteria: Criteria | None = Field(default=None, description="by which it passes; left out: as in [criteria]")
    end_trigger: EndTrigger | None = Field(default=None, description="left out: as in [end_trigger]")

    @model_serializer(mode="wrap")
    def _without_what_is_left_out(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = handler(self)
        return {key: value for key, value in written.items() if value is not None}


if TYPE_CHECKING:
    FurtherEgo: TypeAlias = FurtherEgoTable
else:
    #: a further ego with every key of [ego]
    FurtherEgo = create_model(
        "FurtherEgo",
        __base__=FurtherEgoTable,
        __doc__=FurtherEgoTable.__doc__,
        **{key: _as_in_ego(key) for key in EgoSettings.model_fields},
    )


class Scenario(Table):
    """One drive: where, who, what is in the way, and when it counts as passed."""

    FORMER: ClassVar[Mapping[str, str]] = {"abort": "end_trigger", "street": "road"}

    title: Name
    description: str = ""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    duration_s: Annotated[float, Field(gt=0.0, le=36000.0)] = Field(
        default=180.0, description="the drive is ended then, wherever it is"
    )
    after_stop_s: Annotated[float, Field(ge=0.0, le=600.0)] = Field(
        default=2.0,
        description="the drive is over when the car has been at rest this long; behind traffic a rest does not count",
    )
    road: Road
    ego: EgoSettings
    egos: Annotated[tuple[FurtherEgo, ...], Field(max_length=MAX_EGOS - 1)] = Field(default=(), strict=False)
    radar: RadarSettings = RadarSettings()
    sensors: tuple[SensorSettings, ...] = Field(default=(), strict=False)
    controller: Control = Control()
    weather: Weather = Weather()
    obstacles: tuple[ParkedObstacle, ...] = Field(default=(), strict=False)
    actors: tuple[Actor, ...] = Field(default=(), strict=False)
    people: tuple[Person, ...] = Field(default=(), strict=False)
    metrics: tuple[Name, ...] = Field(
        default=(),
        strict=False,
        description="what is measured beside the shipped metrics: each `file.py:make`, or an installed package's entry "
        "point",
    )
    criteria: Criteria = Criteria()
    end_trigger: EndTrigger = EndTrigger()
    parameters: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")], Parameter] = Field(
        default={}, description="what a sweep may vary by name, besides every key by its place"
    )

    @model_serializer(mode="wrap")
    def _without_who_is_not_there(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out people and further egos where there are none: such records stay what they were.

        Egos are in the order of their ids: their order in a file says nothing.
        """
        written: dict[str, Any] = handler(self)
        for name in ("people", "egos"):
            if not getattr(self, name):
                written.pop(name, None)
        if "egos" in written:
            written["egos"] = sorted(written["egos"], key=lambda one: str(one["id"]))
        return written
