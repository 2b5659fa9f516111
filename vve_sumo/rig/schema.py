"""What a rig file may say: pydantic models, the edge where units are in the names.

A rig is whole only with its vehicle model: `rig.load` lays what the rig says over the model's tables.
Knows nothing of files' places, buses or how a drive is run; what a rig means to the rest is `rig.resolve`.
"""

from __future__ import annotations

import datetime
import functools
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, Field, create_model, model_validator

from vve_sumo.config_file import Bitrate, Finite, Name, NotNegative, Positive, Short, Table
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.rig.connections import (
    Brain,
    Other,
    PtyLink,
    RigOutput,
    RigPeoplePage,
    RigPerson,
    RigRos2,
    RigV2x,
    RigView,
)
from vve_sumo.scenario.schema import DEFAULT_VEHICLE, CarDifferences, StartPose, Weather
from vve_sumo.vehicle.schema import Declared, DriveByWire, MeasuredImperfections, PedalCalibration, Simulated

Date = datetime.date

#: of tyre on a dry road, that of a scenario's weather where it says none
DRY_FRICTION = Weather().friction


def _latitude_first(corner: tuple[float, float]) -> tuple[float, float]:
    latitude, longitude = corner
    if abs(latitude) > 75.0:
        swapped = " (are latitude and longitude swapped?)" if abs(longitude) <= 75.0 else ""
        raise ValueError(f"latitude {latitude:g} is where no lot is, expected -75 to 75 deg{swapped}")
    if not abs(longitude) <= 180.0:
        raise ValueError(f"longitude {longitude:g} is no place on Earth, expected -180 to 180 deg")
    return corner


#: one place: latitude and longitude [deg], WGS84
Corner = Annotated[tuple[Finite, Finite], Field(strict=False), AfterValidator(_latitude_first)]
Corners = Annotated[tuple[Corner, ...], Field(strict=False)]
Outline = Annotated[tuple[Corner, ...], Field(strict=False, min_length=3)]
#: An acceleration that tyres have to pass on [m/s2]: at most friction 1.0 of clean dry asphalt, times g.
Grip = Annotated[float, Field(gt=0.0, le=9.81, allow_inf_nan=False)]
#: how fast an acceleration may change [m/s3]; 100 is full braking in a tenth of a second, as fast as brakes bite
Jerk = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
#: for how long what was measured holds
Days = Annotated[int, Field(ge=1, le=3650)]
#: largest deceleration of a car that rolls freely in drive [m/s2]: rolling, air and engine drag at 5 m/s
MAX_ROLLING_DECELERATION: Final = 0.6
#: where a car stands: latitude, longitude [deg], WGS84, and heading [deg], clockwise from true north
CarPlace = Annotated[
    tuple[
        Annotated[float, Field(ge=-75.0, le=75.0)],
        Annotated[float, Field(ge=-180.0, le=180.0)],
        Annotated[float, Field(ge=0.0, lt=360.0)],
    ],
    Field(strict=False),
]
MapPoint = Annotated[tuple[Finite, Finite], Field(strict=False)]


def _only(table: Table, kind: str, keys: dict[str, tuple[str, ...]]) -> None:
    """Refuse keys that say nothing for this kind, and miss those that it needs; `keys`: key to kinds it is for."""
    for key, kinds in keys.items():
        if key in table.model_fields_set and kind not in kinds:
            raise ValueError(f"{key} says nothing for kind {kind!r}, it is for {' and '.join(kinds)}")
        if kind in kinds and getattr(table, key) is None:
            raise ValueError(f"{key} is missing, kind {kind!r} needs it")


class RigMounting(Table):
    """Where the receiver's output point sits on the car."""

    forward_m: Annotated[float, Field(ge=-5.0, le=8.0)] = Field(description="output point ahead of the rear axle")
    left_m: Annotated[float, Field(ge=-2.0, le=2.0)] = Field(description="output point left of the rear axle")
    heading_misalignment_deg: Annotated[float, Field(ge=-10.0, le=10.0)] = Field(
        default=0.0, description="receiver's heading minus the car's, clockwise positive"
    )
    calibrated: Date | None = Field(default=None, description="day of the calibration")


class RigBus(Table):
    """The bus that the car is commanded over."""

    interface: Name = Field(description="python-can's: `socketcan`, `pcan`, `kvaser`, `slcan`, …")
    channel: Name = Field(description="python-can's: `can0`, …; `pty` is made by the simulated vehicle")
    bitrate: Bitrate = Field(default=500_000, description="bit/s")

    FORMER: ClassVar[Mapping[str, str]] = {"variant": "drive_by_wire.settings.variant"}


class RigVehicle(Declared):
    """The car: a vehicle model, and what was measured of this car in place of the model's numbers."""

    model: Name = Field(default=DEFAULT_VEHICLE, description="vehicle model: a name under vehicles/ or a file")


class RigCalibration(PedalCalibration):
    """What was measured of the car's pedals and steering in place of the model's numbers."""

    date: Date | None = Field(default=None, description="day of the calibration")
    steering_wheel_bias_deg: Annotated[float, Field(ge=-20.0, le=20.0)] = Field(
        default=0.0, description="steering-wheel angle at which the wheels point straight, left positive"
    )


