"""Drives a brain through the cases, each with a new process of it, in lockstep over the wires of a rig.

This module knows how a drive and a brain are started and ended; it must not know what a case requires.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

from vve_sumo import workspace
from vve_sumo.certify import kept, places
from vve_sumo.certify.brain_process import BrainProcess
from vve_sumo.certify.cases import CASES, Case, Scene, inapplicable
from vve_sumo.certify.diagnosis import diagnose
from vve_sumo.certify.judge import BROKEN, Rules, judge
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import FaultLink, FaultyWire, Window
from vve_sumo.certify.moments import Timing, speeds_at, timing_of, track_of
from vve_sumo.certify.places import Place
from vve_sumo.certify.pool import Pool
from vve_sumo.certify.results import BrainUnderTest, CaseDrive, CaseResult, CaseVerdict, Certificate
from vve_sumo.drive import provenance
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.run import run as run_drive
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.live.brain_link import key_of
from vve_sumo.live.external_lockstep import external_controller_over, open_wires
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig

#: a brain whose process is unknown counts as idle after this time [s]
MANUAL_QUIET_TIME: Final = 0.1

#: function that waits until a manually started brain is ready for the next case
Ready = Callable[[str], None]
#: called with the results so far
Done = Callable[[Sequence[CaseResult]], None]


@dataclass(frozen=True, slots=True)
class CertifyQuery:
    """The options of a certificate."""

    rig: str
    scenario: str
    command: str | None  #: command that starts the brain; None: it is started by hand before each case
    cases: tuple[Case, ...]
    seeds: tuple[int, ...]
    out: Path  #: folder for the certificate, absent or empty
    values: Mapping[str, Any]  #: of the scenario's keys and parameters
    limits: CertificateLimits = field(default_factory=CertificateLimits)
    workers: int | None = None  #: brains in parallel; None: one a processor if their ports can differ
    resume: bool = False  #: whether to continue the certificate in `out`


class CaseJob(NamedTuple):
    """A drive of a case, before it is driven."""

    case: str
    seed: int
    window: Window | None


class Bench:
    """The common part of all cases: the rig, its wires and ports, the brain's command."""

    def __init__(self, query: CertifyQuery, working: Path, ready: Ready) -> None:
        """Read the rig; raises ConfigError for a rig whose brain does not answer with setpoints."""
        self.query, self.working, self._ready = query, working, ready
        self.rig_file = workspace.find("rig", query.rig, working)
        self.rig: Rig = load_rig(self.rig_file, working)
        if self.rig.brain.kind != "setpoints":
            raise ConfigError(
                f"{self.rig_file}: brain.kind is {self.rig.brain.kind!r}, expected 'setpoints': lockstep waits for "
                "the brain, and only a setpoint shows that it has answered"
            )
        self.kinds = tuple(output.kind for output in self.rig.outputs)
        if "radar" not in self.kinds:
            raise ConfigError(f"{self.rig_file}: outputs: expected one of kind 'radar', which a setpoint answers")
        self.places = places.places_of(self.rig, query.command, self._workers())
        self.scenarios = {seed: self._resolved(seed) for seed in query.seeds}
        self._key = key_of(self.rig.brain, working)

    def _workers(self) -> int:
        if self.query.workers is not None:
            return self.query.workers
        return (os.cpu_count() or 1) if places.has_places(self.rig, self.query.command) else 1

    def _resolved(self, seed: int) -> ResolvedScenario:
        query = self.query
        return resolve_by_name(query.scenario, self.working, seed=seed, rig=query.rig, values=query.values)

    @property
    def bumper(self) -> float:
        """From the rear axle to the front bumper [m]."""
        vehicle = next(iter(self.scenarios.values())).vehicle
        return vehicle.wheelbase + vehicle.front_overhang

    @property
    def rules(self) -> Rules:
        """What every drive is held to."""
        resolved = next(iter(self.scenarios.values()))
        return Rules(self.query.limits, resolved.scenario.ego.speed_mps, resolved.vehicle.steering_limit)

    def identity(self) -> dict[str, Any]:
        """Return the values that must be equal when a certificate is continued."""
        query = self.query
        brain = under_test(query.command, self.working)
        driven = next(iter(self.scenarios.values())).to_dict(self.working)
        car = json.dumps([driven["vehicle"], driven["vehicle_model"]], sort_keys=True)
        return {
            "rig_sha256": _digest(self.rig_file),
            "scenario": query.scenario,
            "scenario_sha256": _digest(workspace.find("scenario", query.scenario, self.working)),
            "values": dict(query.values),
            "files_sha256": driven["files_sha256"],
            "vehicle_sha256": hashlib.sha256(car.encode()).hexdigest(),
            "brain": brain.command,
            "brain_files_sha256": dict(brain.files),
            "code_sha256": provenance.software()["code"]["sha256"],
        }

    def drive(self, job: CaseJob, place: Place) -> None:
        """Drive a job at a place, into its own folder."""
        case, resolved = CASE_BY_NAME[job.case], self.scenarios[job.seed]
        folder = kept.folder_of(self.query.out, job.case, job.seed)
        kept.clear(folder)
        folder.mkdir(parents=True)
        with self._brain(case, place, folder) as (quiet, unheard), ExitStack() as stack:
            link = self._link(case, resolved, job, place, quiet)
            stack.callback(link.close)
            brain = external_controller_over(link, place.rig, resolved, self.working)
            done = run_drive(resolved, folder / "record", self.working, brain=brain)
        if done.summary["outcome"] in BROKEN:
            if done.summary["outcome"] == "interrupted":
                kept.clear(folder)
                raise KeyboardInterrupt
            raise SimulationError(f"case {case.name}: {done.summary['text'] or done.summary['reasons']}")
        begins = None if job.window is None else job.window.begins
        kept.keep(folder, link.answers, kept.WireSummary(begins, brain.refused, brain.taken, unheard))

    @contextmanager
    def _brain(self, case: Case, place: Place, folder: Path) -> Iterator[tuple[Callable[[], bool], tuple[str, ...]]]:
        """Start a brain; yields the function that tells whether it is idle, and the wires that it does not receive."""
        if place.command is None:
            self._ready(case.name)
            yield _manual_quiet, ()
            return
        ports = place.ports
        process = BrainProcess(place.command, ports, folder / "brain.log", self.working)
        try:
            unheard = process.wait_until_it_listens([port for port, kind in ports.items() if kind == "radar"])
            yield process.quiet, tuple(sorted(ports[port] for port in unheard))
        finally:
            process.close()

    def _link(
        self, case: Case, resolved: ResolvedScenario, job: CaseJob, place: Place, quiet: Callable[[], bool]
    ) -> FaultLink:
        wires, setpoints = open_wires(place.rig, resolved, self._key)
        assert setpoints is not None  # a rig without setpoints is refused
        rng = Random(f"{case.name} {resolved.scenario.seed}")
        scene = None if job.window is None or case.make_scan_fault is None else self._scene(job.seed, job.window)
        faulty = [
            FaultyWire(
                wire.output,
                wire.outlet,
                case.make_wire_fault(rng) if case.make_wire_fault and kind in case.wires else None,
                case.make_scan_fault(scene) if case.make_scan_fault and scene and kind in case.wires else None,
            )
            for kind, wire in zip(self.kinds, wires, strict=True)
        ]
        return FaultLink(faulty, setpoints, job.window, quiet, place.rig.brain.deadline_s, self._key)

    def _scene(self, seed: int, window: Window) -> Scene:
        nominal = self.case_drive(CaseJob(NOMINAL, seed, None))
        (speed,) = speeds_at(nominal, [window.begins]).tolist()
        return Scene(track_of(nominal), window.begins, self.bumper, speed)

    def wire_summary(self, job: CaseJob) -> kept.WireSummary | None:
        """Return the summary of a finished job; None where it has not been driven."""
        return kept.wire_summary_of(kept.folder_of(self.query.out, job.case, job.seed), job.window)

    def case_drive(self, job: CaseJob) -> CaseDrive:
        """Return the drive of a finished job."""
        wire_summary = self.wire_summary(job)
        assert wire_summary is not None
        return kept.drive_of(kept.folder_of(self.query.out, job.case, job.seed), wire_summary)


