"""The schema of a sweep's file, and the checks of a sweep against its scenario.

Knows keys, counts and names; nothing of drives, processes or datasets.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, PlainValidator, Tag, ValidationError, model_validator

from vve_sumo.config_file import Name, Positive, Table, complaint
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import Kind
from vve_sumo.scenario.overrides import check_bounds, numbered, places, refuse_unknown
from vve_sumo.sweep.axes import Axis, Choice, NumberRange, Steps, axes, flattened
from vve_sumo.sweep.controllers import VariedController, columns, compared

#: designs that draw `samples` points; the others take every value that is listed
SAMPLED = ("latin_hypercube", "sobol", "random")

MAX_SEED = 2**31 - 1
KEY = re.compile("[0-9a-f]{16}")

Keep = Literal["none", "failed", "all"] | tuple[str, ...]


def _seeds(entry: object) -> int | tuple[int, ...]:
    if isinstance(entry, int) and not isinstance(entry, bool) and 1 <= entry <= MAX_SEED:
        return entry
    if not isinstance(entry, (list, tuple)) or not entry:
        raise ValueError("expected how many, 1 or more, or a list of seeds")
    if not all(type(seed) is int and 0 <= seed <= MAX_SEED for seed in entry):
        raise ValueError(f"expected seeds from 0 to {MAX_SEED}")
    if len(set(entry)) < len(entry):
        raise ValueError("expected each seed once")
    return tuple(entry)


def parse_keep(entry: object) -> Keep:
    """Return which records are kept; raises ValueError for another value."""
    if entry == "none" or entry == "failed" or entry == "all":
        return entry
    if isinstance(entry, (list, tuple)) and entry and all(KEY.fullmatch(str(key)) for key in entry):
        return tuple(entry)
    raise ValueError("expected 'none', 'failed', 'all' or a list of runs' keys of 16 digits")


class Boundary(Table):
    """Where, along one parameter, a criterion flips: for every combination of the others, and every seed."""

    along: Name = Field(description="of [parameters], { from, to, step }: the flip is found to one step")
    criterion: Name = Field(default="passed", description="passed, collision or a criterion that the scenario states")
    scan: Annotated[int, Field(ge=2)] = Field(
        default=5, description="values that are driven first, evenly spread; two flips between neighbours are not found"
    )
    batch: Annotated[int, Field(ge=1)] = Field(
        default=4, description="least number of runs that are requested at a time"
    )


class WorstCase(Table):
    """The values of the parameters at which a metric is lowest or highest, over all seeds."""

    lowest: Name | None = Field(default=None, description="metric to minimize")
    highest: Name | None = Field(default=None, description="metric to maximize")
    points: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=160, description="combinations of values that are tried"
    )
    batch: Annotated[int, Field(ge=1)] = Field(default=8, description="combinations that are chosen at a time")

    @model_validator(mode="after")
    def _one_metric(self) -> Self:
        if (self.lowest is None) == (self.highest is None):
            raise ValueError("expected one of lowest and highest (or along, for a boundary)")
        return self

    @property
    def metric(self) -> str:
        """The metric to minimize or maximize."""
        return self.lowest or self.highest or ""


def _kind_of_search(entry: object) -> str:
    """Return the kind of a search's table: boundary along a parameter, or worst case."""
    return "boundary" if isinstance(entry, dict) and {"along", "criterion"} & entry.keys() else "worst"


Search = Annotated[
    Annotated[Boundary, Tag("boundary")] | Annotated[WorstCase, Tag("worst")], Discriminator(_kind_of_search)
]