class RigLimits(Table):
    """What the gateway keeps to, where it differs from its defaults, and the lot's speed limit."""

    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = Field(
        description="no drive in this lot may ask for more than this"
    )
    comfort_deceleration_mps2: Grip | None = Field(default=None, description="largest, in every drive")
    comfort_acceleration_mps2: Grip | None = Field(default=None, description="largest, in every drive")
    comfort_jerk_mps3: Jerk | None = Field(default=None, description="of a pedal pressed further")
    comfort_release_jerk_mps3: Jerk | None = Field(default=None, description="of a pedal released")
    comfort_lateral_jerk_mps3: Jerk | None = Field(default=None, description="from steering")
    emergency_deceleration_mps2: Grip | None = Field(default=None, description="largest, where asked for")
    emergency_jerk_mps3: Jerk | None = Field(default=None, description="of the brake pressed, where asked for")
    lateral_acceleration_mps2: Grip | None = Field(default=None, description="largest that steering may cause")
    stop_deceleration_mps2: Grip | None = Field(default=None, description="of the gateway's own stop")
    stop_jerk_mps3: Jerk | None = Field(default=None, description="with which it sets in")
    stop_lateral_jerk_mps3: Jerk | None = Field(default=None, description="from steering along the fallback path")
    critical_deceleration_mps2: Grip | None = Field(
        default=None, description="of the gateway's own stop after a critical fault"
    )
    critical_jerk_mps3: Jerk | None = Field(default=None, description="with which it sets in")


class RigLot(Table):
    """The ground that the car may cover, as surveyed."""

    surveyed: Date = Field(description="day of the survey; an unsurveyed lot is refused")
    outline: Outline = Field(description="`[[latitude_deg, longitude_deg], …]`, three or more, either way round")
    holes: Annotated[tuple[Outline, ...], Field(strict=False)] = Field(
        default=(), description="poles, islands: outlines inside the outline"
    )
    margin_m: Annotated[float, Field(ge=0.0, le=50.0)] = Field(
        default=1.0,
        description="kept free along every edge: mirrors, errors of survey and stopping; the receiver's drift is added",
    )
    grade_percent: Annotated[float, Field(ge=0.0, le=15.0)] = Field(description="worst slope, taken as downhill")
    valid_days: Days = Field(default=1095, description="after the survey, for a real car: then the lot is walked again")
    friction: Annotated[float, Field(ge=0.05, le=1.2)] = Field(
        default=DRY_FRICTION,
        description="lowest of tyre on ground: about 0.9 dry, 0.6 wet, 0.3 snow; no stop is taken to be stronger than "
        "it allows",
    )


class RigAlignment(Table):
    """How the lot lies on the virtual road."""

    kind: Literal["matched_start", "stored", "surveyed_pairs"] = Field(
        default="matched_start",
        description="`matched_start`: where the car stands is the start of the path; `stored`; `surveyed_pairs`",
    )
    network: Name | None = Field(default=None, description="the network that it was made for; not for `matched_start`")
    date: Date | None = Field(default=None, description="day it was made; not for `matched_start`")
    origin: Corner | None = Field(default=None, description="`stored`: the lot's place that the turn is about")
    rotation_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = Field(
        default=None, description="`stored`: road heading minus lot heading, counter-clockwise"
    )
    x_m: Finite | None = Field(default=None, description="`stored`: of the origin on the virtual road's map")
    y_m: Finite | None = Field(default=None, description="`stored`: of the origin on the virtual road's map")
    residual_m: Annotated[float, Field(ge=0.0, le=1.0)] | None = Field(
        default=None, description="`stored`: worst error of its points; `surveyed_pairs`: the worst that is accepted"
    )
    lot_points: Corners | None = Field(
        default=None, description="`surveyed_pairs`: `[[latitude_deg, longitude_deg], …]`, two or more"
    )
    street_points_m: Annotated[tuple[MapPoint, ...], Field(strict=False)] | None = Field(
        default=None, description="`surveyed_pairs`: the same places on the virtual road's map, `[[x, y], …]`"
    )

    start: CarPlace | None = Field(
        default=None,
        description="`stored`: `[latitude_deg, longitude_deg, heading_deg]` of the rear axle at the path's start; a "
        "simulated vehicle stands there",
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        made, stored, pairs = ("stored", "surveyed_pairs"), ("stored",), ("surveyed_pairs",)
        keys: dict[str, tuple[str, ...]] = dict.fromkeys(("network", "date", "residual_m"), made)
        keys |= dict.fromkeys(("origin", "rotation_deg", "x_m", "y_m"), stored)
        if self.start is not None and self.kind != "stored":
            raise ValueError(f"start says nothing for kind {self.kind!r}, it is for stored")
        _only(self, self.kind, keys | dict.fromkeys(("lot_points", "street_points_m"), pairs))
        return self


class WatchdogTest(Table):
    """What the DBW controller's own watchdog did when the frames stopped, tried on this car."""

    date: Date = Field(description="day of the test")
    armed: bool = Field(description="whether the DBW controller's watchdog is armed: it braked by itself")
    deceleration_mps2: Grip = Field(
        description="lowest measured, on the level; of a DBW controller that did not brake, that of rolling"
    )
    delay_s: Short = Field(description="after the last frame; the time in which the deceleration sets in counts half")
    valid_days: Days = Field(default=365, description="after the test, for a real car: then it is made again")
    records: Annotated[tuple[Name, ...], Field(strict=False)] = Field(
        default=(),
        description="records of the test's runs, seen from the folder that commands are run in: the doctor reads both "
        "figures from them again. A real car whose watchdog is armed needs one at least",
    )

    @model_validator(mode="after")
    def _braked_by_somebody(self) -> Self:
        """Refuse a deceleration that no car has by itself where nobody braked."""
        if not self.armed and self.deceleration_mps2 > MAX_ROLLING_DECELERATION:
            raise ValueError(
                f"deceleration_mps2: {self.deceleration_mps2:g} m/s2 with armed = false, where nobody brakes; expected "
                f"that of rolling, at most {MAX_ROLLING_DECELERATION:g}"
            )
        return self


class Latency(Table):
    """How late a command may be."""

    budget_ms: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        default=40.0, description="from the arrival of a fix to the last command frame of its tick"
    )
    breaches: Annotated[int, Field(ge=1, le=50)] = Field(
        default=10, description="ticks over the budget within a second that are a reason to stop"
    )
    deadline_ms: Annotated[float, Field(gt=0.0, lt=20.0)] = Field(
        default=8.0, description="how long a tick waits for the datagram that is due"
    )


