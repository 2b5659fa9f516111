"""The dossier of a test day: what a rig is, what holds it, what was tried, who signs; as one page.

Knows what the page says; neither how it is set nor how anything on it was measured. It reads files and moves nothing.
"""

from __future__ import annotations

import datetime
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.commissioning import doctor_result, watchdog_record
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.drive.provenance import software
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_file
from vve_sumo.report.formatting import NONE, count, number
from vve_sumo.report.key_figures import KeyFigure
from vve_sumo.report.page import ReportPage, hashes, versions
from vve_sumo.report.tables import Cell, Column, ReportTable, Row
from vve_sumo.report.verdict import ReportVerdict, Word
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.dates import stated_days
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import arming_obstacle
from vve_sumo.safety import evidence, hazard_tables
from vve_sumo.safety.briefing import briefing
from vve_sumo.safety.lot_picture import lot_picture
from vve_sumo.safety.rig_features import features_of
from vve_sumo.vehicle.interface import load
from vve_sumo.version import __version__

BLANK: Final = Cell("", kind="blank")
#: speeds at which stops are listed [m/s], besides the rig's limit: 5 km/h and the watchdog test's
SPEEDS: Final = (5.0 / 3.6, 5.0)
DRIVER_TIME: Final = 1.0  #: that a driver may need [s], as the watchdog test reckons
_COMMANDERS: Final = {
    "own": "the scenario's controller",
    "setpoints": "an external controller, by setpoints",
    "external": "an external controller itself: no frame is sent from here",
}
_MARKS: Final = {CheckResult.GO: "yes", CheckResult.NO_GO: "no", CheckResult.NOTE: "quiet"}


@dataclass(frozen=True, slots=True)
class DossierInput:
    """What a dossier is asked of."""

    rig: str
    scenario: str
    working: Path
    now: datetime.datetime  #: with its time zone
    records: Sequence[Path] = ()
    matrix: Path | None = None
    hunt: Path | None = None
    certificate: Path | None = None
    rig_file: Path = field(init=False)

    def __post_init__(self) -> None:
        """Find the rig's file; raises ConfigError for one that is not there."""
        object.__setattr__(self, "rig_file", workspace.find("rig", self.rig, self.working))


def dossier(wanted: DossierInput) -> ReportPage:
    """Return the page; raises ConfigError for a rig that is refused, and for evidence that is none."""
    rig = rigs.load(wanted.rig_file, wanted.working)
    result = doctor_result.last(wanted.rig_file, wanted.working, wanted.now)
    shown = lot_picture(wanted.scenario, wanted.rig, wanted.working)
    day = briefing().of(features_of(rig))
    rig_sha256 = hash_file(wanted.rig_file)
    return ReportPage(
        template="dossier.html.j2",
        kind="Dossier of a test day",
        title=f"{rig.title}, {wanted.now:%Y-%m-%d}",
        verdict=_verdict(rig, result, wanted.now.date()),
        key_figures=_key_figures(rig),
        pictures=[] if shown.picture is None else [shown.picture],
        sources=(),
        content={
            "real": rig.car == "real",
            "lot_lines": shown.lines,
            "item": _item(rig, wanted.scenario),
            "days": _days(rig, wanted.now.date()),
            "stops": _stops(rig),
            "limits": _limits(rig),
            "doctor": _doctor(result),
            "doctor_line": _doctor_line(result),
            "watchdog": _watchdog(rig),
            "watchdog_records": _watchdog_records(rig, wanted.working),
            "drives": _drives(wanted.records),
            "tried": _tried(wanted, rig_sha256),
            "roles": ReportTable(
                "roles",
                ("role", "does", "never", "knows", "name", "signature"),
                [(one.title, one.does, one.must_not, one.knows, BLANK, BLANK) for one in day.roles],
            ),
            "checklists": [
                (
                    one.title,
                    ReportTable(one.title, ("", "done by", "at"), [(item.text, BLANK, BLANK) for item in one.items]),
                )
                for one in day.checklists
            ],
            "hazards": hazard_tables.hazards(),
            "constraints": hazard_tables.constraints(),
            "actions": hazard_tables.actions(),
            "residuals": hazard_tables.residual_risks(),
            "versions": versions(_versions()),
            "file_hashes": hashes(list(_hashes(wanted, rig, rig_sha256)), "files"),
            "again": _command(wanted),
            "made": f"{wanted.now:%Y-%m-%d %H:%M} UTC",
        },
    )


