"""From a sweep's file to what its dataset begins with; whatever is wrong with it is found here, before anything runs.

Reads files and tries the outermost runs; drives nothing and writes nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vve_sumo import workspace
from vve_sumo.config_file import read, read_as
from vve_sumo.drive.plugged_in import CONTROLLER
from vve_sumo.drive.provenance import deciding
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.metrics.port import installed
from vve_sumo.metrics.table import enter
from vve_sumo.record.sweep_folder import COLUMNS, SweepPlan
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.overrides import Value, apply_overrides, choose, places
from vve_sumo.scenario.schema import Criteria, Scenario
from vve_sumo.sweep import worst
from vve_sumo.sweep.controllers import NAME, columns
from vve_sumo.sweep.job import Job
from vve_sumo.sweep.preflight import RunPreview, look
from vve_sumo.sweep.run_specs import RunSpec, RunSpecs, cells_of
from vve_sumo.sweep.search import least_runs
from vve_sumo.sweep.spec import Boundary, Spec, WorstCase, fit, parse_spec, with_numbers

#: runs that nobody starts by mistake
MAX_RUNS = 100_000
#: rows of a list that are tried before it is driven
TRIED = 32

Values = Mapping[str, Value]
Judge = Callable[[Sequence[Values]], list[RunPreview]]


@dataclass(frozen=True, slots=True)
class SweepQuery:
    """A sweep that was asked for, found to be in order."""

    spec: Spec
    plan: SweepPlan
    cells: RunSpecs
    notes: tuple[str, ...] = ()  #: what whoever asked should know before it is driven, a line each


def query_of(
    name: str,
    working: Path,
    *,
    yes: bool,
    search: bool = False,
    vehicle: str | None = None,
    rig: str | None = None,
) -> SweepQuery:
    """Return the sweep that a name or file says; `search` insists that it is one.

    `vehicle` replaces the scenario's; with a `rig`, the rig's car is simulated.

    Raises ConfigError, naming file and key, for whatever is wrong, and for very many runs unless `yes`.
    """
    file = workspace.find("sweep", name, working)
    return planned(read(file, "sweep"), file, working, yes=yes, search=search, vehicle=vehicle, rig=rig)


def planned(
    said: dict[str, Any],
    file: Path,
    working: Path,
    *,
    yes: bool,
    search: bool = False,
    vehicle: str | None = None,
    rig: str | None = None,
    scenario: tuple[Path, dict[str, Any]] | None = None,
) -> SweepQuery:
    """Return the sweep that a spec's table says, as `query_of` does; `file` is where it stands, or what to call it.

    `scenario` is the file and the table of the scenario, where it is another than the file says.
    """
    given = scenario
    if given is None and isinstance(said.get("scenario"), str) and said["scenario"]:
        given = _scenario(said["scenario"], file, working)
    if given is not None:
        said = with_numbers(said, file, given[1])
    spec = parse_spec(said, file)
    if search and spec.search is None:
        raise ConfigError(f"{file}: --search: expected a table [search] that says what to look for")
    scenario_file, table = given if given is not None else _scenario(spec.scenario, file, working)
    table = with_metrics(table, spec)
    settings = parse(table, scenario_file)
    if vehicle is not None:
        table = choose(table, vehicle=vehicle)
    rig_file = "" if rig is None else str(_rig(rig, vehicle, spec, table, file, working))
    criteria = _criteria(spec, settings, table)
    fit(spec, file, table, frozenset(COLUMNS) | {f"meets_{name}" for name in (*Criteria.model_fields, *criteria)})
    _refuse_varied_metrics(spec, table, file)
    cells = cells_of(spec, scenario_file.name.removesuffix(".toml"), settings)
    count = least_runs(cells)
    if count >= MAX_RUNS and not yes:
        raise ConfigError(f"{file}: {count:,} runs; --yes drives that many")
    plan = SweepPlan(
        spec=said,
        scenario=cells.name,
        table=table,
        file=str(scenario_file.absolute()),
        working=str(working.absolute()),
        cells=cells.count,
        parameters=spec.varied,
        criteria=criteria,
        files_sha256={},
        versions=deciding(),
        rig=rig_file,
    )
    if isinstance(spec.search, Boundary) or not settings.metrics:
        _sought(spec.search, plan, file)
    plan, notes = _looked_at(plan, spec, cells, file)
    enter(plan.own())
    _sought(spec.search, plan, file)
    _refuse_taken(plan, file)
    return SweepQuery(spec, plan, cells, notes)


def with_metrics(table: Mapping[str, Any], spec: Spec) -> dict[str, Any]:
    """Return a scenario's table with the metrics that a sweep adds: those it names, and an installed one it seeks."""
    named = table.get("metrics", [])
    if not isinstance(named, (list, tuple)):
        return dict(table)  # which the schema refuses in its own words
    sought = [spec.search.figure] if isinstance(spec.search, WorstCase) and spec.search.figure not in COLUMNS else []
    added = [*spec.metrics, *(name for name in sought if name in installed())]
    return {**table, "metrics": list(dict.fromkeys([*named, *added]))} if added else dict(table)