class Operator(Table):
    """Who engages and stops."""

    automatic: bool = Field(
        default=False, description="engages and goes by itself; for simulated vehicles on a pty or a vcan only"
    )
    stop_can_id: Annotated[int, Field(ge=0, le=0x7FF)] | None = Field(
        default=None, description="a frame with this identifier on the car's bus asks for a stop"
    )
    when_another_car_stops: Literal["stop", "go_on"] = Field(
        default="stop",
        description="in a drive of several real cars, what this one does where another one is stopped, is no longer "
        "engaged, or has lost its gateway",
    )


class CarStart(StartPose, CarDifferences):
    """The simulated vehicle: where it stands and how it differs from what the rig declares."""

    channel: Name | None = Field(
        default=None, description="SocketCAN channel of the car's own end, where it is not the rig's (two cards)"
    )
    brain_channel: PtyLink | None = Field(
        default=None,
        description="`pty:FILE`: a second port on the car's bus, where that is a pty: FILE becomes a link to the "
        "serial port that an external controller opens",
    )


class RigFault(Table):
    """A fault that is injected into the simulated vehicle."""

    kind: Name = Field(description="see the fault matrix")
    at_s: NotNegative = Field(description="after the car first moves, or see `from_start`")
    for_s: Positive = Field(default=3600.0, description="how long it lasts")
    value: Finite | None = Field(default=None, description="how strong it is, where the kind knows that")
    shape: Literal["step", "ramp", "flapping"] = Field(
        default="step",
        description="`step`: its whole strength at once; `ramp`: grows linearly to `value` over `for_s`; `flapping`: "
        "in turn on and off, each for `period_s`",
    )
    period_s: Positive | None = Field(default=None, description="of `flapping`: each half's duration")
    from_start: bool = Field(default=False, description="`at_s` counts from the start of the drive")


class Rig(Table):
    """One car with its receiver, its bus and its lot."""

    FORMER: ClassVar[Mapping[str, str]] = {"rehearse": "faults"}

    title: Name
    car: Literal["real", "simulated"] = Field(description="`real` or `simulated`")
    pose: ReceiverTable
    mounting: RigMounting
    bus: RigBus
    drive_by_wire: DriveByWire
    vehicle: RigVehicle
    calibration: RigCalibration
    simulated: Simulated
    measured: MeasuredImperfections | None = Field(
        default=None, description="as the vehicle model's, for `car_start.fidelity`"
    )
    limits: RigLimits
    lot: RigLot
    alignment: RigAlignment = RigAlignment()
    alignments: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")], RigAlignment] = Field(
        default={}, description="in place of `[alignment]`, each for the scenario of its name"
    )
    watchdog_test: WatchdogTest | None = None
    latency: Latency = Latency()
    operator: Operator = Operator()
    view: RigView = RigView()
    people: tuple[RigPerson, ...] = Field(default=(), strict=False)
    people_page: RigPeoplePage = RigPeoplePage()
    v2x: RigV2x | None = None
    ros2: RigRos2 = RigRos2()
    others: tuple[Other, ...] = Field(default=(), strict=False)
    brain: Brain = Brain()
    outputs: tuple[RigOutput, ...] = Field(default=(), strict=False)
    car_start: CarStart | None = None
    faults: tuple[RigFault, ...] = Field(default=(), strict=False)


@functools.cache
def rig_with(receiver: type[ReceiverTable]) -> type[Rig]:
    """Return the model of a rig whose `[pose]` is of this kind."""
    return create_model("Rig", __base__=Rig, pose=(receiver, ...))
