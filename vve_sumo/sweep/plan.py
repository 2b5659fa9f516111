"""Makes a sweep's plan from its file; finds every error before a run starts.

Reads files and previews the outermost runs; drives nothing and writes nothing.
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
from vve_sumo.drive.provenance import decisive_versions
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
from vve_sumo.sweep.preflight import RunPreview, preview
from vve_sumo.sweep.run_specs import RunSpec, RunSpecs, cells_of
from vve_sumo.sweep.search import min_runs
from vve_sumo.sweep.spec import Boundary, Spec, WorstCase, fit, parse_spec, with_numbers

#: number of runs from which on a sweep needs a confirmation
MAX_RUNS = 100_000
#: wall time that a drive of a suite may take [s]
TEST_TIME_LIMIT = 300.0
#: rows of a list that are previewed
MAX_TRIALS = 32

Values = Mapping[str, Value]
Previewer = Callable[[Sequence[Values]], list[RunPreview]]


@dataclass(frozen=True, slots=True)
class SweepQuery:
    """A validated sweep."""

    spec: Spec
    plan: SweepPlan
    cells: RunSpecs
    notes: tuple[str, ...] = ()  #: notes for the user before it is driven, a line each


def query_of(
    name: str,
    working: Path,
    *,
    yes: bool,
    search: bool = False,
    vehicle: str | None = None,
    rig: str | None = None,
) -> SweepQuery:
    """Return the sweep of a name or file; `search` requires a search.

    `vehicle` replaces the scenario's; with a `rig`, the rig's car is simulated.

    Raises ConfigError, naming file and key, for any error, and for MAX_RUNS or more unless `yes`.
    """
    file = workspace.find("sweep", name, working)
    return planned(read(file, "sweep"), file, working, yes=yes, search=search, vehicle=vehicle, rig=rig)


def planned(
    spec_table: dict[str, Any],
    file: Path,
    working: Path,
    *,
    yes: bool,
    search: bool = False,
    vehicle: str | None = None,
    rig: str | None = None,
    scenario: tuple[Path, dict[str, Any]] | None = None,
) -> SweepQuery:
    """Return the sweep of a spec's table, as `query_of` does; `file` is its file, or a name for messages.

    `scenario`: file and table of the scenario, in place of the spec's.
    """
    given = scenario
    if given is None and isinstance(spec_table.get("scenario"), str) and spec_table["scenario"]:
        given = _scenario(spec_table["scenario"], file, working)
    if given is not None:
        spec_table = with_numbers(spec_table, file, given[1])
    spec = parse_spec(spec_table, file)
    if search and spec.search is None:
        raise ConfigError(f"{file}: --search: expected a table [search]")
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
    count = min_runs(cells)
    if count >= MAX_RUNS and not yes:
        raise ConfigError(f"{file}: {count:,} runs; --yes drives that many")
    plan = SweepPlan(
        spec=spec_table,
        scenario=cells.name,
        table=table,
        file=str(scenario_file.absolute()),
        working=str(working.absolute()),
        cells=cells.count,
        parameters=spec.varied,
        criteria=criteria,
        files_sha256={},
        versions=decisive_versions(),
        rig=rig_file,
    )
    if isinstance(spec.search, Boundary) or not settings.metrics:
        _check_search(spec.search, plan, file)
    plan, notes = _with_previews(plan, spec, cells, file)
    enter(plan.own())
    _check_search(spec.search, plan, file)
    _refuse_taken(plan, file)
    return SweepQuery(spec, plan, cells, notes)


def with_metrics(table: Mapping[str, Any], spec: Spec) -> dict[str, Any]:
    """Return a scenario's table with the metrics that a sweep adds: its own, and an installed one of its search."""
    named = table.get("metrics", [])
    if not isinstance(named, (list, tuple)):
        return dict(table)  # the schema refuses it
    sought = [spec.search.metric] if isinstance(spec.search, WorstCase) and spec.search.metric not in COLUMNS else []
    added = [*spec.metrics, *(name for name in sought if name in installed())]
    return {**table, "metrics": list(dict.fromkeys([*named, *added]))} if added else dict(table)


