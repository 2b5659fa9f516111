"""An adaptive search: which runs it requests next, given the rows of the earlier ones; and its result.

Knows specs, cells and rows; drives nothing. The requests depend on the rows alone, never on their order of arrival, so
that a search that continues after a kill requests the same runs under the same numbers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.metrics.contacts import BEYOND, at_contact
from vve_sumo.scenario.overrides import Value
from vve_sumo.sweep import boundary, worst
from vve_sumo.sweep.axes import Axis, NumberRange, Steps
from vve_sumo.sweep.controllers import combinations
from vve_sumo.sweep.run_specs import RunSpec, RunSpecs, drawn, key_of
from vve_sumo.sweep.spec import Boundary, Spec, WorstCase

Row = Mapping[str, Any]
SearchResult = dict[str, Any]  #: content of `search.json`


class SearchPoint(NamedTuple):
    """A requested run."""

    values: dict[str, Value]
    seed: int


class RunRequest(NamedTuple):
    """The next requests of a search, and its progress as text."""

    points: list[SearchPoint]
    status: str


Strategy = Generator[RunRequest, list[Row], SearchResult]


def min_runs(cells: RunSpecs) -> int:
    """Return the number of runs of a sweep, or the least number of a search for boundaries."""
    search = cells.spec.search
    if not isinstance(search, Boundary):
        return cells.count
    count = _along(cells.spec, search).count
    return cells.count // count * min(search.scan, count)


def strategy_of(cells: RunSpecs) -> Strategy:
    """Return the strategy of a spec's search."""
    search = cells.spec.search
    assert search is not None
    return _boundary(cells, search) if isinstance(search, Boundary) else _worst(cells, search)


class AdaptiveSearch:
    """A running search: yields the cells to drive and takes their rows."""

    def __init__(self, cells: RunSpecs, finished_rows: Mapping[int, Row], folder: object) -> None:
        """`finished_rows`: rows of finished runs, by number; `folder` is named in errors."""
        self._strategy, self._name = strategy_of(cells), cells.name
        self._finished_rows, self._folder = finished_rows, folder
        self._rows: dict[str, Row] = {}
        self._requested: dict[str, RunSpec] = {}
        self._missing: set[str] = set()
        self.status = "starting"  #: progress as text
        self.result: SearchResult | None = None  #: once it has ended

    @property
    def runs(self) -> int:
        """Number of different requested runs."""
        return len(self._requested)

    def cells(self) -> Iterator[RunSpec | None]:
        """Yield every cell to drive; None while the next request waits for rows."""
        try:
            queries = next(self._strategy)
            while True:
                self.status = queries.status
                cells = [self._cell(point) for point in queries.points]
                yield from (cell for key, cell in {one.key: one for one in cells}.items() if key in self._missing)
                while self._missing:
                    yield None
                queries = self._strategy.send([self._rows[cell.key] for cell in cells])
        except StopIteration as end:
            self.result = end.value

    def take(self, row: Row) -> None:
        """Take the row of a run."""
        self._rows[row["key"]] = row
        self._missing.discard(row["key"])

    def _cell(self, point: SearchPoint) -> RunSpec:
        """Return the cell of a point: one that was requested before, one that was driven, or a new one."""
        key = key_of(self._name, *point)
        if key in self._requested:
            return self._requested[key]
        cell = self._requested[key] = RunSpec(len(self._requested), key, *point)
        row = self._finished_rows.get(cell.number)
        if row is None:
            self._missing.add(key)
        elif row["key"] != key:
            raise ConfigError(f"{self._folder}: run {cell.number} is not the run that this search requests: was it "
                              "begun with another Optuna? choose another --out")  # fmt: skip
        else:
            self.take(row)
        return cell


def _boundary(cells: RunSpecs, search: Boundary) -> Strategy:
    axis, others = _along(cells.spec, search), _others(cells.spec, search)
    lines = [(values, seed) for values in others for seed in cells.seeds]

    def point(query: boundary.VerdictQuery) -> SearchPoint:
        values, seed = lines[query.row]
        along = values | {search.along: axis[query.place]}
        return SearchPoint({name: along[name] for name in cells.spec.varied if name in along}, seed)

    rows: dict[boundary.VerdictQuery, Row] = {}
    known: list[dict[int, bool]] = [{} for _ in lines]
    queries = boundary.first(len(lines), axis.count, search.scan)
    while queries:
        answers = yield RunRequest(list(map(point, queries)), _brackets(axis, known))
        for query, row in zip(queries, answers, strict=True):
            rows[query], known[query.row][query.place] = row, met(row, search.criterion)
        queries = boundary.closer(known, search.batch)
    return _boundaries(cells, search, others, known, rows)


def _brackets(axis: Steps, known: Sequence[boundary.Known]) -> str:
    if not any(known):
        return "scanning"
    open_ones = [high - low for _row, low, high in boundary.unsettled(known)]
    return f"{len(open_ones)} bracket{'s' * (len(open_ones) > 1)}, the widest {float(max(open_ones) * axis.step):g}"


def met(row: Row, criterion: str) -> bool:
    """Return whether a run is known to have met a criterion; one with an error is not."""
    if criterion == "passed":
        return row["passed"] is True
    stated: bool | None = row.get(f"meets_{criterion}")
    return stated is True if f"meets_{criterion}" in row else row[criterion] is False


