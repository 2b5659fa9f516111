"""Generates the runs of a sweep on demand: values, seed and key of each.

Knows designs and numbers; neither the meaning of scenarios nor the results. No list of all cells is kept in memory,
except the points of a Latin hypercube, which are drawn together.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.scenario.overrides import Value
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sweep.axes import Axis, NumberRange
from vve_sumo.sweep.controllers import combinations
from vve_sumo.sweep.spec import MAX_SEED, SAMPLED, Spec, WorstCase

#: points that are drawn at a time; a power of two, for Sobol's sequence
CHUNK = 4096


class RunSpec(NamedTuple):
    """One run of a sweep."""

    number: int  #: in the order of the design, from 0; seeds vary fastest
    key: str  #: the same in every sweep that drives the same
    values: dict[str, Value]  #: of every parameter, and of the controller's name and tuning where these are varied
    seed: int


def key_of(name: str, values: Mapping[str, Value], seed: int) -> str:
    """Return the key of a run of the scenario `name`: 16 hexadecimal digits, equal for 1 and 1.0."""
    plain = {place: _plain(value) for place, value in values.items()}
    text = json.dumps([name, plain, seed], sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain(value: Value) -> Value:
    return int(value) if isinstance(value, float) and value.is_integer() else value


@dataclass(frozen=True, slots=True)
class RunSpecs:
    """All the runs of a sweep."""

    spec: Spec
    name: str  #: of the scenario
    seeds: tuple[int, ...] | range

    @property
    def points(self) -> int:
        """Number of combinations of values; for a search, the largest number that it may drive."""
        return self._points * (sum(one.count for one in self.spec.controllers) if self.spec.controllers else 1)

    @property
    def _points(self) -> int:
        """Number of points of the design; each is driven with every controller."""
        if isinstance(self.spec.search, WorstCase):
            return self.spec.search.points
        if self.spec.samples is not None:
            return self.spec.samples
        counts = [axis.count for axis in self.spec.parameters.values() if not isinstance(axis, NumberRange)]
        return (counts or [1])[0] if self.spec.design == "list" else math.prod(counts)

    @property
    def count(self) -> int:
        """Number of runs."""
        return self.points * len(self.seeds)

    def __iter__(self) -> Iterator[RunSpec]:
        return self.unless(lambda number: False)

    def unless(self, finished: Callable[[int], bool]) -> Iterator[RunSpec]:
        """Return every cell whose number is not finished, in order."""
        numbers = itertools.count()
        for controller in combinations(self.spec.controllers):
            for point in self.design():
                values = {**controller, **point}
                for seed in self.seeds:
                    if not finished(number := next(numbers)):
                        yield RunSpec(number, key_of(self.name, values, seed), values, seed)

    def design(self) -> Iterator[dict[str, Value]]:
        """Yield the points of the design: the parameters' values, without the controllers."""
        names, axes = tuple(self.spec.parameters), tuple(self.spec.parameters.values())
        if self.spec.design in SAMPLED:
            return (
                {name: drawn(axis, share) for name, axis, share in zip(names, axes, point, strict=True)}
                for point in shares(self.spec.design, len(axes), self._points, self.spec.design_seed)
            )
        return (
            {name: _listed(axis, at) for name, axis, at in zip(names, axes, self._places(point), strict=True)}
            for point in range(self._points)
        )

    def _places(self, point: int) -> tuple[int, ...]:
        """Return which value of each axis a point of a grid or a list takes; the last axis of a grid goes fastest."""
        if self.spec.design == "list":
            return (point,) * len(self.spec.parameters)
        places = []
        for axis in reversed(tuple(self.spec.parameters.values())):
            point, place = divmod(point, 1 if isinstance(axis, NumberRange) else axis.count)
            places.append(place)
        return tuple(reversed(places))


def _listed(axis: Axis, place: int) -> Value:
    if isinstance(axis, NumberRange):
        raise TypeError("a range has no values to count")
    return axis[place]


def drawn(axis: Axis, share: float) -> Value:
    """Return the value at a share of an axis, 0 to 1."""
    if isinstance(axis, NumberRange):
        return axis.at(share)
    return axis[min(int(share * axis.count), axis.count - 1)]


def shares(design: str, dimensions: int, count: int, seed: int) -> Iterator[tuple[float, ...]]:
    """Return the points of a drawn design in the unit cube, the same for the same seed."""
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    if design == "latin_hypercube":
        rows: Iterator[list[float]] = iter(qmc.LatinHypercube(dimensions, seed=rng).random(count).tolist())
    elif design == "sobol":
        sequence = qmc.Sobol(dimensions, seed=rng)
        rows = (row for _ in itertools.count() for row in sequence.random(CHUNK).tolist())
    else:
        rows = (row for _ in itertools.count() for row in rng.random((CHUNK, dimensions)).tolist())
    return (tuple(row) for row in itertools.islice(rows, count))


def cells_of(spec: Spec, name: str, scenario: Scenario) -> RunSpecs:
    """Return the runs of a sweep over the scenario `name`; raises ConfigError where a seed would exceed MAX_SEED."""
    if not isinstance(spec.seeds, int):
        return RunSpecs(spec, name, spec.seeds)
    if scenario.seed + spec.seeds - 1 > MAX_SEED:
        raise ConfigError(f"seeds: {spec.seeds} seeds from the scenario's {scenario.seed} go beyond {MAX_SEED}")
    return RunSpecs(spec, name, range(scenario.seed, scenario.seed + spec.seeds))