NOMINAL: Final = CASES[0].name
CASE_BY_NAME: Final[Mapping[str, Case]] = {case.name: case for case in CASES}


def _manual_quiet() -> bool:
    time.sleep(MANUAL_QUIET_TIME)
    return True


def certify(query: CertifyQuery, working: Path, ready: Ready, done: Done) -> Certificate:
    """Drive every case with every seed and return the certificate; raises VveError where one cannot be driven.

    If the nominal drive of a seed has no answer at all, the other cases of the seed are not driven. After a ConfigError
    in the first drive, nothing remains on the disk. After an interrupt, finished drives remain for `query.resume`.
    """
    bench = Bench(query, working, ready)
    existed = query.out.exists()
    kept.begin(query.out, bench.identity(), resume=query.resume)
    began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    seeds = {seed: _SeedResults(bench, seed) for seed in query.seeds}
    shown: list[CaseResult] = []

    def publish(results: Sequence[CaseResult]) -> None:
        for result in results:
            shown.append(result)
            done(shown)

    def after(job: CaseJob) -> Sequence[CaseJob]:
        results, jobs = seeds[job.seed].take(job)
        publish(results)
        return _undriven(bench, jobs, after)

    try:
        _drive_all(bench, _undriven(bench, [CaseJob(NOMINAL, seed, None) for seed in query.seeds], after), after)
    except ConfigError:
        if not shown and not query.resume:
            _clear(query.out, remove=not existed)
        raise
    results = [result for seed in query.seeds for result in seeds[seed].results()]
    return Certificate(
        rig=str(bench.rig_file.name.removesuffix(".toml")),
        rig_argument=query.rig,
        rig_sha256=_digest(bench.rig_file),
        scenario=query.scenario,
        values=dict(query.values),
        brain=under_test(query.command, working),
        wires=bench.kinds,
        seeds=query.seeds,
        cases=tuple(case.name for case in query.cases),
        limits=query.limits,
        results=tuple(results),
        defects=diagnose(results),
        software=provenance.software(),
        began_utc=began,
    )


