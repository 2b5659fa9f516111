"""What a scenario file may say of an actor whose actions each have a trigger of their own, as OpenSCENARIO's events.

Knows nothing of files of OpenSCENARIO, nor of how an actor is moved.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from vve_sumo.config_file import Finite, Name, NotNegative, Positive, Table

Speed = Annotated[float, Field(ge=0.0, le=100.0)]
ActionName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
Shape = Literal["step", "linear", "cubic", "sinusoidal"]

#: what a condition may ask for, each a key whose value is compared by `rule`
COMPARED: Final = (
    *("time_s", "speed_mps", "acceleration_mps2", "travelled_m", "relative_speed_mps"),
    *("distance_m", "headway_s", "ttc_s"),
)
#: what a condition may ask for, each a key that holds or does not
HOLDING: Final = ("stands_s", "end_of_road_s", "within_m", "touches", "actions")
#: of them, those about two bodies, or about a body and a place
OF_TWO: Final = frozenset({"relative_speed_mps", "distance_m", "headway_s", "ttc_s", "within_m", "touches"})
#: of them, those that a place on the ego's path may be the second of
OF_PLACE: Final = frozenset({"distance_m", "headway_s", "ttc_s", "within_m"})


class StoryCondition(Table):
    """One condition of a trigger: it asks for exactly one quantity.

    Distances are between reference points, with `freespace` between the nearest faces. A condition whose quantity does
    not exist (a headway to what is behind or of who stands, a TTC of who does not close in) does not hold.
    """

    of: Name = Field(default="ego", description="whose quantity it is: an actor's id or `ego`")
    to: Name | None = Field(default=None, description="the other body of a distance, headway, TTC or contact")
    at_m: Finite | None = Field(default=None, description="instead of `to`: a place, along the ego's path")
    offset_m: Finite = Field(default=0.0, description="of that place, left of the ego's path positive")
    time_s: Finite | None = Field(default=None, description="compared: time since the drive began")
    speed_mps: Finite | None = Field(default=None, description="compared: speed")
    acceleration_mps2: Finite | None = Field(default=None, description="compared: acceleration along its heading")
    travelled_m: Finite | None = Field(default=None, description="compared: way gone since it entered")
    relative_speed_mps: Finite | None = Field(default=None, description="compared: speed of `of` minus that of `to`")
    distance_m: Finite | None = Field(default=None, description="compared: distance, never negative")
    headway_s: Finite | None = Field(default=None, description="compared: distance to what is ahead over own speed")
    ttc_s: Finite | None = Field(default=None, description="compared: distance over the speed at which it shrinks")
    stands_s: NotNegative | None = Field(default=None, description="has stood still for so long")
    end_of_road_s: NotNegative | None = Field(default=None, description="has been at the end of its path for so long")
    within_m: NotNegative | None = Field(default=None, description="is no farther than this from `to` or the place")
    touches: Literal[True] | None = Field(default=None, description="its box overlaps that of `to`")
    actions: tuple[Name, ...] | None = Field(
        default=None, strict=False, description="the state of actions, each ACTOR.NAME, is the `state`"
    )
    state: Literal["began", "running", "ended"] = Field(
        default="ended", description="one began; one began and not all ended; all ended"
    )
    rule: Literal["<", "<=", ">", ">=", "==", "!="] = Field(default=">", description="how a quantity is compared")
    freespace: bool = Field(default=False, description="between the nearest faces instead of reference points")
    along: Literal["path", "path_lateral", "heading", "heading_lateral", "straight"] = Field(
        default="straight", description="a distance along or across the ego's path or the heading of `of`, or straight"
    )
    edge: Literal["none", "rising", "falling", "any"] = Field(
        default="none", description="holds always, or only at the tick at which it begins or ceases to hold"
    )
    delay_s: NotNegative = Field(default=0.0, description="holds so much later")
    from_s: NotNegative = Field(default=0.0, description="holds not before this time since the drive began")
    latched: bool = Field(default=False, description="once it held, it holds for good")

    @property
    def asked(self) -> str:
        """The key that says what it asks for."""
        return next(key for key in (*COMPARED, *HOLDING) if getattr(self, key) is not None)

    @model_validator(mode="after")
    def _asks_for_one(self) -> Self:
        asked = [key for key in (*COMPARED, *HOLDING) if getattr(self, key) is not None]
        if len(asked) != 1:
            raise ValueError(f"expected one of {', '.join((*COMPARED, *HOLDING))}, got {', '.join(asked) or 'none'}")
        second = (self.to is not None) + (self.at_m is not None)
        if asked[0] in OF_TWO and second != 1:
            raise ValueError(f"{asked[0]} is of two, expected one of to and at_m")
        if asked[0] not in OF_TWO and second:
            raise ValueError(f"{asked[0]} is of one, expected neither to nor at_m")
        if self.at_m is not None and asked[0] not in OF_PLACE:
            raise ValueError(f"{asked[0]} is of two bodies, expected to")
        return self


#: a trigger: it fires where every condition of one of its groups holds; without a group at once
Groups = tuple[Annotated[tuple[StoryCondition, ...], Field(strict=False, min_length=1)], ...]


def _how_it_is_reached(table: SpeedAction | LineChange, *keys: str) -> None:
    stated = [key for key in keys if getattr(table, key) is not None]
    if (table.shape == "step") != (not stated) or len(stated) > 1:
        expected = "none" if table.shape == "step" else "one"
        raise ValueError(f"shape {table.shape}: expected {expected} of {', '.join(keys)}")


class SpeedAction(Table):
    """A change of speed."""

    to_mps: Finite = Field(default=0.0, description="speed that it ends at; with `of`, what is added to the other's")
    of: Name | None = Field(default=None, description="counts from the speed of this body: an actor's id or `ego`")
    factor: NotNegative = Field(default=1.0, description="of that speed")
    continuous: bool = Field(default=False, description="goes on to follow that speed; needs `of` and shape step")
    shape: Shape = Field(default="step", description="of the speed over time")
    over_s: Positive | None = Field(default=None, description="time that it takes")
    over_m: Positive | None = Field(default=None, description="way that it takes: over the time in which it is gone")
    acceleration_mps2: Positive | None = Field(default=None, description="greatest acceleration, up or down")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        _how_it_is_reached(self, "over_s", "over_m", "acceleration_mps2")
        if self.continuous and (self.of is None or self.shape != "step"):
            raise ValueError("continuous: expected of beside it, and shape step")
        if self.of is None and not 0.0 <= self.to_mps <= 100.0:
            raise ValueError(f"to_mps: expected 0 to 100, got {self.to_mps:g}")
        return self


class ProfilePoint(Table):
    """The end of one straight piece of a speed over time."""

    over_s: NotNegative = Field(description="time that the piece takes; 0: at once")
    speed_mps: Speed


class KeptDistance(Table):
    """A distance to another body that an actor takes up along its path, and keeps."""

    to: Name = Field(description="an actor's id or `ego`")
    gap_m: NotNegative | None = Field(default=None, description="between the nearest faces, or reference points")
    headway_s: NotNegative | None = Field(default=None, description="instead: gap over the actor's speed")
    freespace: bool = Field(default=True, description="between the nearest faces instead of reference points")
    side: Literal["ahead", "behind", "any"] = Field(
        description="of the other body, where the actor is; any: where it is as the action begins"
    )
    once: bool = Field(default=False, description="is over when the distance is reached, instead of keeping it")
    acceleration_mps2: Positive | None = Field(default=None, description="no more than this; left out: at once")
    deceleration_mps2: Positive | None = Field(default=None, description="no more than this")
    speed_limit_mps: Positive | None = Field(default=None, description="no faster than this while it does")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.gap_m is None) == (self.headway_s is None):
            raise ValueError("expected one of gap_m and headway_s")
        if (self.acceleration_mps2 is None) != (self.deceleration_mps2 is None):
            raise ValueError("expected both of acceleration_mps2 and deceleration_mps2, or none")
        return self


class Meeting(Table):
    """An arrival at a place when the ego arrives at one of its own, however fast that comes."""

    ego_at_m: Finite = Field(description="where the ego's rear axle is then, along its path")
    at_m: NotNegative = Field(description="where the actor's reference point is then, along the actor's path")
    speed_mps: Speed | None = Field(default=None, description="of the actor then; left out: any")
    relative_mps: Finite | None = Field(default=None, description="instead: of the actor then, more than the ego's")
    steady_m: NotNegative = Field(default=0.0, description="last part of the way, along which it has that speed")
    steady_s: NotNegative = Field(default=0.0, description="instead: last part of the time")

    @model_validator(mode="after")
    def _one_speed(self) -> Self:
        if self.speed_mps is not None and self.relative_mps is not None:
            raise ValueError("expected one of speed_mps and relative_mps")
        return self


class TimedPlace(Table):
    """Where on its path an actor is at a time; straight between such places."""

    time_s: Finite = Field(description="since the action began")
    at_m: NotNegative = Field(description="along the path of the action")


class LineChange(Table):
    """A change of the line that an actor moves along: another path, another distance beside it, or both."""

    path: Name | None = Field(default=None, description="from now on along this path, a name under routes/ or a file")
    at_m: NotNegative | None = Field(
        default=None, description="begins at this place of it; left out: where on it the actor is beside it"
    )
    from_here: bool = Field(default=False, description="the path is moved so that it begins at the actor, as it heads")
    until_m: NotNegative | None = Field(
        default=None, description="is over where the actor has come so far on the path; left out: at its `offset_m`"
    )
    offset_m: Finite = Field(default=0.0, description="distance beside the path that it ends at, left positive")
    shape: Shape = Field(default="step", description="of that distance over time or way")
    over_s: Positive | None = Field(default=None, description="time that it takes")
    over_m: Positive | None = Field(default=None, description="way that it takes")
    rate_mps: Positive | None = Field(default=None, description="greatest speed sidewards")
    timing: tuple[TimedPlace, ...] = Field(default=(), strict=False, description="when the actor is where on the path")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        _how_it_is_reached(self, "over_s", "over_m", "rate_mps")
        if self.path is None and (self.at_m is not None or self.from_here or self.timing or self.until_m is not None):
            raise ValueError("at_m, from_here, until_m and timing are about another path, expected path beside them")
        if any(later.time_s <= one.time_s or later.at_m < one.at_m for one, later in pairwise(self.timing)):
            raise ValueError("timing: expected later times at places that are no farther back")
        return self


class StoryAction(Table):
    """What an actor does once a trigger fires. A change of speed takes the place of the one before, a change of line
    likewise; the actor keeps the speed and the distance beside its line that it has at the end of an action.
    """

    name: ActionName = Field(description="each once an actor")
    armed: Groups = Field(
        default=(), strict=False, description="a trigger that has to fire before `when` is looked at: that of an act"
    )
    when: Groups = Field(
        default=(), strict=False, description="the trigger: groups of conditions, of one of which all have to hold"
    )
    until: Groups = Field(
        default=(),
        strict=False,
        description="a trigger that ends it, and after which it does not begin; looked at from the start on",
    )
    times: int = Field(default=1, ge=1, le=1000, description="how often it is done: once it is over it waits again")
    ends: tuple[Name, ...] = Field(
        default=(), strict=False, description="actions, each ACTOR.NAME, that are over once this one begins"
    )
    speed: SpeedAction | None = Field(default=None, description="changes its speed")
    profile: tuple[ProfilePoint, ...] = Field(default=(), strict=False, description="changes its speed piece by piece")
    keeps: KeptDistance | None = Field(default=None, description="takes up a distance to another body")
    meets: Meeting | None = Field(default=None, description="arrives when the ego arrives")
    line: LineChange | None = Field(default=None, description="changes the line that it moves along")
    leaves: bool = Field(default=False, description="is taken off the virtual road, for good")

    @model_validator(mode="after")
    def _one_speed(self) -> Self:
        stated = [key for key in ("speed", "profile", "keeps", "meets") if getattr(self, key)]
        if len(stated) > 1:
            raise ValueError(f"expected one of speed, profile, keeps and meets, got {' and '.join(stated)}")
        return self


class Story(Table):
    """An actor's actions, each of which has a trigger of its own, instead of `events`."""

    reference_m: Finite = Field(
        default=0.0,
        description="from the reference point forward to the centre; at_m, offsets, ways and distances are of the "
        "reference point, which OpenSCENARIO has at the rear axle",
    )
    actions: tuple[StoryAction, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        names = [action.name for action in self.actions]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"action {twice!r} stands twice, expected each name once")
        return self
