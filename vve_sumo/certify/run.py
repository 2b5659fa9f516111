"""A certificate as a design of many drives: the nominal case of each seed, then the cases that are timed by it.

Every drive has a new process of the brain, in lockstep over the wires of a rig (`bench.py`). This module must not know
how a brain is started, nor what a case requires.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.certify import case_record, places
from vve_sumo.certify.bench import DRIVER, bumper_of, order
from vve_sumo.certify.cases import CASE_BY_NAME, CASES, NAMES, NOMINAL, Case, inapplicable
from vve_sumo.certify.diagnosis import diagnose
from vve_sumo.certify.judge import Rules, judge
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import Window
from vve_sumo.certify.moments import timing_of
from vve_sumo.certify.results import BrainUnderTest, CaseDrive, CaseResult, CaseVerdict, Certificate
from vve_sumo.drive import plugged_in, provenance
from vve_sumo.drive.run import resolve_by_name, table_by_name
from vve_sumo.errors import ConfigError, RigError, SimulationError
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.table import rows
from vve_sumo.record.hashes import hash_file
from vve_sumo.record.sweep_folder import Row, SweepPlan
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.fill import Design, Progress, Settled, drive_into
from vve_sumo.sweep.job import CONFIG, RIG, Job, MetricValue, RunResult, finite
from vve_sumo.sweep.run_specs import RunSpec

#: the one parameter of a certificate
CASE: Final = "case"
#: a brain may take the time and the memory that it likes: [s], [10^6 bytes]
NO_LIMIT: Final = 1e9

_column = partial(Metric, criterion=False)
#: columns of a certificate's rows beside those of every sweep
COLUMNS: Final = rows(
    _column("verdict", "verdict", "of the case", kind="str"),
    _column("why", "why", "why the case failed, is void or does not apply", kind="str"),
    _column("fault_begins_s", "begin of the fault", "drive time at which the fault begins"),
    _column("reaction_s", "reaction time", "from the begin of the fault to the required reaction", worse="higher"),
    _column("reacted", "reacted", "whether the required reaction came, where one is measured", kind="bool"),
    _column("distance_left_m", "distance left", "gap at rest to what was ahead", worse="lower"),
    _column("extra_braking_mps2", "extra braking", "during the fault, beyond the nominal drive's at the same time"),
    _column("setpoints_taken", "accepted setpoints", "setpoints of the brain that were accepted", kind="int"),
    _column("setpoints_refused", "rejected setpoints", "number of rejected setpoints by reason code", kind="str"),
    _column("setpoints_sha256", "hash of the setpoints", "SHA-256 of setpoints.csv in the drive's record", kind="str"),
    _column("unheard", "unheard wires", "kinds of wires on whose port the brain did not listen", kind="str"),
)

#: function that waits until a manually started brain is ready for the next case
Ready = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class CertifyQuery:
    """The options of a certificate."""

    rig: str
    scenario: str
    command: str | None  #: command that starts the brain; None: it is started by hand before each case
    cases: tuple[Case, ...]
    seeds: tuple[int, ...]  #: 1 and up
    out: Path  #: folder for the certificate, absent or empty
    values: Mapping[str, Any]  #: of the scenario's keys and parameters
    limits: CertificateLimits = field(default_factory=CertificateLimits)
    workers: int | None = None  #: brains in parallel; None: one a processor if their ports can differ
    resume: bool = False  #: whether to continue the certificate in `out`


class CertificateDesign(Design):
    """The cases of a certificate with every seed; if the brain never answers without a fault, no others of the seed."""

    judges_records = True

    def __init__(self, query: CertifyQuery, working: Path, ready: Ready) -> None:
        """Read rig and scenario; raises ConfigError for a rig whose brain does not answer with setpoints."""
        self.query, self._working, self._ready = query, working, ready
        self.rig_file, self.rig = _rig(query, working)
        self.kinds = tuple(output.kind for output in self.rig.outputs)
        self.places = places.places_of(self.rig, query.command, self._workers())
        _require_program(query.command, working)
        self.brain = under_test(query.command, working)
        self._resolved = resolve_by_name(query.scenario, working, seed=1, rig=query.rig, values=query.values)
        self._file, self._table = table_by_name(query.scenario, working, seed=1, values=query.values)
        super().__init__(self._planned())
        self.results: dict[tuple[str, int], CaseResult] = {}
        self._rows: dict[tuple[str, int], Row] = {}
        self._nominal: dict[int, CaseDrive] = {}
        self._windows: dict[str, Window | None] = {}
        self._free = list(self.places)
        self._taken: dict[str, places.Place] = {}
        self._folder = query.out

    def _workers(self) -> int:
        if self.query.workers is not None:
            return self.query.workers
        return (os.cpu_count() or 1) if places.has_places(self.rig, self.query.command) else 1

    def _planned(self) -> SweepPlan:
        query, driven = self.query, self._resolved.to_dict(self._working)
        car = json.dumps([driven["vehicle"], driven["vehicle_model"]], sort_keys=True)
        # The scenario's controller drives nothing here; whether this process has loaded it says nothing.
        read = {role: one for role, one in driven["files_sha256"].items() if not role.startswith(plugged_in.CONTROLLER)}
        files = {"rig": hash_file(self.rig_file), "scenario": hash_file(self._file), **read}
        files |= {"vehicle model": hashlib.sha256(car.encode()).hexdigest()}
        files |= {f"brain, {name}": digest for name, digest in self.brain.files.items()}
        declared = self._table.get("parameters", {}) | {CASE: {"sets": ["title"], "meaning": "case of the certificate"}}
        return SweepPlan(
            spec={
                "title": f"Certificate of {self.brain.command or 'a brain that was started by hand'}",
                "scenario": query.scenario,
                "values": json.loads(json.dumps(dict(query.values))),
                "brain": self.brain.command,
                "cases": [case.name for case in CASES if case in query.cases or case.name in self._cases_there()],
                "limits": query.limits.to_dict(),
                "seeds": len(query.seeds),
            },
            scenario=self._resolved.name,
            table=self._table | {"parameters": declared},
            file=str(self._file.absolute()),
            working=str(self._working.absolute()),
            cells=len(CASES) * len(query.seeds),
            parameters={CASE: "str"},
            criteria=[],
            files_sha256={role: [digest] for role, digest in sorted(files.items())},
            versions=provenance.decisive_versions(),
            rig=str(self.rig_file.absolute()),
            metrics=[column.to_dict() for column in COLUMNS.values()],
            design="certificate",
        )

    @property
    def rules(self) -> Rules:
        """What every drive is held to."""
        vehicle = self._resolved.vehicle
        return Rules(self.query.limits, self._resolved.scenario.ego.speed_mps, vehicle.steering_limit)

    def _cases_there(self) -> Sequence[str]:
        """Return the cases of the certificate that is continued."""
        continued = self.query.resume and (self.query.out / "sweep.json").is_file()
        plan = SweepPlan.of(self.query.out) if continued else None
        return plan.spec["cases"] if plan is not None and plan.design == "certificate" else ()

    def hold(self, rows: Iterator[Row]) -> list[Row]:
        """Judge every finished drive under the present limits; return the rows of which that changes something.

        Raises ConfigError where a record is not that of the drive, or a case's fault would begin at another time.
        """
        self._rows = {(row[CASE], row["seed"]): row for row in rows}
        for name, seed in sorted(self._rows, key=lambda place: (place[1], NAMES.index(place[0]))):
            self._hold(CASE_BY_NAME[name], seed, self._rows[name, seed])
        judged = {place: columns_of(result) for place, result in self.results.items()}
        return [
            {"number": self._rows[place]["number"], **columns}
            for place, columns in judged.items()
            if any(self._rows[place][name] != value for name, value in columns.items())
        ]

    def _hold(self, case: Case, seed: int, row: Row) -> None:
        """Judge a case that the dataset holds."""
        record, window = self._record(case.name, seed), None
        driven = row["setpoints_sha256"] is not None
        if driven:
            case_record.require_unaltered(record, row)
        if case.name != NOMINAL:
            if seed not in self._nominal:
                raise ConfigError(f"{self._folder}: holds {case.name} with seed {seed} without its {NOMINAL} case")
            undriven, window = self._timing(case, seed, self._listened(seed))
            begins = None if window is None else window.begins
            if driven != (undriven is None) or begins != row["fault_begins_s"]:
                raise ConfigError(
                    f"{record}: its fault began at {row['fault_begins_s']} s, expected {begins} s; choose another --out"
                )
            if undriven is not None:
                self.results[case.name, seed] = undriven
                return
        self._judge(case.name, seed, window, row)

    def runs(self, dataset: Dataset) -> Iterator[RunSpec | Settled | None]:
        """Yield the cases that the dataset does not hold."""
        waiting = list(self.query.seeds)
        for seed in waiting:
            if (NOMINAL, seed) not in self._rows:
                yield from self._offered(NOMINAL, seed, None)
        while waiting:
            timed = [seed for seed in waiting if (NOMINAL, seed) in self._rows]
            if not timed:
                yield None
            for seed in timed:
                waiting.remove(seed)
                yield from self._timed(seed)

    def _timed(self, seed: int) -> Iterator[RunSpec | Settled | None]:
        """Yield the cases of a seed whose nominal drive is over."""
        if not self._nominal[seed].answers:
            return
        for case in self.query.cases[1:]:
            if (case.name, seed) in self._rows:
                continue
            undriven, window = self._timing(case, seed, self._listened(seed))
            if undriven is not None:
                self.results[case.name, seed] = undriven
                yield Settled(run_of(case.name, seed), RunResult(key(case.name, seed), columns_of(undriven)))
            else:
                yield from self._offered(case.name, seed, window)

    def _listened(self, seed: int) -> list[str]:
        """Return the wires that the brain received in the nominal drive of a seed."""
        unheard = (self._rows[NOMINAL, seed]["unheard"] or "").split()
        return [kind for kind in self.kinds if kind not in unheard]

    def _timing(self, case: Case, seed: int, listened: Sequence[str]) -> tuple[CaseResult | None, Window | None]:
        """Return the result of a case that is not driven, or the window of its fault."""
        if why := inapplicable(case, self.kinds) or inapplicable(case, listened):
            silent = "" if inapplicable(case, self.kinds) else "the brain listens to no such wire: "
            return CaseResult(case, seed, CaseVerdict.NOT_APPLICABLE, silent + why), None
        timing = timing_of(case, self._nominal[seed], bumper_of(self._resolved))
        return (CaseResult(case, seed, CaseVerdict.VOID, timing.void) if timing.void else None), timing.window

    def _offered(self, case: str, seed: int, window: Window | None) -> Iterator[RunSpec | None]:
        """Yield a run once a place is free; a brain that is started by hand is waited for."""
        while not self._free:
            yield None
        if self.query.command is None:
            self._ready(case)
        self._windows[key(case, seed)] = window
        yield run_of(case, seed)

    def job(self, run: RunSpec, record: Path | None) -> Job:
        place = self._taken[run.key] = self._free.pop()
        case = CASE_BY_NAME[str(run.values[CASE])]
        log = (self._folder / "brains" / f"{run.key}.log").absolute()
        nominal = self._record(NOMINAL, run.seed).absolute()
        return Job(
            key=run.key,
            name=self.plan.scenario,
            table=self._table | {"seed": run.seed},
            file=self._file,
            working=self._working.absolute(),
            keep=record,
            rig=self.rig_file.absolute(),
            time_limit_s=NO_LIMIT,
            memory_limit_mb=NO_LIMIT,
            driver=DRIVER,
            driven=order(case, self._windows[run.key], place, nominal, log, os.environ),
        )

    def judged(self, run: RunSpec, job: Job, result: RunResult) -> RunResult:
        """Return a drive's result with its verdict; raises VveError for a drive that broke."""
        self._free.append(self._taken.pop(run.key))
        case = str(run.values[CASE])
        if result.error:
            raise _error(case, result.error)
        return replace(
            result, figures=result.figures | self._judge(case, run.seed, self._windows[run.key], result.figures)
        )

    def take(self, row: Row) -> None:
        self._rows[row[CASE], row["seed"]] = row

    def _judge(self, name: str, seed: int, window: Window | None, figures: Mapping[str, Any]) -> dict[str, MetricValue]:
        """Judge a drive by its record; return the columns of its row."""
        case, record = CASE_BY_NAME[name], self._record(name, seed)
        drive = case_record.drive_of(record, figures["setpoints_refused"] or "", figures["setpoints_taken"])
        if name == NOMINAL:
            self._nominal[seed] = drive
        judged = judge(case, window, drive, self._nominal[seed], self.rules)
        self.results[name, seed] = result = CaseResult(
            case,
            seed,
            judged.verdict,
            judged.why,
            window,
            judged.reaction,
            judged.distance_left,
            impact_speed=drive.impact_speed,
            outcome=drive.outcome,
            reasons=tuple(drive.reasons),
            extra_braking=judged.extra_braking,
            last=judged.last,
            record=record.relative_to(self._folder),
            record_sha256=drive.record_sha256,
            drive=drive,
        )
        return columns_of(result)

    def _record(self, case: str, seed: int) -> Path:
        return self._folder / "records" / key(case, seed)