def _verdict(rig: Rig, result: Mapping[str, Any], today: datetime.date) -> ReportVerdict:
    """Return what the doctor said and whether the rig may arm; a GO that may not hold any more is none."""
    against = doctor_result.obstacle(dict(result))
    arming = arming_obstacle(rig, today)
    word: Word = "not examined" if result["verdict"] == "none" else "NO-GO" if against or arming else "GO"
    sentences = [_sentence(against or f"The doctor said GO of this rig file on {result['date_utc']}")]
    if arming is not None:
        sentences.append(_sentence(f"Not to be armed, --shadow alone: {arming}"))
    test = rig.watchdog_test
    if test is not None and not test.armed:
        sentences.append("The watchdog is not armed: when the gateway dies, the driver alone stops the car.")
    if rig.car == "simulated":
        sentences.append("A simulated vehicle: nothing on this page is about a real car.")
    return ReportVerdict(word, tuple(sentences))


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


def _key_figures(rig: Rig) -> list[KeyFigure]:
    stops, lot = meaning.stops_of(rig), meaning.lot_of(rig)
    speed = rig.limits.speed_mps

    def distance(stop: Any) -> str:
        return number(stop.distance(speed, 0.0, stops.downhill), "m", 1)

    test = rig.watchdog_test
    watchdog = "never tested" if test is None else "armed" if test.armed else "not armed: the car rolls"
    return [
        KeyFigure("speed limit of the rig", number(speed, "m/s", 1), note=f"{3.6 * speed:.0f} km/h"),
        KeyFigure("gateway's stop from there", distance(stops.gateway)),
        KeyFigure("watchdog's stop from there", distance(stops.watchdog), note=watchdog),
        KeyFigure("lot", f"{lot.area:.0f} m²", note=f"margin {lot.margin:g} m, {count(len(lot.holes), 'hole')}"),
        KeyFigure("friction, slope", f"{rig.lot.friction:g}, {rig.lot.grade_percent:g} %"),
    ]


def _item(rig: Rig, scenario: str) -> ReportTable:
    facts = load(meaning.interface_of(rig)).facts
    mounting, bus, button = rig.mounting, rig.bus, rig.operator.stop_can_id
    people = ", ".join(f"{one.id}, at least {one.least_distance_m:g} m from the lot" for one in rig.people)
    rows: list[Row] = [
        ("car", f"{rig.car}, model {rig.vehicle.model}, {rig.vehicle.mass_kg:g} kg"),
        ("drive-by-wire", f"{facts.title} on {bus.interface} {bus.channel}, {bus.bitrate} bit/s"),
        ("when commands stop", facts.when_commands_stop.words),
        ("receiver", f"{rig.pose.kind}, {meaning.receiver_of(rig).place()}, clock {rig.pose.clock}"),
        ("its output point", f"{mounting.forward_m:g} m ahead, {mounting.left_m:g} m left of the rear axle"),
        ("alignment", rig.alignment.kind),
        ("who commands", _COMMANDERS[rig.brain.kind]),
        ("stop button on the bus", NONE if button is None else f"0x{button:X}"),
        ("real people in the street", people or NONE),
        ("scenario of the picture", scenario),
    ]
    return ReportTable("the rig", ("what", "as declared"), rows)


def _days(rig: Rig, today: datetime.date) -> ReportTable:
    rows = []
    for stated in stated_days(rig):
        expired = stated.has_expired(today) or stated.is_to_come(today)
        until = "does not expire"
        if stated.valid_days is not None:
            until = f"{stated.day + datetime.timedelta(days=stated.valid_days)}"
        age = f"{(today - stated.day).days} days ago"
        rows.append((Cell(stated.key, kind="code"), str(stated.day), Cell(age, kind="no" if expired else ""), until))
    return ReportTable("days", ("stated in", "day", "age", "good until"), rows)


def _stops(rig: Rig) -> ReportTable:
    """Return how far each layer lets the car go, down the lot's worst slope, and a driver's second beside it."""
    stops, limit = meaning.stops_of(rig), rig.limits.speed_mps
    speeds = sorted({*(speed for speed in SPEEDS if speed < limit), 0.5 * limit, limit})
    columns = [
        Column("from [m/s]", True),
        Column("[km/h]", True),
        Column("gateway [m]", True),
        Column("watchdog [m]", True),
        Column("driver's second [m]", True),
    ]
    rows = [
        (
            number(speed, "", 2),
            number(3.6 * speed, "", 0),
            *(number(stop.distance(speed, 0.0, stops.downhill), "", 1) for stop in (stops.gateway, stops.watchdog)),
            number(DRIVER_TIME * speed, "", 1),
        )
        for speed in speeds
    ]
    return ReportTable("stops", columns, rows)