def _refuse_varied_metrics(spec: Spec, table: Mapping[str, Any], file: Path) -> None:
    """Raise ConfigError where a parameter varies which metrics are measured: all rows have the same columns."""
    for key in spec.parameters:
        if any(place.partition(".")[0] == "metrics" for place in places(table, key)):
            raise ConfigError(
                f"{file}: parameters.{key}: expected metrics = [ … ] in the sweep: every run has the same metrics"
            )


def _refuse_taken(plan: SweepPlan, file: Path) -> None:
    """Raise ConfigError where a parameter has the name of a user's metric."""
    if taken := [name for name in plan.parameters if name in plan.own()]:
        raise ConfigError(
            f"{file}: parameters.{taken[0]}: a metric has that name; declare the parameter under another name"
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

    Raises ConfigError where a `vehicle` is given as well, and for a faulty rig or one with an external controller.
    """
    from vve_sumo.rig.load import load

    if vehicle is not None:
        raise ConfigError("--vehicle: a rig brings its own vehicle; leave out one of --vehicle and --rig")
    file = workspace.find("rig", name, working).absolute()
    brain = load(file, working).brain.kind
    if brain != "own":
        raise ConfigError(
            f"--rig: brain.kind of {file} is {brain!r}, expected 'own': "
            "only a single drive can use an external controller"
        )
    return file


def _scenario(name: str, file: Path, working: Path) -> tuple[Path, dict[str, Any]]:
    try:
        found = workspace.find("scenario", name, working, beside=file.parent)
    except ConfigError as error:
        raise ConfigError(f"{file}: scenario: {error}") from None
    return found, read_as(found, "scenario", Scenario)


def job_of(plan: SweepPlan, spec: Spec | None, run: RunSpec, keep: Path | None) -> Job:
    """Return the job of a run; a suite has no `spec`: each of its tests has a scenario of its own."""
    if spec is None:
        row = str(run.values["row"])
        name, table = f"{plan.scenario}_{row}", plan.tests[row]["scenario"]
        limits: dict[str, Any] = {"time_limit_s": TEST_TIME_LIMIT}
    else:
        name, table = plan.scenario, _table(plan, run.values)
        limits = {"time_limit_s": spec.time_limit_s, "memory_limit_mb": spec.memory_limit_mb}
    return Job(
        key=run.key,
        name=name,
        table=table | {"seed": run.seed},
        file=Path(plan.file),
        working=Path(plan.working),
        keep=keep,
        rig=Path(plan.rig) if plan.rig else None,
        **limits,
    )


def _table(plan: SweepPlan, values: Values) -> dict[str, Any]:
    """Return a run's scenario; the tuning in the scenario's file is for the controller of that file alone."""
    name = str(values[NAME]) if plan.spec.get("controllers") and NAME in values else None
    return apply_overrides(choose(plan.table, controller=name), values)


def _check_search(search: Boundary | WorstCase | None, plan: SweepPlan, file: Path) -> None:
    """Raise ConfigError where no row has what a search uses, or Optuna is missing."""
    if isinstance(search, Boundary):
        known = dict.fromkeys(["passed", "collision", *plan.criteria])
        if search.criterion not in known:
            raise ConfigError(f"{file}: search.criterion: expected {', '.join(known)}, got {search.criterion!r}")
    elif search is not None:
        if search.metric not in (numbers := plan.numbers()):
            goal = "highest" if search.highest else "lowest"
            near = did_you_mean(search.metric, numbers)
            got = f"got {search.metric!r}{f', {near}' if near else ''}"
            raise ConfigError(f"{file}: search.{goal}: expected {', '.join(numbers)}, {got}")
        worst.require_optuna()


def _criteria(spec: Spec, scenario: Scenario, table: Mapping[str, Any]) -> list[str]:
    """Return the criteria that a run can have."""
    varied = (place.split(".") for name in spec.parameters for place in places(table, name))
    set_by_key = {keys[1] for keys in varied if keys[0] == "criteria"}
    stated = [name for name, wanted in scenario.criteria if wanted is not None or name in set_by_key]
    return [*stated, *sorted(set_by_key - {*stated})]  # only a run states those of a user's metrics


def _with_previews(plan: SweepPlan, spec: Spec, cells: RunSpecs, file: Path) -> tuple[SweepPlan, tuple[str, ...]]:
    """Return the plan with the hashes of the files of its outermost runs, and notes on them.

    Raises ConfigError for a run that cannot be driven.
    """

    def read_only(runs: Sequence[Values]) -> list[RunPreview]:
        return [_read(plan, values) for values in runs]

    def made(runs: Sequence[Values]) -> list[RunPreview]:
        return preview([job_of(plan, spec, RunSpec(0, "trial", dict(values), cells.seeds[0]), None) for values in runs])

    trials, hashes, notes = list(_trials(spec, cells)), ReadFiles(), dict[str, None]()
    own: list[dict[str, Any]] = []
    for previewer in (read_only, made):
        for values, run_preview in zip(trials, previewer(trials), strict=False):
            if run_preview.complaint:
                raise ConfigError(_blame(previewer, values, run_preview.complaint, plan, spec, file))
            notes |= {run_preview.note: None} if run_preview.note else {}
            own = list(run_preview.metrics)
            hashes.add(parse(_table(plan, values), Path(plan.file)).controller.name, run_preview.files_sha256)
    return replace(hashes.noted_in(plan), metrics=own), tuple(notes)


class ReadFiles:
    """The hashes of the files that the runs of a plan read."""

    def __init__(self) -> None:
        self._files: dict[str, set[str]] = {}
        self._codes: dict[str, dict[str, set[str]]] = {}

    def add(self, controller: str, files: Mapping[str, str]) -> None:
        """Add those of a run with a controller, by role."""
        code = self._codes.setdefault(controller, {})
        for role, digest in files.items():
            self._files.setdefault(role, set()).add(digest)
            if role.startswith(CONTROLLER):
                code.setdefault(role, set()).add(digest)

    def noted_in(self, plan: SweepPlan) -> SweepPlan:
        """Return a plan that holds them."""
        by_controller = {name: _sorted(code) for name, code in self._codes.items()}
        return replace(plan, files_sha256=_sorted(self._files), controllers_sha256=by_controller)


def _sorted(files: Mapping[str, set[str]]) -> dict[str, list[str]]:
    return {role: sorted(digests) for role, digests in sorted(files.items())}


def _read(plan: SweepPlan, values: Values) -> RunPreview:
    """Return the preview of a run's table alone, without the files that it names."""
    try:
        parse(_table(plan, values), Path(plan.file))
    except ConfigError as error:
        return RunPreview(str(error), {})
    return RunPreview("", {})


def _trials(spec: Spec, cells: RunSpecs) -> Iterator[Values]:
    """Yield the runs to preview: every point of `_points` with every controller, and its outermost tunings."""
    points = list(_points(spec, cells))
    if not spec.controllers:
        yield from points
    for controller in spec.controllers:
        corner, *others = controller.trials()
        yield from ({**corner, **point} for point in points)
        yield from ({**other, **points[0]} for other in others)


def _points(spec: Spec, cells: RunSpecs) -> Iterator[Values]:
    """Yield the points to preview: the first rows of a list, else a corner and the other ends of each axis."""
    if spec.design == "list":
        yield from itertools.islice(cells.design(), MAX_TRIALS)
        return
    corner = {name: axis.ends()[0] for name, axis in spec.parameters.items()}
    yield corner
    for name, axis in spec.parameters.items():
        yield from (corner | {name: value} for value in axis.ends()[1:])


def _blame(previewer: Previewer, values: Values, complaint: str, plan: SweepPlan, spec: Spec, file: Path) -> str:
    """Return the error of a run, with the parameter that causes it, or of the scenario itself."""
    controller = {NAME: values[NAME]} if spec.controllers else {}
    alone: list[Values] = [{}, *({**controller, name: value} for name, value in values.items())]
    itself, *each = previewer(alone)
    if itself.complaint:
        return itself.complaint
    for name, run_preview in zip(values, each, strict=False):
        if run_preview.complaint:
            return f"{file}: {_key(spec, name, values)}: {run_preview.complaint.removeprefix(f'{plan.file}: ')}"
    return f"{file}: parameters, taken together: {complaint.removeprefix(f'{plan.file}: ')}"


def _key(spec: Spec, name: str, values: Values) -> str:
    """Return the key of a spec that varies a name."""
    if name not in columns(spec.controllers):
        return f"parameters.{name}"
    return f"controllers.{values[NAME]}" + ("" if name == NAME else name.removeprefix("controller"))
