"""What the analysis reads of the JSON files of a record and a sweep, held against its shape when they are opened.

Knows keys and kinds alone. What else such files hold is let be, so that those of another version can be read as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, create_model, model_validator

from vve_sumo.config_file import Finite, Positive, complaint
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.sensors.port import ColumnKind
from vve_sumo.sensors.radar_settings import RadarSettings
from vve_sumo.values import Vehicle


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("expected a text")
    return value


def _point(value: object) -> object:
    try:
        numbers = [float(part) for part in str(value).split()]
    except ValueError:
        numbers = []
    if not (isinstance(value, str) and len(numbers) == 2 and all(map(math.isfinite, numbers))):
        raise ValueError("expected two numbers in quotes")
    return value


#: any text, also one that is no Unicode
Text = Annotated[str, PlainValidator(_text)]
Point = Annotated[str, PlainValidator(_point)]


class JsonModel(BaseModel):
    """A part of a file: unknown keys are let be, nothing is coerced."""

    model_config = ConfigDict(extra="ignore", strict=True)


class _Band(JsonModel):
    min: Finite | None = None
    max: Finite | None = None


class _Parameter(JsonModel):
    sets: Annotated[tuple[Text, ...], Field(min_length=1, strict=False)]
    meaning: Text = ""


class _Road(JsonModel):
    network: Text = ""


class _Ego(JsonModel):
    speed_mps: Finite


class _Control(JsonModel):
    name: Text = ""


class _Asked(JsonModel):
    road: _Road | None = None
    ego: _Ego | None = None
    metrics: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    criteria: dict[str, bool | Text | _Band | None] = Field(default={})
    parameters: dict[str, _Parameter] = Field(default={})


class _Scenario(_Asked):
    """What a sweep keeps of its scenario: what the file says, and no more."""

    title: Text = ""
    controller: _Control | None = None


class _Controlled(JsonModel):
    name: Text


class _Obstacle(JsonModel):
    id: Text


class _Actor(JsonModel):
    id: Text
    kind: Text


class _FurtherEgo(JsonModel):
    id: Text
    obstacles: Annotated[tuple[Text, ...], Field(strict=False)]
    actors: Annotated[tuple[Text, ...], Field(strict=False)]
    egos: Annotated[tuple[Text, ...], Field(strict=False)]


class _Sensor(JsonModel):
    name: Text
    kind: Text
    settings: dict[str, Any] = {}


class _Settings(_Asked):
    """What a record keeps of it: all of it."""

    title: Text
    seed: int
    controller: _Controlled
    radar: RadarSettings
    obstacles: Annotated[tuple[_Obstacle, ...], Field(strict=False)] = ()
    actors: Annotated[tuple[_Actor, ...], Field(strict=False)] = ()
    sensors: Annotated[tuple[_Sensor, ...], Field(strict=False)] = ()


class _Latency(JsonModel):
    budget_ms: Finite | None = None


class _Rig(JsonModel):
    latency: _Latency | None = None


#: all that is declared of a car
_Car: Any = create_model("_Car", __base__=JsonModel, **{field.name: (Finite, ...) for field in fields(Vehicle)})  # type: ignore[call-overload]


#: name, kind and meaning of each column of a sensor's table
_Columns = Annotated[
    tuple[Annotated[tuple[Text, ColumnKind, Text], Field(strict=False)], ...], Field(strict=False, min_length=1)
]


class _Fault(JsonModel):
    kind: Text


class RecordModel(JsonModel):
    """What `scenario.json` says of a drive."""

    scenario: Text
    period_s: Positive
    path_m: Annotated[tuple[Point, ...], Field(min_length=2, strict=False)]
    vehicle: _Car
    files_sha256: dict[str, Text]
    versions: dict[str, Text]
    settings: _Settings
    sensors: dict[str, _Columns]
    drawings: dict[str, dict[str, Any]] = {}
    rig: _Rig | None = None
    faults: Annotated[tuple[_Fault, ...], Field(strict=False)] = ()
    further_ego: _FurtherEgo | None = None


class _Code(JsonModel):
    sha256: Text = ""
    git_commit: Text | None = None
    git_dirty: bool | None = None


class _Host(JsonModel):
    name: Text = ""
    kernel: Text = ""
    machine: Text = ""


class _Doctor(JsonModel):
    verdict: Text = "none"
    date_utc: Text = ""
    caveats: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    override: Text | None = None


class Provenance(JsonModel):
    """What `provenance.json` says; the last three keys of a live drive alone."""

    code: _Code = _Code()
    host: _Host = _Host()
    python: Text = ""
    began_utc: Text = ""
    operator: Text | None = None
    driver: Text | None = None
    doctor: _Doctor | None = None


_TYPES = {"float": float, "int": int, "bool": bool, "str": str}


def _figures(metrics: Mapping[str, Metric]) -> dict[str, Any]:
    """Return the fields of what was measured of a drive; null where it held nothing to measure."""
    return {name: (_TYPES[metric.kind] | None, None) for name, metric in metrics.items()}


_Figures: Any = create_model("_Figures", __base__=JsonModel, **_figures(PER_DRIVE))


class _EgoVerdict(JsonModel):
    outcome: Text
    passed: bool | None = None
    failed: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    record_sha256: Text = ""


class SummaryModel(_Figures):  # type: ignore[misc]
    """What `summary.json` says; of a live drive whose program was killed the figures are not there."""

    outcome: Text
    reasons: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    text: Text = ""
    passed: bool | None = None
    failed: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    record_sha256: Text = ""
    record_parts_sha256: dict[str, Text] = Field(default={})
    record_files_sha256: dict[str, Text] = Field(default={})
    metric_errors: dict[str, Text] = Field(default={})
    egos: dict[str, _EgoVerdict] = Field(default={})


def summary_model(own: Mapping[str, Metric]) -> type[JsonModel]:
    """Return what `summary.json` says of a drive of which metrics of a user's were measured, too."""
    made: type[JsonModel] = create_model("SummaryModel", __base__=SummaryModel, **_figures(own))
    return made if own else SummaryModel