def _limits(rig: Rig) -> ReportTable:
    limits = meaning.limits_of(rig)
    comfort, emergency = limits.comfort, limits.emergency
    figures = (
        ("speed", rig.limits.speed_mps, "m/s"),
        ("acceleration", comfort.acceleration, "m/s²"),
        ("braking of every setpoint", comfort.deceleration, "m/s²"),
        ("jerk of a pedal pressed further", comfort.jerk, "m/s³"),
        ("emergency braking, where asked for", emergency.deceleration, "m/s²"),
        ("jerk of emergency braking", emergency.jerk, "m/s³"),
        ("lateral acceleration", limits.lateral_acceleration, "m/s²"),
        ("lateral jerk", comfort.lateral_jerk, "m/s³"),
        ("the gateway's stop", limits.stop_deceleration, "m/s²"),
        ("after a critical fault", limits.critical_deceleration, "m/s²"),
    )
    rows: list[Row] = [(name, number(value, unit, 1)) for name, value, unit in figures]
    rows += [
        ("late ticks until a stop", f"{rig.latency.breaches} of a second over {rig.latency.budget_ms:g} ms"),
        ("how hard the car brakes", meaning.braking_of(rig, load(meaning.interface_of(rig)).facts).in_words()),
    ]
    return ReportTable("limits", ("limit", Column("value")), rows)


def _doctor_line(result: Mapping[str, Any]) -> str:
    if result["verdict"] == "none":
        return "The doctor has not examined this rig in this folder: vve-sumo doctor --rig … does."
    caveats = f", but it is {' and '.join(result['caveats'])}" if result["caveats"] else ""
    return f"{result['verdict']} on {result['date_utc']}, with scenario {result.get('scenario', NONE)}{caveats}."


def _doctor(result: Mapping[str, Any]) -> ReportTable:
    rows: list[Row] = []
    for check in result.get("checks", ()):
        mark: Any = _MARKS.get(check["finding"], "")
        rows.append((check["name"], Cell(check["finding"], kind=mark), check["found"]))
    return ReportTable("the doctor's checks", ("check", "", "found"), rows)


def _watchdog(rig: Rig) -> ReportTable:
    test = rig.watchdog_test
    if test is None:
        return ReportTable("watchdog test", ("what", "value"), [("test", Cell("none", kind="no"))])
    strength = meaning.watchdog_deceleration_of(rig, load(meaning.interface_of(rig)).facts)
    rows: list[Row] = [
        ("armed", Cell("yes", kind="yes") if test.armed else Cell("NO: the driver alone", kind="no")),
        ("day", str(test.date)),
        ("deceleration, as the rig says", number(test.deceleration_mps2, "m/s²")),
        ("after the last frame", number(test.delay_s, "s")),
        ("what the fence reckons with", number(strength if strength is not None else float("nan"), "m/s²")),
    ]
    return ReportTable("watchdog test", ("what", "value"), rows)


def _watchdog_records(rig: Rig, working: Path) -> ReportTable:
    """Return what the records of the watchdog test say; one that cannot be read says why."""
    rows: list[Row] = []
    for name in rig.watchdog_test.records if rig.watchdog_test is not None else ():
        try:
            stop = watchdog_record.read(working / name)
        except ConfigError as error:
            rows.append((name, Cell(str(error), kind="no"), "", ""))
            continue
        rows.append((name, number(stop.speed, "", 1), number(stop.deceleration), number(stop.delay)))
    heads = ("record", Column("from [m/s]", True), Column("deceleration [m/s²]", True), Column("delay [s]", True))
    return ReportTable("records of the watchdog test", heads, rows)


