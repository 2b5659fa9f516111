"""Many drives into one dataset, asked for in code."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vve_sumo import progress_bar
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.api.scenario import Scenario, plain
from vve_sumo.drive.run import new_run_folder
from vve_sumo.errors import ConfigError
from vve_sumo.sweep.conclusion import conclude, write_search_result
from vve_sumo.sweep.fill import engine_of, fill
from vve_sumo.sweep.plan import SweepQuery, planned, query_of

#: stands for a file's name in what is said of a sweep that was asked for in code
CALLED = Path("vve.sweep")


def sweep(
    what: str | Path | Scenario | Mapping[str, Any],
    *,
    vary: Mapping[str, Any] | None = None,
    controllers: Mapping[str, Mapping[str, Any]] | Sequence[str] | None = None,
    seeds: int | Sequence[int] | None = None,
    rig: str | Path | None = None,
    workers: int | None = None,
    out: str | Path | None = None,
    progress: bool = True,
) -> Sweep:
    """Drive a scenario many times, each run in a process of its own, and return the dataset.

    With `vary`, `controllers` or `seeds`, `what` is a scenario: a name, a .toml file or a `Scenario`. `vary` says for
    each dotted key or parameter of it a list of values, or what a sweep's file may say, such as
    {"from": 5, "to": 14, "step": 3}; every value is driven with every other. `controllers` are names, or by each name
    what its tuning goes through: every point is driven with each controller, whose tuning keys are no other's.
    `seeds` is how often, or a list of seeds. Without these, `what` is a sweep's name or file, or a mapping of what such
    a file says.

    With a `rig` (a name under rigs/ or a .toml file), its vehicle drives, simulated, and its faults are injected.
    `workers` runs go on at a time, by default as many as there are processors. `out` is the folder of the dataset, by
    default a new one under runs/. Where it holds this very sweep already, only what is not finished is driven.

    Raises ConfigError, before anything is driven, for what is wrong; SimulationError where runs cannot be started.

    >>> import vve_sumo as vve
    >>> near = vve.Scenario("delay_probe").replace({"obstacles.parked_car.at_m": 150.0})
    >>> sweep = vve.sweep(near, vary={"ego.speed_mps": [5, 10]}, out="probe")
    >>> len(sweep.rows())
    2
    """
    working = Path.cwd()
    query = _query(what, vary, controllers, seeds, None if rig is None else str(rig), working)
    for line in query.notes:
        warnings.warn(line, stacklevel=2)
    folder = new_run_folder(query.plan.scenario, working) if out is None else Path(out)
    begun = (folder / "sweep.json").exists()
    again = f"vve.sweep(…, out={str(folder)!r})"
    with progress_bar.of_runs(quiet=not progress) as shown:
        search = fill(
            folder,
            query,
            engine_of(workers, None),
            query.spec.keep,
            resume=begun,
            resume_command=again,
            progress=shown,
            notify=lambda line: None,
        )
    if search is None:
        conclude(folder, query)
    elif search.result is not None:
        write_search_result(folder, search.result)
    return Sweep(folder)


def _query(
    what: str | Path | Scenario | Mapping[str, Any],
    vary: Mapping[str, Any] | None,
    controllers: Mapping[str, Mapping[str, Any]] | Sequence[str] | None,
    seeds: int | Sequence[int] | None,
    rig: str | None,
    working: Path,
) -> SweepQuery:
    if vary is None and controllers is None and seeds is None:
        if isinstance(what, Scenario):
            raise ConfigError("vve.sweep: a scenario alone is one drive; expected vary={…}, controllers={…} or seeds=…")
        if isinstance(what, Mapping):
            return planned(plain(what), CALLED, working, yes=False, rig=rig)
        return query_of(str(what), working, yes=False, rig=rig)
    if isinstance(what, Mapping):
        raise ConfigError("vve.sweep: a mapping says itself what is varied; leave out vary, controllers and seeds")
    scenario = what if isinstance(what, Scenario) else Scenario(what)
    query: dict[str, Any] = {"scenario": scenario.name, "parameters": plain(vary or {})}
    if controllers is not None:
        query["controllers"] = _controllers(controllers)
    if seeds is not None:
        query["seeds"] = plain(seeds)
    return planned(query, CALLED, working, yes=False, rig=rig, scenario=(scenario.file.absolute(), scenario.table))


def _controllers(controllers: Mapping[str, Mapping[str, Any]] | Sequence[str]) -> list[dict[str, Any]]:
    """Return what a sweep's file would say of controllers, given by name with their tuning, or by name alone."""
    if isinstance(controllers, str) or not controllers:
        raise ConfigError(f"vve.sweep: controllers: expected names, or {{name: {{key: values}}}}, got {controllers!r}")
    tunings: Mapping[str, Mapping[str, Any]] = controllers if isinstance(controllers, Mapping) else {}
    return [{"name": name, "tuning": plain(tunings.get(name, {}))} for name in controllers]
