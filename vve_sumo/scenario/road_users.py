"""Who is on the virtual road beside egos and traffic, as a scenario file may say: what stands, actors, persons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.config_file import Finite, Name, NotNegative, Positive, Table
from vve_sumo.scenario.story_schema import Story

#: of a parked car for which no length is declared [m]
PARKED_CAR_LENGTH = 4.6
RoadSpeed = Annotated[float, Field(ge=0.0, le=100.0)]
Kind = Literal["car", "van", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "child"]


def _standing_size(which: Literal["length", "width"]) -> Any:
    """Return the field of an obstacle's size: its kind's, but for a car a little longer than the usual one."""

    def of_its_kind(given: dict[str, Any]) -> float:
        kind = given.get("kind", "car")
        return PARKED_CAR_LENGTH if (kind, which) == ("car", "length") else float(getattr(TYPICAL[kind], which))

    return Field(default_factory=of_its_kind, description="left out: that of its kind")


class ParkedObstacle(Table):
    """What stands on the ego's path for the whole drive, such as a parked car."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    at_m: NotNegative = Field(description="distance along the path of the middle of the obstacle")
    offset_m: Annotated[float, Field(ge=-20.0, le=20.0)] = Field(default=0.0, description="left of the path positive")
    turned_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0, description="heading against the path's, counter-clockwise"
    )
    kind: Kind = Field(default="car", description="decides its size and its height, and how radar and lidar see it")
    length_m: Annotated[float, Field(gt=0.2, le=25.0)] = _standing_size("length")
    width_m: Annotated[float, Field(gt=0.2, le=4.0)] = _standing_size("width")


class When(Table):
    """A trigger: it fires at the first tick at which every condition that it states holds; none stated: at once.

    Distances are along the ego's path, from the ego's front bumper. The gap is that between the nearest faces of ego
    and actor, ahead or behind; it is 0 beside the ego, where nothing closes in. Before an actor enters it counts as
    standing where it would enter, at the speed it would enter with.
    """

    drive_s: NotNegative | None = Field(
        default=None, description="the drive has lasted so long; a live one from the operator's go on"
    )
    after_s: NotNegative | None = Field(
        default=None,
        description="so long after the previous event began, or after the actor entered; of `enters`: as drive_s",
    )
    ego_at_m: NotNegative | None = Field(default=None, description="the ego's front bumper has come so far on its path")
    ego_within_m: NotNegative | None = Field(default=None, description="the gap from the ego to the actor is no longer")
    ttc_s: NotNegative | None = Field(
        default=None, description="the gap over the speed at which it closes is no longer"
    )
    ego_arrives_in_s: NotNegative | None = Field(
        default=None, description="the ego, at its present speed, is so far from the actor's centre, or nearer"
    )
    ego_speed_mps: NotNegative | None = Field(default=None, description="the ego is at least so fast")


class ActorEvent(Table):
    """What an actor does once its trigger fires. Events are in order: each waits for the one before it to begin."""

    when: When = When()
    speed_mps: RoadSpeed | None = Field(default=None, description="changes its speed to this")
    acceleration_mps2: Positive | None = Field(
        default=None, description="how fast its speed changes, up or down; left out: at once"
    )
    build_up_s: NotNegative = Field(default=0.0, description="time in which that acceleration builds up, linearly")
    offset_m: Annotated[float, Field(ge=-50.0, le=50.0)] | None = Field(
        default=None,
        description="goes over to this distance: from the path, left of the path positive, or where it goes straight "
        "on, from the line it entered on, to its own left positive",
    )
    over_s: Positive | None = Field(default=None, description="time it takes for that, smoothly; left out: at once")
    speeds: Name | None = Field(
        default=None,
        description="replays a recorded speed from its first row on: CSV of time_s,speed_mps, a name under routes/ or "
        "a file; its last speed holds",
    )
    leaves: bool = Field(default=False, description="is taken off the virtual road, for good")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.speed_mps is not None and self.speeds is not None:
            raise ValueError("expected one of speed_mps and speeds")
        needs = {"acceleration_mps2": "speed_mps", "build_up_s": "acceleration_mps2", "over_s": "offset_m"}
        for key, beside in needs.items():
            if getattr(self, key) and getattr(self, beside) is None:
                raise ValueError(f"{key} says how {beside} is reached, expected {beside} beside it")
        return self