def key(case: str, seed: int) -> str:
    """Return the key of a drive within its certificate."""
    return f"{case}_seed_{seed}"


def run_of(case: str, seed: int) -> RunSpec:
    """Return the run of a case; numbered seed by seed over all cases, so that further ones keep the numbers."""
    return RunSpec((seed - 1) * len(CASES) + NAMES.index(case), key(case, seed), {CASE: case}, seed)


def columns_of(result: CaseResult) -> dict[str, MetricValue]:
    """Return what a row of the dataset holds of a case's result; a row passes by its verdict."""
    return {
        "passed": {CaseVerdict.PASSED: True, CaseVerdict.FAILED: False}.get(result.verdict),
        "failed": result.why if result.verdict is CaseVerdict.FAILED else "",
        "verdict": result.verdict.value,
        "why": result.why,
        "fault_begins_s": None if result.window is None else result.window.begins,
        "reaction_s": finite(result.reaction),
        "reacted": None if result.reaction != result.reaction else finite(result.reaction) is not None,
        "distance_left_m": finite(result.distance_left),
        "extra_braking_mps2": finite(result.extra_braking),
    }


def certify(query: CertifyQuery, working: Path, ready: Ready, progress: Progress) -> Certificate:
    """Drive every case with every seed and return the certificate.

    Raises VveError where a case cannot be driven; finished drives remain for `query.resume`, as after an interrupt.
    """
    design = CertificateDesign(query, working, ready)
    began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    again = f"the same command with --out {query.out} --resume"
    engine = Local(len(design.places))
    drive_into(query.out, design, engine, "all", resume=query.resume, resume_command=again, progress=progress)
    asked = ((case.name, seed) for seed in query.seeds for case in query.cases)
    results = tuple(design.results[one] for one in asked if one in design.results)
    return Certificate(
        rig=design.rig_file.name.removesuffix(".toml"),
        rig_argument=query.rig,
        rig_sha256=hash_file(design.rig_file),
        scenario=query.scenario,
        values=dict(query.values),
        brain=design.brain,
        wires=design.kinds,
        seeds=query.seeds,
        cases=tuple(case.name for case in query.cases),
        limits=query.limits,
        results=results,
        defects=diagnose(results),
        software=provenance.software(),
        began_utc=began,
    )