def _refuse_varied_metrics(spec: Spec, table: Mapping[str, Any], file: Path) -> None:
    """Raise ConfigError where a parameter varies which metrics are measured: all rows have the same columns."""
    for key in spec.parameters:
        if any(place.partition(".")[0] == "metrics" for place in places(table, key)):
            raise ConfigError(f"{file}: parameters.{key}: metrics are the same of every run, expected metrics = [ … ]")


def _refuse_taken(plan: SweepPlan, file: Path) -> None:
    """Raise ConfigError where a parameter has the name of a user's metric."""
    if taken := [name for name in plan.parameters if name in plan.own()]:
        raise ConfigError(
            f"{file}: parameters.{taken[0]}: a metric has that name; declare it in the scenario by another"
        )


def _rig(name: str, vehicle: str | None, spec: Spec, table: Mapping[str, Any], file: Path, working: Path) -> Path:
    """Return the rig's file; raises ConfigError where it cannot drive the sweep's runs."""
    found = rig_that_drives(name, vehicle, working)
    for key in spec.parameters:
        if "ego.vehicle" in places(table, key):
            raise ConfigError(f"{file}: parameters.{key}: a rig brings its own vehicle; leave out this or --rig")
    return found


def rig_that_drives(name: str, vehicle: str | None, working: Path) -> Path:
    """Return the file of the rig whose car is simulated in many runs.

    Raises ConfigError where another `vehicle` is named beside it, and for a rig that is wrong or has a foreign brain.
    """
    from vve_sumo.rig.load import load

    if vehicle is not None:
        raise ConfigError("--vehicle: a rig brings its own vehicle; leave out one of --vehicle and --rig")
    file = workspace.find("rig", name, working).absolute()
    brain = load(file, working).brain.kind
    if brain != "own":
        raise ConfigError(f"--rig: brain.kind of {file} is {brain!r}, expected 'own': no foreign brain is waited for")
    return file


def _scenario(name: str, file: Path, working: Path) -> tuple[Path, dict[str, Any]]:
    try:
        found = workspace.find("scenario", name, working, beside=file.parent)
    except ConfigError as error:
        raise ConfigError(f"{file}: scenario: {error}") from None
    return found, read_as(found, "scenario", Scenario)


def job_of(plan: SweepPlan, spec: Spec, cell: RunSpec, keep: Path | None) -> Job:
    """Return what a cell's run needs."""
    return Job(
        key=cell.key,
        name=plan.scenario,
        table=_table(plan, cell.values) | {"seed": cell.seed},
        file=Path(plan.file),
        working=Path(plan.working),
        keep=keep,
        rig=Path(plan.rig) if plan.rig else None,
        time_limit_s=spec.time_limit_s,
        memory_limit_mb=spec.memory_limit_mb,
    )


def _table(plan: SweepPlan, values: Values) -> dict[str, Any]:
    """Return a run's scenario; the tuning in the scenario's file goes to the controller that the file names alone."""
    name = str(values[NAME]) if plan.spec.get("controllers") and NAME in values else None
    return apply_overrides(choose(plan.table, controller=name), values)


def _sought(search: Boundary | WorstCase | None, plan: SweepPlan, file: Path) -> None:
    """Raise ConfigError where a search looks for what no row says, or what it needs is not installed."""
    if isinstance(search, Boundary):
        known = dict.fromkeys(["passed", "collision", *plan.criteria])
        if search.criterion not in known:
            raise ConfigError(f"{file}: search.criterion: expected {', '.join(known)}, got {search.criterion!r}")
    elif search is not None:
        if search.figure not in (numbers := plan.numbers()):
            goal = "highest" if search.highest else "lowest"
            near = did_you_mean(search.figure, numbers)
            said = f"got {search.figure!r}{f', {near}' if near else ''}"
            raise ConfigError(f"{file}: search.{goal}: expected {', '.join(numbers)}, {said}")
        worst.need()