def _boundaries(
    cells: RunSpecs,
    search: Boundary,
    others: Sequence[dict[str, Value]],
    known: Sequence[boundary.Known],
    rows: Mapping[boundary.VerdictQuery, Row],
) -> SearchResult:
    """Return the result of a finished search for boundaries."""
    axis, repeats = _along(cells.spec, search), len(cells.seeds)
    lines = []
    for number, values in enumerate(others):
        seeds = range(number * repeats, (number + 1) * repeats)
        alone = []
        for seed, row in zip(cells.seeds, seeds, strict=True):
            flips = [_flip(axis, flip, row, rows) for flip in boundary.flips_of(known[row])]
            alone.append({"seed": seed, "meets_first": known[row][0], "flips": flips})
        together = [known[row] for row in seeds]
        flips = [_ends(axis, flip) for flip in boundary.pooled(together)]
        first = 2 * sum(one[0] for one in together) > repeats
        lines.append({"values": values, "meets_first": first, "flips": flips, "seeds": alone})
    errors = sum(bool(row["error"]) for row in rows.values())
    definition = {"along": search.along, "criterion": search.criterion, "step": float(axis.step)}
    return {"search": "boundary", **definition, "runs": len(rows), "errors": errors, "boundaries": lines}


def _ends(axis: Steps, flip: boundary.Flip) -> SearchResult:
    good, bad = (flip.below, flip.above) if flip.good_below else (flip.above, flip.below)
    return {"meets": axis[good], "fails": axis[bad]}


def _flip(axis: Steps, flip: boundary.Flip, row: int, rows: Mapping[boundary.VerdictQuery, Row]) -> SearchResult:
    good, bad = (flip.below, flip.above) if flip.good_below else (flip.above, flip.below)
    there, beyond = rows[boundary.VerdictQuery(row, good)], rows[boundary.VerdictQuery(row, bad)]
    why = beyond["error"] or beyond["failed"]
    return _ends(axis, flip) | {"key_meets": there["key"], "key_fails": beyond["key"], "why": why}


def _along(spec: Spec, search: Boundary) -> Steps:
    axis = spec.parameters[search.along]
    assert isinstance(axis, Steps)
    return axis


def _others(spec: Spec, search: Boundary) -> list[dict[str, Value]]:
    """Return every combination of the values of the other parameters; the last varies fastest.

    If controllers are varied, each combination occurs once for every controller and every combination of its tuning.
    """
    names = [name for name in spec.parameters if name != search.along]
    values = list(itertools.product(*(_every(spec.parameters[name]) for name in names)))
    every = itertools.product(combinations(spec.controllers), values)
    return [{**controller, **dict(zip(names, one, strict=True))} for controller, one in every]


def _every(axis: Axis) -> Iterator[Value]:
    assert not isinstance(axis, NumberRange)
    return (axis[number] for number in range(axis.count))


def _worst(cells: RunSpecs, search: WorstCase) -> Strategy:
    axes, sign = cells.spec.parameters, 1.0 if search.highest is None else -1.0
    every: dict[str, Row] = {}
    choosing = worst.search(len(axes), search.points, search.batch, cells.spec.design_seed)
    shares = next(choosing)
    while True:
        chosen = [{name: drawn(axis, at) for (name, axis), at in zip(axes.items(), one, strict=True)} for one in shares]
        best = min((_cost(row, search.metric, sign) for row in every.values()), default=math.inf)
        so_far = f"{search.metric} {sign * best:.3g} so far" if best < math.inf else "starting"
        rows = yield RunRequest([SearchPoint(values, seed) for values in chosen for seed in cells.seeds], so_far)
        every.update((row["key"], row) for row in rows)
        costs = [_cost(row, search.metric, sign) for row in rows]
        repeats = len(cells.seeds)
        try:
            shares = choosing.send([min(costs[at : at + repeats]) for at in range(0, len(costs), repeats)])
        except StopIteration:
            return _case(cells, search, sign, list(every.values()))


def _cost(row: Row, metric: str, sign: float) -> float:
    """Return the cost to minimize; infinite for a run that has neither the metric nor a contact.

    A contact is worse than every gap, time to collision and DRAC; among contacts the harder impact is worse.
    """
    value = row[metric]
    if metric in BEYOND and row.get("collision"):
        impact = math.copysign(float(row.get("impact_speed_mps") or 0.0), BEYOND[metric])
        return sign * (at_contact(metric) + impact)
    return math.inf if value is None else sign * float(value)


def _case(cells: RunSpecs, search: WorstCase, sign: float, rows: list[Row]) -> SearchResult:
    """Return the result of a finished search for the worst case."""
    least = min(rows, key=lambda row: _cost(row, search.metric, sign))
    with_it = [row for row in rows if _cost(row, search.metric, sign) < math.inf]
    case = None
    if with_it:
        values = {name: least[name] for name in cells.spec.parameters}
        columns = ("outcome", "collision", "impact_speed_mps", "passed", "failed")
        why = {name: least.get(name) for name in columns}
        case = {
            "values": values,
            "seed": least["seed"],
            **why,
            search.metric: least[search.metric],
            "key": least["key"],
        }
    goal = "highest" if search.highest else "lowest"
    counts = {"runs": len(rows), "without": len(rows) - len(with_it), "errors": sum(bool(row["error"]) for row in rows)}
    return {"search": "worst", goal: search.metric, **counts, "worst": case}
