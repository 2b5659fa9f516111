"""Drives a brain through the cases, each with a new process of it, in lockstep over the wires of a rig.

It knows how a drive and a brain are started and ended; it must not know what a case requires.
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import math
import shlex
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np

from vve_sumo import workspace
from vve_sumo.analysis.run import Run
from vve_sumo.certify.brain_process import BrainProcess
from vve_sumo.certify.cases import Case, applies
from vve_sumo.certify.diagnosis import diagnose
from vve_sumo.certify.judge import BROKEN, judge, window_of
from vve_sumo.certify.link import Answer, FaultLink, FaultyWire, Window
from vve_sumo.certify.results import BrainUnderTest, CaseResult, Certificate, Course, Verdict
from vve_sumo.drive import provenance
from vve_sumo.drive.brain import Brain, Publisher, SetpointController, virtual_placement
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.drive.run import Drive, resolve_by_name
from vve_sumo.drive.run import run as run_drive
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.live.brain_link import key_of, open_setpoints
from vve_sumo.live.outputs import opened
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig
from vve_sumo.wire.outputs import Context
from vve_sumo.wire.setpoints import SetpointInbox

#: a brain that nobody can look at is taken to be quiet after so long [s]
UNSEEN_QUIET: Final = 0.1
#: file beside a case's record: every setpoint as it came over the wire
ANSWERS: Final = "setpoints.csv"
#: folder for the drives of the cases
CASES: Final = "cases"

#: waits until a brain that is started by hand is ready for the next case
Ready = Callable[[str], None]
#: called with the results so far
Done = Callable[[Sequence[CaseResult]], None]


@dataclass(frozen=True, slots=True)
class CertifyQuery:
    """What is asked of a certificate."""

    rig: str
    scenario: str
    command: str | None  #: that starts the brain; None: somebody starts it by hand before each case
    cases: tuple[Case, ...]
    seeds: tuple[int, ...]
    out: Path  #: folder for the certificate, absent or empty
    values: Mapping[str, Any]  #: of the scenario's keys and parameters


class Bench:
    """What all cases have in common: the rig, its wires and ports, the brain's command."""

    def __init__(self, query: CertifyQuery, working: Path, ready: Ready) -> None:
        """Read the rig; raises ConfigError for one without a brain that answers with setpoints."""
        self.query, self.working, self._ready = query, working, ready
        self.rig_file = workspace.find("rig", query.rig, working)
        self.rig: Rig = load_rig(self.rig_file, working)
        if self.rig.brain.kind != "setpoints":
            raise ConfigError(
                f"{self.rig_file}: brain.kind is {self.rig.brain.kind!r}, expected 'setpoints': in lockstep a brain is "
                "waited for, and only its setpoints tell when it has answered"
            )
        self.kinds = tuple(output.kind for output in self.rig.outputs)
        if "radar" not in self.kinds:
            raise ConfigError(f"{self.rig_file}: outputs: expected one of kind 'radar', which a setpoint answers")
        if query.out.exists() and (not query.out.is_dir() or any(query.out.iterdir())):
            raise ConfigError(f"--out: {query.out} is not empty, expected a folder that is absent or empty")
        self._key = key_of(self.rig.brain, working)

    def resolved(self, seed: int) -> ResolvedScenario:
        """Return the scenario with a seed and the rig's car."""
        query = self.query
        return resolve_by_name(query.scenario, self.working, seed=seed, rig=query.rig, values=query.values)

    def _ports(self) -> list[int]:
        places = [output.udp.rpartition(":") for output in self.rig.outputs if output.udp is not None]
        return [int(port) for host, _, port in places if host.startswith("127.") or host == "localhost"]

    def drive(self, case: Case, resolved: ResolvedScenario, window: Window | None, folder: Path) -> Course:
        """Drive a case into a folder of its own and return its course."""
        folder.mkdir(parents=True)
        with self._brain(case, folder) as quiet, ExitStack() as stack:
            link = self._link(case, resolved, window, quiet)
            stack.callback(link.close)
            done = run_drive(resolved, folder / "record", self.working, brain=self._driven(resolved, link))
        if done.summary["outcome"] in BROKEN:
            if done.summary["outcome"] == "interrupted":
                raise KeyboardInterrupt
            raise SimulationError(f"case {case.name}: {done.summary['text'] or done.summary['reasons']}")
        _write_answers(folder / ANSWERS, link.answers)
        return course_of(done, link.answers)

    @contextmanager
    def _brain(self, case: Case, folder: Path) -> Iterator[Callable[[], bool]]:
        """Give a brain that listens; yields what says whether it is quiet."""
        if self.query.command is None:
            self._ready(case.name)
            yield _unseen
            return
        process = BrainProcess(self.query.command, self._ports(), folder / "brain.log", self.working)
        try:
            process.wait_until_it_listens()
            yield process.quiet
        finally:
            process.close()

    def _link(
        self, case: Case, resolved: ResolvedScenario, window: Window | None, quiet: Callable[[], bool]
    ) -> FaultLink:
        said, context = (
            self.rig.brain,
            Context(resolved.vehicle, resolved.map_frame.projection, resolved.map_frame.offset, key=self._key),
        )
        wires = opened([output.model_dump(mode="json") for output in self.rig.outputs], context)
        try:
            setpoints = open_setpoints(said, self._key)
        except BaseException:
            for wire in wires:
                wire.outlet.close()
            raise
        chance = Random(f"{case.name} {resolved.scenario.seed}")
        faulty = [
            FaultyWire(wire.output, wire.outlet, case.make(chance) if case.make and kind in case.wires else None)
            for kind, wire in zip(self.kinds, wires, strict=True)
        ]
        return FaultLink(faulty, setpoints, window, quiet, said.deadline_s, self._key)

    def _driven(self, resolved: ResolvedScenario, link: FaultLink) -> Brain:
        placement = virtual_placement(resolved.map_frame, resolved.model.mounting, DEFAULT_EPOCH)
        publisher = Publisher(link.send, placement, DEFAULT_EPOCH)
        inbox = SetpointInbox(DEFAULT_EPOCH, self._key)
        return Brain(publisher, SetpointController(publisher, link.receive, inbox, waits=True))