def _criteria(spec: Spec, scenario: Scenario, table: Mapping[str, Any]) -> list[str]:
    """Return the criteria that a run may be judged by."""
    varied = (place.split(".") for name in spec.parameters for place in places(table, name))
    set_by_key = {keys[1] for keys in varied if keys[0] == "criteria"}
    stated = [name for name, wanted in scenario.criteria if wanted is not None or name in set_by_key]
    return [*stated, *sorted(set_by_key - {*stated})]  # those of a user's metrics stand nowhere before a run sets them


def _looked_at(plan: SweepPlan, spec: Spec, cells: RunSpecs, file: Path) -> tuple[SweepPlan, tuple[str, ...]]:
    """Return the plan with the hashes of what its outermost runs read, and what is to be noted of them.

    Raises ConfigError where one is in no order.
    """

    def read_only(runs: Sequence[Values]) -> list[RunPreview]:
        return [_read(plan, values) for values in runs]

    def made(runs: Sequence[Values]) -> list[RunPreview]:
        return look([job_of(plan, spec, RunSpec(0, "trial", dict(values), cells.seeds[0]), None) for values in runs])

    trials, files, notes = list(_trials(spec, cells)), dict[str, set[str]](), dict[str, None]()
    codes: dict[str, dict[str, set[str]]] = {}
    own: list[dict[str, Any]] = []
    for judge in (read_only, made):
        for values, seen in zip(trials, judge(trials), strict=False):
            if seen.complaint:
                raise ConfigError(_blame(judge, values, seen.complaint, plan, spec, file))
            notes |= {seen.note: None} if seen.note else {}
            own = list(seen.metrics)
            code = codes.setdefault(parse(_table(plan, values), Path(plan.file)).controller.name, {})
            for role, digest in seen.files_sha256.items():
                files.setdefault(role, set()).add(digest)
                if role.startswith(CONTROLLER):
                    code.setdefault(role, set()).add(digest)
    by_controller = {name: _sorted(code) for name, code in codes.items()}
    found = replace(plan, files_sha256=_sorted(files), controllers_sha256=by_controller, metrics=own)
    return found, tuple(notes)


def _sorted(files: Mapping[str, set[str]]) -> dict[str, list[str]]:
    return {role: sorted(digests) for role, digests in sorted(files.items())}


def _read(plan: SweepPlan, values: Values) -> RunPreview:
    """Return what is wrong with a run's table, whatever the files that it names are like."""
    try:
        parse(_table(plan, values), Path(plan.file))
    except ConfigError as error:
        return RunPreview(str(error), {})
    return RunPreview("", {})


def _trials(spec: Spec, cells: RunSpecs) -> Iterator[Values]:
    """Return the runs to look at: every point of `_points` with every controller, and its outermost tunings."""
    points = list(_points(spec, cells))
    if not spec.controllers:
        yield from points
    for controller in spec.controllers:
        corner, *others = controller.trials()
        yield from ({**corner, **point} for point in points)
        yield from ({**other, **points[0]} for other in others)


def _points(spec: Spec, cells: RunSpecs) -> Iterator[Values]:
    """Return the points to look at: the first rows of a list, else the corner and what lies at the end of each axis."""
    if spec.design == "list":
        yield from itertools.islice(cells.design(), TRIED)
        return
    corner = {name: axis.ends()[0] for name, axis in spec.parameters.items()}
    yield corner
    for name, axis in spec.parameters.items():
        yield from (corner | {name: value} for value in axis.ends()[1:])


def _blame(judge: Judge, values: Values, complaint: str, plan: SweepPlan, spec: Spec, file: Path) -> str:
    """Return what is wrong with a run, naming the parameter that it is wrong by, or the scenario if it is so itself."""
    controller = {NAME: values[NAME]} if spec.controllers else {}
    alone: list[Values] = [{}, *({**controller, name: value} for name, value in values.items())]
    itself, *each = judge(alone)
    if itself.complaint:
        return itself.complaint
    for name, seen in zip(values, each, strict=False):
        if seen.complaint:
            return f"{file}: {_key(spec, name, values)}: {seen.complaint.removeprefix(f'{plan.file}: ')}"
    return f"{file}: parameters, taken together: {complaint.removeprefix(f'{plan.file}: ')}"


def _key(spec: Spec, name: str, values: Values) -> str:
    """Return where a spec states what is varied under a name."""
    if name not in columns(spec.controllers):
        return f"parameters.{name}"
    return f"controllers.{values[NAME]}" + ("" if name == NAME else name.removeprefix("controller"))
