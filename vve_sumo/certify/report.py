"""The certificate as one page for people, and as `certificate.json` for programs.

It knows a certificate's values and the parts of a page; not how a case was driven.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo.certify.cases import NAMES, Case, Reaction
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.results import CaseResult, CaseVerdict, Certificate
from vve_sumo.drive.reasons import in_words
from vve_sumo.plotting.wire_fault import WireFaultDrive, wire_fault
from vve_sumo.report.formatting import NONE, count, number
from vve_sumo.report.key_figures import KeyFigure
from vve_sumo.report.page import ReportPage, hashes, versions
from vve_sumo.report.picture import DrawnPlot, picture_of
from vve_sumo.report.tables import Cell, Column, ReportTable
from vve_sumo.report.verdict import ReportVerdict
from vve_sumo.report.write import save

JSON: Final = "certificate.json"
#: changes with what `certificate.json` holds
VERSION: Final = 2
#: largest number of pictures; those of failed drives come first
MAX_PICTURES: Final = 30
_MARK: Final = {
    CaseVerdict.PASSED: "yes",
    CaseVerdict.FAILED: "no",
    CaseVerdict.VOID: "no",
    CaseVerdict.NOT_APPLICABLE: "quiet",
}
#: meaning of each limit, with its unit
_LIMITS: Final = {
    "min_left_m": "smallest gap at rest to the obstacle [m]",
    "max_left_m": "largest gap at rest to the obstacle where the brain has to carry on [m]",
    "max_deviation_m": "largest distance of the rear axle from the path at any time [m]",
    "max_overspeed_mps": "largest excess over the scenario's speed at any time [m/s]",
}
CAPTION: Final = (
    "Above: the car's true speed and the gap to what was ahead. Below: the acceleration of every setpoint that came "
    "over the wire; where there is no point, the brain sent none. The time of the fault is shaded."
)


def write(certificate: Certificate, folder: Path) -> Path:
    """Write certificate.json and the page into a folder; return the page's path."""
    (folder / JSON).write_text(json.dumps(to_dict(certificate), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return save(page_of(certificate), folder)


def to_dict(certificate: Certificate) -> dict[str, Any]:
    """Return the content of certificate.json; a missing number is null, a reaction that never came is `never`."""
    brain = certificate.brain
    return {
        "version": VERSION,
        "passed": certificate.passed,
        "verdict": certificate.verdict,
        "limits": certificate.limits.to_dict(),
        "left_out": _left_out(certificate),
        "defects": [{"name": one.name, "cases": list(one.cases)} for one in certificate.defects],
        "brain": {"command": brain.command, "files_sha256": dict(brain.files)},
        "rig": certificate.rig,
        "rig_sha256": certificate.rig_sha256,
        "scenario": certificate.scenario,
        "values": dict(certificate.values),
        "wires": list(certificate.wires),
        "seeds": list(certificate.seeds),
        "began_utc": certificate.began_utc,
        "software": dict(certificate.software),
        "results": [_result(result) for result in certificate.results],
    }


def _result(result: CaseResult) -> dict[str, Any]:
    case, window, last = result.case, result.window, result.last
    return {
        "case": case.name,
        "seed": result.seed,
        "verdict": result.verdict.value,
        "why": result.why,
        "injected": case.injected,
        "fault_begins_s": None if window is None else _plain(window.begins),
        "fault_ends_s": None if window is None else _plain(window.ends),
        "required": case.reaction.value,
        "required_within_s": _plain(case.within),
        "reaction_s": "never" if math.isinf(result.reaction) else _plain(result.reaction),
        "distance_left_m": _plain(result.distance_left),
        "impact_speed_mps": _plain(result.impact_speed),
        "outcome": result.outcome,
        "reasons": list(result.reasons),
        "extra_braking_mps2": _plain(result.extra_braking),
        "last_setpoint_s": None if last is None else _plain(last.time),
        "last_setpoint_age_ticks": None if last is None else last.newest - last.answers,
        "last_setpoint_acceleration_mps2": None if last is None else _plain(last.acceleration),
        "record": None if result.record is None else result.record.as_posix(),
        "record_sha256": result.record_sha256,
    }


def _plain(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def page_of(certificate: Certificate) -> ReportPage:
    """Return the page."""
    drives = [result for result in certificate.results if result.verdict in (CaseVerdict.PASSED, CaseVerdict.FAILED)]
    failed = [result for result in drives if result.verdict is CaseVerdict.FAILED]
    return ReportPage(
        template="certificate.html.j2",
        kind="Certificate of a control computer at its wires",
        title=_title(certificate),
        verdict=ReportVerdict(certificate.verdict, tuple(_sentences(certificate, drives, failed))),
        key_figures=_key_figures(certificate, drives),
        pictures=_pictures(drives, failed),
        sources=(),
        content={
            "timing": "A fault begins by the drive without a fault of the same seed: 5 s before the brain began to "
            "brake to rest (cruise), 1 s before it (approach), 1 s after it (braking), or in a bend. Where that drive "
            "brakes by itself within the time for the reaction, the fault begins at another time.",
            "limits": _limits(certificate),
            "cases": _cases(certificate),
            "defects": ReportTable(
                "likely defects", ("defect", "by"), [(d.name, ", ".join(d.cases)) for d in certificate.defects]
            ),
            "drives": _drives(drives),
            "reasons": _reasons(certificate),
            "provenance": _provenance(certificate),
            "again": reproduce_command(certificate),
            "versions": versions(_versions(certificate)),
            "file_hashes": hashes([("rig", certificate.rig_sha256), *certificate.brain.files.items()], "files"),
            "record_hashes": hashes([(result.key, result.record_sha256) for result in drives], "records"),
        },
    )


def _title(certificate: Certificate) -> str:
    brain = certificate.brain
    arguments = [*brain.files, *brain.command.split()]
    name = Path(arguments[0]).name if arguments else "a brain that was started by hand"
    return f"{name} in {certificate.scenario}, rig {certificate.rig}"


def _sentences(certificate: Certificate, drives: list[CaseResult], failed: list[CaseResult]) -> Iterator[str]:
    cases = count(len({result.case.name for result in drives}), "case")
    seeds = count(len(certificate.seeds), "seed")
    yield f"{len(drives) - len(failed)} of {len(drives)} drives passed: {cases}, {seeds}."
    if certificate.defects:
        yield f"Likely: {'; '.join(defect.name for defect in certificate.defects)}."
    void = sorted({r.case.name for r in certificate.results if r.verdict is CaseVerdict.VOID})
    if void:
        yield f"Not tested, and so not passed: {', '.join(void)}. The nominal drive has no suitable time for the fault."
    if absent := _left_out(certificate):
        yield f"Left out by the command: {', '.join(absent)}."
    left_out = sorted({r.case.name for r in certificate.results if r.verdict is CaseVerdict.NOT_APPLICABLE})
    if left_out:
        yield f"Not applicable to this rig's wires: {', '.join(left_out)}."


def _left_out(certificate: Certificate) -> list[str]:
    return [name for name in NAMES if name not in certificate.cases]


def _limits(certificate: Certificate) -> ReportTable:
    rows = [
        (Cell(name, kind="code"), number(value, "", 2), _LIMITS[name])
        for name, value in certificate.limits.to_dict().items()
    ]
    return ReportTable("limits", ("limit", "value", "meaning"), rows)


def _key_figures(certificate: Certificate, drives: list[CaseResult]) -> list[KeyFigure]:
    hits = [result for result in drives if math.isfinite(result.impact_speed)]
    left = [result.distance_left for result in drives if math.isfinite(result.distance_left)]
    timed = [result.reaction for result in drives if not math.isnan(result.reaction)]
    return [
        KeyFigure("contacts", str(len(hits)), kind="no" if hits else "yes"),
        KeyFigure("least distance left", number(min(left, default=math.nan), "m")),
        KeyFigure("slowest reaction", "never" if math.inf in timed else number(max(timed, default=math.nan), "s")),
        KeyFigure("wires", ", ".join(certificate.wires)),
    ]


def _cases(certificate: Certificate) -> ReportTable:
    columns = ("case", "injected", "begins", "lasts", "required", "passed", "verdict")
    rows = []
    for case in dict.fromkeys(result.case for result in certificate.results):
        of_case = [result for result in certificate.results if result.case is case]
        worst = min(of_case, key=lambda result: _WORST.index(result.verdict))
        passed = sum(result.verdict is CaseVerdict.PASSED for result in of_case)
        mark: Any = _MARK[worst.verdict]
        rows.append(
            (
                Cell(case.name, kind="code"),
                case.injected,
                NONE if not case.injects else case.begins.value,
                _lasts(case),
                required(case),
                f"{passed} of {len(of_case)}",
                Cell(worst.verdict.value, worst.why, mark),
            )
        )
    return ReportTable("cases", columns, rows)


_WORST: Final = (CaseVerdict.FAILED, CaseVerdict.VOID, CaseVerdict.PASSED, CaseVerdict.NOT_APPLICABLE)


def _lasts(case: Case) -> str:
    if not case.injects:
        return NONE
    return "to the end" if math.isinf(case.lasts) else number(case.lasts, "s", 2)


def required(case: Case) -> str:
    """Return the required reaction and its time as text."""
    time = "" if math.isinf(case.within) else f" within {case.within:g} s"
    rest = {
        Reaction.STOP: f"no answer, or nothing but braking,{time} and from then on; no contact",
        Reaction.BRAKE: f"brake{time}; no contact",
        Reaction.HOLD: "no contact",
    }
    return rest.get(case.reaction, case.reaction.value)


def _drives(drives: list[CaseResult]) -> ReportTable:
    heads = ("fault at [s]", "reaction [s]", "left [m]")
    columns = [
        Column("drive"),
        *(Column(head, True) for head in heads),
        Column("last setpoint"),
        Column("ended"),
        Column("verdict"),
    ]
    rows = []
    for result in drives:
        mark: Any = _MARK[result.verdict]
        ended = ", ".join((result.outcome, *map(in_words, result.reasons)))
        rows.append(
            (
                result.key,
                NONE if result.window is None else number(result.window.begins, "", 2),
                "never" if math.isinf(result.reaction) else number(result.reaction, "", 2),
                number(result.distance_left, "", 2),
                _last(result),
                ended,
                Cell(f"{result.verdict.value}{': ' if result.why else ''}{result.why}", kind=mark),
            )
        )
    return ReportTable("drives", columns, rows)


def _last(result: CaseResult) -> str:
    last = result.last
    if last is None:
        return NONE
    demand = f"{number(last.acceleration, 'm/s²', 2)} at {number(last.time, 's', 2)}"
    return f"{demand}, to a datagram {last.newest - last.answers} ticks old"


def _reasons(certificate: Certificate) -> ReportTable:
    cases = dict.fromkeys(result.case for result in certificate.results)
    return ReportTable("reasons", ("case", "why"), [(Cell(case.name, kind="code"), case.why) for case in cases])


def _provenance(certificate: Certificate) -> ReportTable:
    return ReportTable(
        "provenance",
        ("what", "value"),
        [
            ("brain", Cell(certificate.brain.command or "started by hand", kind="code")),
            ("rig", certificate.rig),
            ("scenario", certificate.scenario),
            ("set otherwise", ", ".join(f"{key} = {value}" for key, value in certificate.values.items()) or NONE),
            ("seeds", ", ".join(map(str, certificate.seeds))),
            ("begun", certificate.began_utc),
            ("code", Cell(str(certificate.software["code"]["sha256"]), kind="hash")),
        ],
    )


def _versions(certificate: Certificate) -> dict[str, str]:
    software = certificate.software
    return {"python": str(software["python"]), **{str(k): str(v) for k, v in software["libraries"].items()}}


def reproduce_command(certificate: Certificate) -> str:
    """Return the command that drives the certificate again."""
    arguments = [
        "vve-sumo",
        "certify",
        certificate.scenario,
        "--rig",
        certificate.rig_argument,
        "--seeds",
        str(max(certificate.seeds)),
    ]
    if certificate.cases != NAMES:
        arguments += ["--cases", ",".join(certificate.cases)]
    for name, value in certificate.limits.to_dict().items():
        if value != CertificateLimits().to_dict()[name]:
            arguments += ["--limit", f"{name}={value:g}"]
    for key, value in certificate.values.items():
        # Booleans and lists are written alike in JSON and TOML.
        arguments += ["--set", f"{key}={value if isinstance(value, str) else json.dumps(value)}"]
    if certificate.brain.command:
        arguments += ["--brain", certificate.brain.command]
    return shlex.join(arguments)


def _pictures(drives: list[CaseResult], failed: list[CaseResult]) -> list[DrawnPlot]:
    """Return a picture of each failed drive, then of the first drive of each case that has none yet."""
    first = {result.case.name: result for result in reversed(drives)}
    others = [result for name, result in reversed(first.items()) if name not in {one.case.name for one in failed}]
    return [_picture(result) for result in (*failed, *others)[:MAX_PICTURES] if result.drive is not None]


def _picture(result: CaseResult) -> DrawnPlot:
    drive, window = result.drive, result.window
    assert drive is not None
    begins = math.nan if window is None else window.begins
    drawn = WireFaultDrive(
        title=f"{result.key}: {result.case.injected} · {result.verdict.value}",
        time=drive.time,
        speed=drive.speed,
        gap=drive.gap,
        answered=np.array([answer.time for answer in drive.answers]),
        acceleration=np.array([answer.acceleration for answer in drive.answers]),
        begins=begins,
        ends=math.nan if window is None else window.ends,
        deadline=begins + result.case.within if math.isfinite(result.case.within) else math.nan,
    )
    file = f"{result.case.name}_seed_{result.seed}"
    return picture_of(
        wire_fault(drawn), file, f"{result.key} over time", f"{result.key}: {result.why or 'passed'}. {CAPTION}"
    )
