"""One drive in a process of its own, with the mechanism that a sweep drives its runs with."""

from __future__ import annotations

import warnings
from pathlib import Path

from vve_sumo import progress_bar
from vve_sumo.analysis.run import Run
from vve_sumo.api.scenario import Scenario
from vve_sumo.drive.run import new_run_folder
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.record.declared import read_resolved
from vve_sumo.record.writer import require_empty_folder
from vve_sumo.sweep.engine import run_one
from vve_sumo.sweep.job import CONFIG, Job, RunResult
from vve_sumo.sweep.plan import rig_that_drives
from vve_sumo.sweep.run import growing

#: of a sweep's run, time [s] and memory [MB]; a drive that somebody waits for has neither
NO_LIMIT = 1e9


def drive(
    scenario: str | Path | Scenario,
    *,
    speed: float | str | None = None,
    seed: int | None = None,
    controller: str | None = None,
    vehicle: str | None = None,
    rig: str | Path | None = None,
    pose: str | Path | None = None,
    out: str | Path | None = None,
    progress: bool = True,
) -> Run:
    """Drive a scenario in lockstep with the simulated vehicle and return the drive.

    `scenario` is a name under scenarios/, a .toml file or a `Scenario`. Instead of the scenario's own: `speed` to keep
    where nothing forbids it ([m/s], or a text such as "25 mph"), `seed`, `controller` (a shipped name, "file.py:make"
    or an entry point) and `vehicle` (a name under vehicles/ or a .toml file), or a `rig` (a name under rigs/ or a .toml
    file) with whose vehicle and injected faults the simulated vehicle drives. `pose` is a recorded drive (a receiver's
    log or CSV) to play instead of driving; then commands are computed and nobody obeys. `out` is the folder of the
    record, absent or empty; by default it is a new one under runs/. `progress` shows a bar meanwhile.

    Raises ConfigError, before anything is driven, for what is wrong; SimulationError for a drive that crashed or broke.

    >>> import vve_sumo as vve
    >>> run = vve.drive("parked_car", speed=12, seed=3, out="mine")
    >>> run.summary["passed"]
    True
    """
    working = Path.cwd()
    asked = scenario if isinstance(scenario, Scenario) else Scenario(scenario)
    asked = asked.chosen(seed=seed, speed=speed, controller=controller, vehicle=vehicle)
    rig_file = None if rig is None else rig_that_drives(str(rig), vehicle, working)
    folder = new_run_folder(asked.name, working) if out is None else Path(out)
    require_empty_folder(folder)
    job = Job(
        key=asked.name,
        name=asked.name,
        table=asked.table,
        file=asked.file.absolute(),
        working=working,
        keep=folder.absolute(),
        pose=None if pose is None else Path(pose).absolute(),
        rig=rig_file,
        progress=True,
        time_limit_s=NO_LIMIT,
        memory_limit_mb=NO_LIMIT,
    )
    try:
        with progress_bar.of_drive(asked.name, quiet=not progress) as show:
            result = run_one(job, show)
    finally:
        left = growing(job, folder)  # of a drive that was interrupted: a record up to there
        if left.is_dir():
            left.replace(folder)
    if result.error:
        raise _error(asked.name, folder, result)
    if (note := read_resolved(folder).get("braking_note")) is not None:
        warnings.warn(note, stacklevel=2)
    return Run(folder)


def _error(name: str, folder: Path, result: RunResult) -> ConfigError | SimulationError:
    """Return the error that says why a drive came to no end; its notes hold the last that the process printed."""
    if result.error.startswith(CONFIG):
        return ConfigError(result.error.removeprefix(CONFIG))
    record = f"; the record up to there: {folder}" if folder.is_dir() else ""
    error = SimulationError(f"{name}: the drive came to no end: {result.error}{record}")
    if result.said:
        error.add_note(result.said)
    return error