def _undriven(bench: Bench, jobs: Sequence[CaseJob], after: Callable[[CaseJob], Sequence[CaseJob]]) -> list[CaseJob]:
    """Return the jobs that are still to be driven; results of finished jobs are reused, with the jobs that follow."""
    left: list[CaseJob] = []
    for job in jobs:
        if bench.wire_summary(job) is None:
            left.append(job)
        else:
            left.extend(after(job))
    return left


def _drive_all(bench: Bench, jobs: Sequence[CaseJob], after: Callable[[CaseJob], Sequence[CaseJob]]) -> None:
    if len(bench.places) == 1:
        left = list(jobs)
        while left:
            job = left.pop(0)
            bench.drive(job, bench.places[0])
            left.extend(after(job))
        return
    pool: Pool[CaseJob] = Pool([partial(bench.drive, place=place) for place in bench.places])
    try:
        pool.run(jobs, after)
    finally:
        pool.close()


class _SeedResults:
    """The results of a seed: first the nominal drive, then those that are timed by it."""

    def __init__(self, bench: Bench, seed: int) -> None:
        self._bench, self._seed = bench, seed
        self._nominal: CaseDrive | None = None
        self._results: dict[str, CaseResult] = {}

    def take(self, job: CaseJob) -> tuple[list[CaseResult], list[CaseJob]]:
        """Judge a finished job; return the new results, and the jobs that follow from it."""
        drive = self._bench.case_drive(job)
        result = self._judged(job, drive)
        self._results[job.case] = result
        if job.case != NOMINAL:
            return [result], []
        self._nominal = drive
        if not drive.answers:
            return [result], []
        wire_summary = self._bench.wire_summary(job)
        listened = [kind for kind in self._bench.kinds if wire_summary is None or kind not in wire_summary.unheard]
        settled, jobs = [result], []
        for case in self._bench.query.cases[1:]:
            undriven, window = self._undriven(case, listened)
            if undriven is None:
                jobs.append(CaseJob(case.name, self._seed, window))
            else:
                self._results[case.name] = undriven
                settled.append(undriven)
        return settled, jobs

    def _undriven(self, case: Case, listened: Sequence[str]) -> tuple[CaseResult | None, Window | None]:
        """Return the result of a case that is not driven, or the window of its fault."""
        assert self._nominal is not None
        if why := inapplicable(case, self._bench.kinds) or inapplicable(case, listened):
            silent = "" if inapplicable(case, self._bench.kinds) else "the brain listens to no such wire: "
            return CaseResult(case, self._seed, CaseVerdict.NOT_APPLICABLE, silent + why), None
        timing: Timing = timing_of(case, self._nominal, self._bench.bumper)
        if timing.void:
            return CaseResult(case, self._seed, CaseVerdict.VOID, timing.void), None
        return None, timing.window

    def _judged(self, job: CaseJob, drive: CaseDrive) -> CaseResult:
        case = CASE_BY_NAME[job.case]
        judged = judge(case, job.window, drive, self._nominal, self._bench.rules)
        record = Path(kept.CASES) / case.name / f"seed_{job.seed}" / "record"
        result = CaseResult(case, job.seed, judged.verdict, judged.why, job.window, judged.reaction, judged.left)
        return replace(
            result,
            impact_speed=drive.impact_speed,
            outcome=drive.outcome,
            reasons=tuple(drive.reasons),
            extra_braking=judged.extra_braking,
            last=judged.last,
            record=record,
            record_sha256=drive.record_sha256,
            drive=drive,
        )

    def results(self) -> list[CaseResult]:
        """Return the results in the order of the cases."""
        return [self._results[case.name] for case in self._bench.query.cases if case.name in self._results]


def _clear(folder: Path, *, remove: bool) -> None:
    """Remove what was written before the first drive ended; with `remove`, the folder too."""
    kept.clear(folder / kept.CASES)
    (folder / kept.QUERY).unlink(missing_ok=True)
    if remove:
        with suppress(OSError):  # the folder is not empty: another program wrote into it
            folder.rmdir()


def under_test(command: str | None, working: Path) -> BrainUnderTest:
    """Return a brain's command with the hashes of the files that it names."""
    arguments = shlex.split(command or "")
    files = {argument: working / argument for argument in arguments}
    return BrainUnderTest(
        command or "", {argument: _digest(file) for argument, file in files.items() if file.is_file()}
    )


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