def _unseen() -> bool:
    time.sleep(UNSEEN_QUIET)
    return True


def certify(query: CertifyQuery, working: Path, ready: Ready, done: Done) -> Certificate:
    """Drive every case with every seed and return the certificate; raises VveError where one cannot be driven.

    Where the nominal drive of a seed has no answer at all, its other cases are not driven. A ConfigError in the first
    drive leaves nothing behind.
    """
    bench = Bench(query, working, ready)
    scenarios = {seed: bench.resolved(seed) for seed in query.seeds}
    began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    there = query.out.exists()
    query.out.mkdir(parents=True, exist_ok=True)
    results: list[CaseResult] = []
    try:
        for seed, resolved in scenarios.items():
            for result in _of_seed(bench, seed, resolved):
                results.append(result)
                done(results)
    except ConfigError:
        if not results:
            _clear(query.out, remove=not there)
        raise
    return Certificate(
        rig=str(bench.rig_file.name.removesuffix(".toml")),
        rig_asked=query.rig,
        rig_sha256=_digest(bench.rig_file),
        scenario=query.scenario,
        values=dict(query.values),
        brain=under_test(query.command, working),
        wires=bench.kinds,
        seeds=query.seeds,
        cases=tuple(case.name for case in query.cases),
        results=tuple(results),
        defects=diagnose(results),
        software=provenance.software(),
        began_utc=began,
    )


def _clear(folder: Path, *, remove: bool) -> None:
    """Take back what was written before the first drive was over; with `remove`, the folder too."""
    shutil.rmtree(folder / CASES, ignore_errors=True)
    if remove:
        with suppress(OSError):  # not empty: somebody else has put something there
            folder.rmdir()


def _of_seed(bench: Bench, seed: int, resolved: ResolvedScenario) -> Iterator[CaseResult]:
    nominal: Course | None = None
    for case in bench.query.cases:
        if not applies(case, bench.kinds):
            yield CaseResult(case, seed, Verdict.NOT_APPLICABLE, f"the rig has no wire of {', '.join(case.wires)}")
            continue
        folder = bench.query.out / CASES / case.name / f"seed_{seed}"
        window = None if nominal is None else window_of(case, nominal)
        course = bench.drive(case, resolved, window, folder)
        yield _result(bench, case, seed, window, course, nominal)
        if nominal is None:
            nominal = course
            if not course.answers:
                return


def _result(
    bench: Bench, case: Case, seed: int, window: Window | None, course: Course, nominal: Course | None
) -> CaseResult:
    judged = judge(case, window, course, nominal)
    record = Path(CASES) / case.name / f"seed_{seed}" / "record"
    result = CaseResult(case, seed, judged.verdict, judged.why, window, judged.reaction, judged.left)
    return replace(
        result,
        impact_speed=course.impact_speed,
        outcome=course.outcome,
        reasons=tuple(course.reasons),
        extra_braking=judged.extra_braking,
        last=judged.last,
        record=record,
        record_sha256=course.record_sha256,
        course=course,
    )


def course_of(done: Drive, answers: Sequence[Answer]) -> Course:
    """Return the course of a drive that is over, from its record."""
    run, summary = Run(done.folder), done.summary
    number = partial(_number, summary)
    ticks = run.arrow("ticks")
    return Course(
        time=np.asarray(run.time, np.float64),
        speed=ticks["true_speed_mps"].to_numpy(),
        gap=np.asarray(run.lead.gap, np.float64),
        answers=tuple(answers),
        outcome=str(summary["outcome"]),
        reasons=tuple(summary["reasons"]),
        collision=bool(summary["collision"]),
        impact_speed=number("impact_speed_mps") if summary["collision"] else math.nan,
        stop_gap=number("stop_gap_m"),
        unmet=tuple(summary["failed"]),
        record_sha256=str(summary["record_sha256"]),
    )


def _number(summary: Mapping[str, Any], name: str) -> float:
    value = summary.get(name)
    return math.nan if value is None else float(value)


def _write_answers(file: Path, answers: Sequence[Answer]) -> None:
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(("time_s", "answers", "newest", "steering_rad", "acceleration_mps2"))
        writer.writerows((f"{a.time:.3f}", a.answers, a.newest, a.steering, a.acceleration) for a in answers)


def under_test(command: str | None, working: Path) -> BrainUnderTest:
    """Return a brain's command with the hashes of every word of it that is a file."""
    words = shlex.split(command or "")
    files = {word: working / word for word in words}
    return BrainUnderTest(command or "", {word: _digest(file) for word, file in files.items() if file.is_file()})


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