def _drives(records: Sequence[Path]) -> ReportTable:
    rows: list[Row] = []
    for one in map(evidence.drive_evidence, records):
        altered = f"altered: {', '.join(one.altered)}" if one.altered else "as the drive left it"
        people = " / ".join(filter(None, (one.operator, one.driver))) or NONE
        state: Row = (
            one.record,
            one.begun,
            one.scenario,
            Cell(one.outcome, kind="no" if "FAILED" in one.outcome or not one.sha256 else ""),
            "; ".join(one.reasons) or NONE,
            people,
            Cell(altered if one.sha256 else "no hash", kind="no" if one.altered or not one.sha256 else "yes"),
            Cell(one.sha256 or NONE, kind="hash"),
        )
        rows.append(state)
    heads = ("record", "begun", "scenario", "ended", "why", "operator / driver", "record", "SHA-256")
    return ReportTable("drives of the day", heads, rows)


def _tried(wanted: DossierInput, rig_sha256: str) -> ReportTable:
    """Return what was tried before: the fault matrix, the hunt, the certificate; what was not given says so."""
    return ReportTable(
        "what was tried before",
        ("what", "found", "of", "SHA-256"),
        [_matrix(wanted.matrix), _hunt(wanted.hunt, rig_sha256), _certificate(wanted.certificate, rig_sha256)],
    )


def _not_given(what: str, option: str) -> Row:
    return (what, Cell(f"not given: {option}", kind="quiet"), "", "")


def _matrix(file: Path | None) -> Row:
    if file is None:
        return _not_given("fault matrix", "--matrix")
    found = evidence.matrix_evidence(file)
    said = f"{len(found.passed)} rows passed, {len(found.failed)} failed, {len(found.not_tried)} not tried"
    said += f"; failed: {', '.join(found.failed)}" if found.failed else ""
    return (
        "fault matrix",
        Cell(said, kind="no" if found.failed else "yes"),
        found.begun,
        Cell(found.sha256, kind="hash"),
    )


def _of_rig(same: bool) -> str:
    return "this rig file" if same else "ANOTHER version of the rig file"


def _hunt(folder: Path | None, rig_sha256: str) -> Row:
    if folder is None:
        return _not_given("hunt", "--hunt")
    found = evidence.hunt_evidence(folder, rig_sha256)
    clean = found.summary[1].startswith("0 found")
    said = Cell(f"{'; '.join(found.summary)}; least margin {found.nearest}", kind="" if clean else "no")
    return ("hunt", said, _of_rig(found.of_this_rig), Cell(found.sha256, kind="hash"))


def _certificate(folder: Path | None, rig_sha256: str) -> Row:
    if folder is None:
        return _not_given("certificate of the brain", "--certificate")
    found = evidence.certificate_evidence(folder, rig_sha256)
    counts = ", ".join(f"{many} {word}" for word, many in found.counts)
    files = "; ".join(f"{name} {digest[:12]}…" for name, digest in found.brain_files)
    said = f"{found.verdict} on {found.begun} ({counts}); {found.brain}; {files}"
    kind: Any = "yes" if found.passed else "no"
    return (
        "certificate of the brain",
        Cell(said, kind=kind),
        _of_rig(found.of_this_rig),
        Cell(found.sha256, kind="hash"),
    )


def _versions() -> dict[str, str]:
    said = software()
    code = said["code"]
    commit = (
        f"{code['git_commit']}{', with changes' if code.get('git_dirty') else ''}" if code.get("git_commit") else NONE
    )
    own = {"vve_sumo": __version__, "commit": commit, "compiled": "yes" if code["compiled"] else "no"}
    return own | {"python": str(said["python"]), **{str(k): str(v) for k, v in said["libraries"].items()}}


def _hashes(wanted: DossierInput, rig: Rig, rig_sha256: str) -> Iterator[tuple[str, str]]:
    yield "code of vve_sumo", str(software()["code"]["sha256"])
    yield f"rig {wanted.rig_file.name}", rig_sha256
    kinds = (("scenario", wanted.scenario), ("vehicle", rig.vehicle.model))
    for kind, name in kinds:
        file = workspace.find(kind, name, wanted.working, beside=wanted.rig_file.parent)
        yield f"{kind} {file.name}", hash_file(file)


def _command(wanted: DossierInput) -> str:
    words = ["vve-sumo", "dossier", wanted.rig, wanted.scenario]
    for record in wanted.records:
        words += ["--record", str(record)]
    given = (("--matrix", wanted.matrix), ("--hunt", wanted.hunt), ("--certificate", wanted.certificate))
    words += [word for option, place in given if place is not None for word in (option, str(place))]
    return shlex.join(words)