class Actor(Table):
    """A road user that moves as the scenario says; SUMO's traffic sees it and reacts to it."""

    FORMER: ClassVar[Mapping[str, str]] = {"acts": "events"}

    id: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    kind: Kind = Field(default="car", description="decides its size, how radar sees it and what SUMO takes it for")
    length_m: Annotated[float, Field(gt=0.1, le=25.0)] | None = Field(default=None, description="instead of its kind's")
    width_m: Annotated[float, Field(gt=0.1, le=4.0)] | None = Field(default=None, description="instead of its kind's")
    path: Name | None = Field(
        default=None, description="moves along this path instead of the ego's: a name under routes/ or a CSV file"
    )
    at_m: NotNegative | None = Field(default=None, description="where its centre enters, along its path")
    ahead_m: Finite | None = Field(
        default=None,
        description="instead of at_m: where it enters, clear distance from the ego's front bumper to the actor's "
        "nearest face at that moment, along the ego's path; behind the ego negative, to the actor's front",
    )
    offset_m: Annotated[float, Field(ge=-50.0, le=50.0)] = Field(
        default=0.0, description="where it enters, left of the path positive"
    )
    turned_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0,
        description="where it goes: 0 along the path, 180 or -180 against it, anything else straight on at this angle "
        "to the path, counter-clockwise; at the end of a path it leaves the virtual road",
    )
    speed_mps: RoadSpeed = Field(default=0.0, description="at which it enters")
    fidelity: Literal["ideal", "measured"] = Field(
        default="measured",
        description="of a change of speed whose event states no acceleration: `ideal` at once, `measured` as people "
        "change theirs, where its kind walks",
    )
    enters: When = Field(default=When(), description="it is on the virtual road from then on; left out: from the start")
    events: tuple[ActorEvent, ...] = Field(default=(), strict=False)
    story: Story | None = Field(default=None, description="instead of events: actions with triggers of their own")

    @model_serializer(mode="wrap")
    def _without_a_story_that_there_is_not(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the story of who has none: such records stay what they were."""
        written: dict[str, Any] = handler(self)
        if self.story is None:
            written.pop("story", None)
        return written

    @model_validator(mode="after")
    def _moves_one_way(self) -> Self:
        if self.story is not None and (self.events or self.enters != When() or self.turned_deg or self.at_m is None):
            raise ValueError(f"actor {self.id}: story: expected at_m beside it, no events, enters or turned_deg")
        return self

    @model_validator(mode="after")
    def _placed_once(self) -> Self:
        if (self.at_m is None) == (self.ahead_m is None):
            raise ValueError(f"actor {self.id}: expected one of at_m and ahead_m")
        if self.path is not None and self.ahead_m is not None:
            raise ValueError(f"actor {self.id}: ahead_m counts along the ego's path, expected at_m beside path")
        return self


class PersonLimits(Table):
    """Up to which age and uncertainty of their place a person is on the virtual road, and how."""

    exact_m: NotNegative = Field(
        default=1.0, description="radius (95 %) up to which the body alone is there; beyond, it is larger by the radius"
    )
    warning_m: Positive = Field(default=12.0, description="radius beyond which the person is warned")
    lost_m: Positive = Field(default=20.0, description="radius beyond which the person counts as lost")
    warning_age_s: Positive = Field(default=3.0, description="age of the newest position beyond which they are warned")
    lost_age_s: Positive = Field(default=5.0, description="age beyond which the person counts as lost")

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if not self.exact_m < self.warning_m < self.lost_m:
            raise ValueError("expected exact_m below warning_m below lost_m")
        if not self.warning_age_s < self.lost_age_s:
            raise ValueError("expected warning_age_s below lost_age_s")
        return self


class SimulatedPerson(Table):
    """Who stands in for a person where nobody is there: a walk, and the errors of a phone."""

    walk: Name = Field(
        description="CSV of time_s,forward_m,left_m: drive time, and the place from the field's anchor along its "
        "heading and to the left of it; a name under routes/ or a file"
    )
    accuracy_m: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        default=5.0, description="of the simulated phone: the radius that holds the true place with 95 %"
    )
    period_s: Annotated[float, Field(ge=0.2, le=10.0)] = Field(default=1.0, description="between two of its positions")


class Person(Table):
    """A real person, who walks or rides in a field of their own and stands on the virtual road."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    kind: Literal["pedestrian", "bicycle"] = Field(
        default="pedestrian", description="decides size, greatest speed, how sensors see it and what SUMO takes it for"
    )
    length_m: Annotated[float, Field(gt=0.1, le=25.0)] | None = Field(default=None, description="instead of its kind's")
    width_m: Annotated[float, Field(gt=0.1, le=4.0)] | None = Field(default=None, description="instead of its kind's")
    at_m: NotNegative = Field(description="where the field's anchor lies on the virtual road, along the ego's path")
    offset_m: Annotated[float, Field(ge=-200.0, le=200.0)] = Field(
        default=0.0, description="of the anchor, left of the path positive"
    )
    turned_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0, description="where the anchor's heading points there, against the path's, counter-clockwise"
    )
    limits: PersonLimits = PersonLimits()
    simulated: SimulatedPerson | None = Field(
        default=None, description="who stands in for the person in lockstep, and in a live drive of a rig that says so"
    )
