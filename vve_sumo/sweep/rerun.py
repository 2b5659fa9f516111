"""Reruns one run of a dataset alone, keeps its record, and compares the result."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from vve_sumo.drive import plugged_in
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import Drive
from vve_sumo.errors import ConfigError
from vve_sumo.record.sweep_folder import Row, SweepPlan, read_tables
from vve_sumo.record.writer import require_empty_folder
from vve_sumo.scenario.load import parse
from vve_sumo.sweep.dataset import refuse_mixed
from vve_sumo.sweep.engine import run_one
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import Job, RunResult
from vve_sumo.sweep.plan import job_of
from vve_sumo.sweep.preflight import preview
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.spec import parse_spec


@dataclass(frozen=True, slots=True)
class Rerun:
    """A run of a dataset that was driven again."""

    job: Job
    row: Row  #: of the dataset
    result: RunResult  #: now
    folder: Path  #: of the record, where one was written
    numbers: tuple[str, ...]  #: metrics that may be missing

    @property
    def same(self) -> bool:
        """Whether error and record are the same as in the sweep."""
        return bool(self.result.error == self.row["error"] and self._digest == self.row["record_sha256"])

    @property
    def then(self) -> str:
        """Error or record of the run in the sweep."""
        return str(self.row["error"]) or f"record {self.row['record_sha256']}"

    @property
    def now(self) -> str:
        """Error or record of the rerun."""
        return self.result.error or f"record {self._digest}"

    @property
    def _digest(self) -> object:
        return self.result.figures.get("record_sha256")

    def drive(self) -> Drive:
        """Return the drive that was recorded, as a single drive leaves it."""
        summary = json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))
        # JSON cannot express NaN, the value of a missing metric.
        missing = {name: math.nan for name in self.numbers if summary.get(name, 0.0) is None}
        return Drive(self.folder, summary | missing)

    def resolved(self) -> ResolvedScenario:
        """Return the scenario that was driven."""
        return resolve_job(self.job, InputCache())


def rerun(folder: Path, key: str, out: Path | None, warn: Callable[[str], None]) -> Rerun:
    """Drive one run of a dataset again and keep its record in `out`, or with the dataset.

    `warn` receives a line for every file that has changed since the sweep began, and for changed code of this program;
    it is called before the run is driven. Raises ConfigError where there is no such run, for other versions, for a
    controller or a sensor whose code has changed, and for a record that exists already.
    """
    plan = SweepPlan.of(folder)
    here = decisive_versions()
    if plan.design == "certificate":
        raise ConfigError(f"{folder}: a drive of a certificate needs its brain; vve-sumo certify … drives it")
    refuse_mixed(folder, plan.versions, here | {"code": plan.versions.get("code", "none")})
    row = _row(folder, key)
    if not Path(plan.working).is_dir():
        plan = replace(plan, working=str(Path.cwd()))
    record = (out or folder / "records" / key).absolute()
    try:
        require_empty_folder(record)
    except ConfigError as error:
        raise ConfigError(f"{error}; name another with --out DIR") from None
    run = RunSpec(
        row["number"], key, {name: row[name] for name in plan.parameters if row[name] is not None}, row["seed"]
    )
    spec = None if plan.design == "suite" else parse_spec(plan.spec, folder / "sweep.json")
    job = job_of(plan, spec, run, record)
    parts = plugged_in.of_scenario(parse(job.table, job.file), job.working)
    if changed := [line for part in parts for line in part.changed(_recorded(plan, part))]:
        advice = "drive a sweep with the present code into another folder"
        raise ConfigError(f"{folder}: {changed[0]}: not run; {advice}")
    if here["code"] != plan.versions.get("code"):
        warn("the code of vve-sumo has changed since the sweep began")
    for role in _changed_files(plan, job):
        warn(f"the file of {role} has changed since the sweep began")
    return Rerun(job, row, run_one(job), record, plan.numbers())


def _recorded(plan: SweepPlan, part: plugged_in.PluggedIn) -> Mapping[str, list[str]]:
    """Return the hashes of a plug-in's code: of a controller, only its own, because others drove other runs."""
    return plan.controllers_sha256.get(part.name, {}) if part.role == plugged_in.CONTROLLER else plan.files_sha256


def _row(folder: Path, key: str) -> Row:
    for table in read_tables(folder):
        keys = table["key"].to_pylist()
        if key in keys:
            row: Row = table.slice(keys.index(key), 1).to_pylist()[0]
            return row
    raise ConfigError(f"{folder}: no finished run has the key {key!r}; the column key of its rows lists them")


def _changed_files(plan: SweepPlan, job: Job) -> Iterator[str]:
    """Return the roles of the files that have changed since the sweep began."""
    previews = preview([job])
    files: Mapping[str, str] = previews[0].files_sha256 if previews else {}
    recorded_hashes = plan.files_sha256
    return (role for role, digest in files.items() if role in recorded_hashes and digest not in recorded_hashes[role])