class _Along(JsonModel):
    along: Text
    criterion: Text = ""


class _Lowest(JsonModel):
    lowest: Text


class _Highest(JsonModel):
    highest: Text


class _Spec(JsonModel):
    seeds: int | Annotated[tuple[int, ...], Field(strict=False)] = 1
    parameters: dict[str, Any] = Field(default={})
    search: _Along | _Lowest | _Highest | None = None


class SweepModel(JsonModel):
    """What `sweep.json` says beside what its rows are read by."""

    spec: _Spec
    table: _Scenario
    files_sha256: dict[str, Annotated[tuple[Text, ...], Field(strict=False)]]
    versions: dict[str, Text]


class _Flip(JsonModel):
    meets: Finite
    fails: Finite


class _OwnFlip(_Flip):
    key_fails: Text


class _Seed(JsonModel):
    flips: Annotated[tuple[_OwnFlip, ...], Field(strict=False)]


class _Line(JsonModel):
    values: dict[str, Any]
    meets_first: bool | None
    flips: Annotated[tuple[_Flip, ...], Field(strict=False)]
    seeds: Annotated[tuple[_Seed, ...], Field(strict=False)]


class Boundaries(JsonModel):
    """What `search.json` says of a search along a parameter."""

    search: Literal["boundary"]
    along: Text
    criterion: Text
    boundaries: Annotated[tuple[_Line, ...], Field(strict=False)]


class _Case(JsonModel):
    model_config = ConfigDict(extra="allow")

    values: dict[str, Any]
    seed: int
    outcome: Text | None
    passed: bool | None
    failed: Text | None
    key: Text


class SearchModel(JsonModel):
    """What `search.json` says of a search for the worst case."""

    search: Literal["worst"]
    lowest: Text | None = None
    highest: Text | None = None
    worst: _Case | None

    @model_validator(mode="after")
    def _sought(self) -> Self:
        figure = self.highest or self.lowest
        if figure is None or (self.worst is not None and figure not in (self.worst.model_extra or {})):
            raise ValueError("expected lowest or highest, and that figure of the worst case")
        return self


def check(data: object, model: type[JsonModel], file: Path) -> None:
    """Raise ConfigError in one line, naming the key, where a file's content has not the shape of a model."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        raise ConfigError(complaint(file, error, model)) from None