class Spec(Table):
    """A sweep: one scenario, its varied parameters, and the number of drives of each point."""

    title: str = ""
    scenario: Name = Field(description="a name under scenarios/ or a file")
    design: Literal["grid", "list", "latin_hypercube", "sobol", "random"] = Field(
        default="grid",
        description="grid: every value with every other; list: the lists side by side; else drawn points",
    )
    samples: Annotated[int, Field(ge=1, le=2**30)] | None = Field(
        default=None, description="how many points a drawn design has"
    )
    design_seed: Annotated[int, Field(ge=0)] = Field(default=1, description="seed of a drawn design")
    seeds: Annotated[int | tuple[int, ...], PlainValidator(_seeds)] = Field(
        default=1, description="how often each point is driven, from the scenario's seed on; or a list of seeds"
    )
    keep: Annotated[Keep, PlainValidator(parse_keep)] = Field(
        default="none", description="whose full records are kept: none, failed, all, or a list of runs' keys"
    )
    time_limit_s: Positive = Field(default=3600.0, description="wall time that a run may take")
    memory_limit_mb: Positive = Field(default=4096.0, description="memory that a run may take, in 10^6 bytes")
    parameters: Annotated[Mapping[str, Axis], PlainValidator(axes)] = Field(
        default={}, description="what is varied: dotted keys of the scenario, or parameters that it declares"
    )
    controllers: Annotated[tuple[VariedController, ...], AfterValidator(compared)] = Field(
        default=(), strict=False, description="controllers to compare: every point is driven with each of them"
    )
    metrics: tuple[Name, ...] = Field(
        default=(),
        strict=False,
        description="metrics of every run in addition to the shipped ones and those of the scenario's `metrics`",
    )
    search: Search | None = Field(default=None, description="adaptive search, instead of driving every combination")

    @model_validator(mode="after")
    def _check_design(self) -> Self:
        if self.search is not None:
            self._check_search(self.search)
        elif self.design in SAMPLED:
            self._check_drawn()
        else:
            self._check_listed()
        self._check_distinct()
        return self

    def _check_search(self, search: Search) -> None:
        if {"design", "samples"} & self.model_fields_set:
            raise ValueError("design, samples: a search chooses its runs itself, leave them out")
        if isinstance(search, Boundary):
            if not isinstance(self.parameters.get(search.along), Steps):
                raise ValueError(f"search.along: expected a parameter with {{ from, to, step }}, got {search.along!r}")
            self._check_listed()
        elif self.controllers:
            raise ValueError("controllers: a search for the worst case takes one, expected it in the scenario")
        elif not any(isinstance(axis, NumberRange) for axis in self.parameters.values()):
            raise ValueError("search: expected a parameter with { min, max } to choose from")

    def _check_drawn(self) -> None:
        if self.samples is None:
            raise ValueError(f"design {self.design}: key 'samples' is missing")
        if not any(isinstance(axis, NumberRange) for axis in self.parameters.values()):
            raise ValueError(f"design {self.design}: expected a parameter with {{ min, max }} to draw from")

    def _check_listed(self) -> None:
        if self.samples is not None:
            raise ValueError(f"design {self.design}: samples: goes with {', '.join(SAMPLED)}")
        if not self.parameters and not self.controllers and self.repeats < 2:
            raise ValueError(f"an empty {self.design}: nothing is varied, expected [parameters] or seeds")
        for key, axis in self.parameters.items():
            if isinstance(axis, NumberRange):
                raise ValueError(f"parameters.{key}: min and max go with design {', '.join(SAMPLED)}")
        counts = {key: axis.count for key, axis in self.parameters.items() if not isinstance(axis, NumberRange)}
        if self.design == "list" and len(set(counts.values())) > 1:
            raise ValueError(f"design list: expected lists of one length, got {_counts_text(counts)}")

    def _check_distinct(self) -> None:
        """Refuse duplicate points; steps and drawn numbers have none."""
        choices = {key: axis.values for key, axis in self.parameters.items() if isinstance(axis, Choice)}
        if self.design == "list":
            rows = list(zip(*choices.values(), strict=True))
            if len(choices) == len(self.parameters) and len(set(rows)) < len(rows):
                raise ValueError(f"design list: row {_twice(rows)} occurs twice, expected each once")
            return
        for key, values in choices.items():
            if len(set(values)) < len(values):
                raise ValueError(f"parameters.{key}: {_twice(values)} occurs twice, expected each value once")

    @property
    def varied(self) -> dict[str, Kind]:
        """Name and type of the columns that identify a point: those of the controllers, and the parameters."""
        return {**columns(self.controllers), **{name: axis.kind for name, axis in self.parameters.items()}}

    @property
    def repeats(self) -> int:
        """Number of drives of each point."""
        return self.seeds if isinstance(self.seeds, int) else len(self.seeds)


def _twice(values: Sequence[object]) -> str:
    return repr(next(value for at, value in enumerate(values) if value in values[:at]))


def _counts_text(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{key} {count}" for key, count in counts.items())


def parse_spec(table: Mapping[str, Any], file: Path) -> Spec:
    """Return the spec of a parsed table; raises ConfigError, naming `file`, for a faulty one."""
    try:
        return Spec.model_validate(table)
    except ValidationError as error:
        raise ConfigError(complaint(file, error, Spec)) from None


def with_numbers(entry: Mapping[str, Any], file: Path, table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a sweep's table with numbers in place of quantities such as "25 mph" under `[parameters]`.

    `table` is the scenario's, whose keys state the units. Raises ConfigError for a unit that does not fit a key.
    """
    parameters = entry.get("parameters")
    if not isinstance(parameters, dict):
        return dict(entry)
    values_by_key: dict[str, Any] = {}
    try:
        for key, values in flattened(parameters):
            named, numbers = _numbers(key, values, table)
            if named in values_by_key:
                raise ConfigError(f"{named}: occurs twice, expected each key once")
            values_by_key[named] = numbers
    except ConfigError as error:
        raise ConfigError(f"{file}: parameters.{error}") from None
    except ValueError:
        return dict(entry)  # the schema refuses it
    return {**entry, "parameters": values_by_key}


def _numbers(key: str, values: object, table: Mapping[str, Any]) -> tuple[str, object]:
    """Return the name of a parameter and its values, with numbers for quantities; a declared one keeps its name."""
    place = places(table, key)[0]
    if not isinstance(values, (list, dict)):
        return key, values
    placed = [numbered(place, value) for value in (values.values() if isinstance(values, dict) else values)]
    numbers = [number for _place, number in placed]
    named = next((where for where, _number in placed if where != place), place) if place == key else key
    return named, dict(zip(values, numbers, strict=True)) if isinstance(values, dict) else numbers


def fit(spec: Spec, file: Path, table: Mapping[str, Any], taken: frozenset[str]) -> None:
    """Raise ConfigError, naming the spec's file and the key, unless its parameters fit a scenario's valid table.

    `taken`: names of columns that no parameter may have. Values are checked against the bounds that the scenario
    declares; the scenario's other checks follow when a run's values are applied.
    """
    setters = dict.fromkeys(columns(spec.controllers), "controllers")
    for name, axis in spec.parameters.items():
        key = f"{file}: parameters.{name}"
        refuse_unknown(key, name, table)
        for place in places(table, name):
            if place == "seed":
                raise ConfigError(f"{key}: seeds have a key of their own, expected seeds = [ … ]")
            if place in setters:
                raise ConfigError(f"{key}: sets {place}, which {setters[place]} sets too; expected one of them")
            setters[place] = name
        if name in taken:
            raise ConfigError(
                f"{key}: every row has a column of that name; declare the parameter under another name in the scenario"
            )
        check_bounds(key, axis.ends(), table.get("parameters", {}).get(name, {}))