def _error(case: str, error: str) -> ConfigError | RigError | SimulationError:
    """Return the exception of a drive that broke, by the prefix of its error."""
    for prefix, kind in ((CONFIG, ConfigError), (RIG, RigError)):
        if error.startswith(prefix):
            return kind(error.removeprefix(prefix))
    return SimulationError(f"case {case}: {error}")


def _rig(query: CertifyQuery, working: Path) -> tuple[Path, Rig]:
    file = workspace.find("rig", query.rig, working)
    rig = load_rig(file, working)
    if rig.brain.kind != "setpoints":
        raise ConfigError(
            f"{file}: brain.kind is {rig.brain.kind!r}, expected 'setpoints': lockstep waits for the brain, and only a "
            "setpoint shows that it has answered"
        )
    if "radar" not in (output.kind for output in rig.outputs):
        raise ConfigError(f"{file}: outputs: expected one of kind 'radar', which a setpoint answers")
    return file, rig


def _require_program(command: str | None, working: Path) -> None:
    """Raise ConfigError for a command whose program is not there, before anything is written."""
    if command is None:
        return
    try:
        program = shlex.split(command)[:1]
    except ValueError as error:
        raise ConfigError(f"--brain: {command!r} cannot be started: {error}") from None
    if not program:
        raise ConfigError("--brain: expected the command that starts the brain, got nothing")
    if shutil.which(working / program[0] if "/" in program[0] else program[0]) is None:
        raise ConfigError(f"--brain: {command!r} cannot be started: no program {program[0]!r}")


def under_test(command: str | None, working: Path) -> BrainUnderTest:
    """Return a brain's command with the hashes of the files that it names."""
    arguments = shlex.split(command or "")
    files = {argument: working / argument for argument in arguments}
    return BrainUnderTest(
        command or "", {argument: hash_file(file) for argument, file in files.items() if file.is_file()}
    )
