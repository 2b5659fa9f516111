"""The content of a drive's report: its settings, its results, its provenance.

Reads a record through the analysis and nothing else; must not know how the page is set or written.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vve_sumo.analysis.latency import MEANINGS as LEGS
from vve_sumo.analysis.latency import latency_breakdown
from vve_sumo.analysis.over_time import exposure, over_time
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensing import sensor_statistics, watching
from vve_sumo.drive.verify import altered_parts
from vve_sumo.metrics.key_figures import emergency_layer
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.per_drive import OF_RIDE, OF_STOP, PER_DRIVE
from vve_sumo.metrics.table import PLAYBACK
from vve_sumo.report import again, formatting, key_figures, pictures, settings, stops
from vve_sumo.report.comfort import comfort
from vve_sumo.report.curves import curves
from vve_sumo.report.formatting import NONE, integer, number, share, short
from vve_sumo.report.page import ReportPage, hashes, versions
from vve_sumo.report.sources import open_street_map
from vve_sumo.report.tables import Cell, Column, ReportTable, Row, meanings, named, of_frame
from vve_sumo.report.verdict import altered, figures_of, of_drive

Figures = Mapping[str, Any]

#: figures that the sections on the stop and on comfort show
IN_SECTIONS = frozenset((*OF_STOP, *OF_RIDE))
#: actors whom a sensor saw that are shown at most
MAX_ACTORS = 30
#: of a sensor's statistics, the columns that a reader looks for first
SENSED = (
    "first_s",
    "first_range_m",
    "first_ttc_s",
    "detected_share",
    "dropouts",
    "longest_dropout_s",
    "range_error_mean_m",
    "range_error_std_m",
    "ghosts",
)


def report(run: Run) -> ReportPage:
    """Return the report of a drive, whole or cut short."""
    figures = figures_of(run)
    verdict, changed = of_drive(run, figures), altered_parts(run.folder)
    return ReportPage(
        template="drive.html.j2",
        kind=f"Report of a {kind_of(run, figures)}",
        title=run.title,
        verdict=altered(verdict, changed) if changed else verdict,
        key_figures=key_figures.of_drive(figures, run.resolved["settings"].get("criteria") or {}),
        pictures=pictures.of_drive(run),
        sources=open_street_map(run.resolved["settings"], [str(run.resolved["files_sha256"].get("network"))]),
        content=_settings(run, figures) | _results(run, figures) | _provenance(run, figures),
        data=curves(run),
    )


def kind_of(run: Run, figures: Figures) -> str:
    """Return what kind of drive it was."""
    if run.live:
        return "live drive in shadow mode: every enable bit was off" if figures.get("shadow") else "live drive"
    return "recorded drive sent through the pipeline" if _is_playback(run) else "lockstep drive"


def _is_playback(run: Run) -> bool:
    return not run.live and "pose" in run.resolved["files_sha256"]


def _settings(run: Run, figures: Figures) -> dict[str, object]:
    scenario = run.resolved["settings"]
    more = [("rig", str(figures.get("rig") or "named in the record"))] if run.live else []
    if injected := ", ".join(dict.fromkeys(str(fault["kind"]) for fault in run.resolved.get("faults", ()))):
        more.append(("injected faults", injected))
    judged = isinstance(figures.get("passed"), bool)
    return {
        "description": str(scenario.get("description") or ""),
        "main_settings": settings.main_settings(scenario, run.live, [*more, ("seed", short(scenario.get("seed")))]),
        "every_setting": settings.every_setting(scenario),
        "parameters": settings.parameters(scenario),
        "criteria": settings.criteria(scenario.get("criteria") or {}, figures, judged),
    }


def _results(run: Run, figures: Figures) -> dict[str, object]:
    return {
        "figures": _figures(figures, run.own_metrics.per_drive),
        **stops.stop(run),
        **stops.bound_check(run),
        **stops.status(run),
        **comfort(run),
        "exposure": _exposure(run),
        "sensors": [_sensor(run, name) for name in watching(run)],
        "live": run.live,
        "latency": _latency(run),
    }


def _sensor(run: Run, name: str) -> dict[str, object]:
    """Return what a sensor showed of each actor."""
    shown = sensor_statistics(run, name)
    first = tuple(column for column in SENSED if column in shown)
    return {
        "name": name,
        "has_view": run.sensed[name].drawing.view is not None,
        "table": of_frame(shown, f"{name} statistics", "actor", first, MAX_ACTORS),
        "figures": of_frame(shown, name, "actor", most=MAX_ACTORS),
        "meanings": meanings(shown),
    }


def _figures(figures: Figures, own: Iterable[str]) -> ReportTable:
    rows = [
        (named(key), _figure(key, figures))
        for key in ("outcome", *PER_DRIVE, *PLAYBACK, *own)
        if key in figures and key not in IN_SECTIONS
    ]
    if removed := figures.get("removed_at_entry"):
        rows.append((Cell("vehicles removed where the car entered"), str(len(removed))))
    if standoffs := figures.get("removed_after_standoff"):
        rows.append((Cell("vehicles removed after a standoff with the car"), str(len(standoffs))))
    return ReportTable("figures of the drive", ("figure", Column("value", True)), rows)


def _figure(key: str, figures: Figures) -> str:
    value = figures[key]
    if failed := (figures.get("metric_errors") or {}).get(key):
        return f"{NONE}: {failed}"
    if key == "emergency_used":
        return emergency_layer(figures)
    if value is None or (key == "impact_speed_mps" and not figures.get("collision")):
        return NONE
    return formatting.figure(key, value)


def _exposure(run: Run) -> ReportTable:
    rows = [
        (named(str(name)), share(value) if str(name).endswith("_share") else number(value, unit_of(str(name))))
        for name, value in exposure(over_time(run)).items()
    ]
    return ReportTable("exposure and jerk", ("measure", Column("value", True)), rows)


def _latency(run: Run) -> ReportTable | None:
    """Return the latency leg by leg; None where the record holds none."""
    if not run.holds("latency"):
        return None
    legs = latency_breakdown(run)
    table = of_frame(legs, "latency", "leg")
    names = [Cell(str(leg).replace("_", " "), LEGS.get(str(leg), "")) for leg in legs.index]
    return replace(table, rows=[(name, *row[1:]) for name, row in zip(names, table.rows, strict=True)])


def _provenance(run: Run, figures: Figures) -> dict[str, object]:
    name = run.folder.resolve().name
    parts = [("the whole record", str(figures.get("record_sha256") or ""))]
    parts += [*(figures.get("record_parts_sha256") or {}).items(), *(figures.get("record_files_sha256") or {}).items()]
    return {
        "provenance": _origin(run, figures, name),
        "replay_command": None
        if _is_playback(run) or run.brain == "setpoints"
        else f"vve-sumo replay {shlex.quote(name)}",
        "drive_command": _drive_command(run),
        "lockstep": not (run.live or run.brain or _is_playback(run)),
        "foreign_brain": bool(run.brain),
        "report_command": f"vve-sumo report {shlex.quote(name)}",
        "versions": versions(run.resolved.get("versions") or {}),
        "record_hashes": hashes(parts, "hashes of the record"),
        "file_hashes": hashes([*(run.resolved.get("files_sha256") or {}).items()], "hashes of the files"),
    }


def _drive_command(run: Run) -> str | None:
    """Return the command that drives a scenario again; None for a live drive, a playback, and an external controller.

    None also where `again` knows none.
    """
    return None if run.live or run.brain or _is_playback(run) else again.command(run, Path.cwd())


def _origin(run: Run, figures: Figures, name: str) -> ReportTable:
    scenario = run.resolved["settings"]
    digest = str(figures.get("record_sha256") or "none: the drive was never finished")
    rows: list[Row] = [
        ("record", name),
        ("scenario", run.name),
        ("seed", short(scenario.get("seed"))),
        ("controller", f"an external controller ({run.brain})" if run.brain else str(scenario["controller"]["name"])),
        ("hash of the record, as the drive left it", Cell(digest, kind="hash")),
        ("ticks", f"{integer(len(run.time))} of {number(1000.0 * run.period, 'ms', 0)}"),
        *_machine_and_people(run),
    ]
    return ReportTable("provenance", ("what", "value"), rows)


def _machine_and_people(run: Run) -> list[Row]:
    """Return the code, the machine and the people of a drive, as far as its record holds them."""
    origin = run.provenance
    if origin is None:
        return []
    changed = ", with changes" if origin.code.git_dirty else ""
    rows: list[Row] = [
        ("begun", origin.began_utc),
        ("code of vve-sumo", Cell(origin.code.sha256, kind="hash")),
        ("commit", f"{origin.code.git_commit}{changed}" if origin.code.git_commit else "none: installed"),
        ("machine", f"{origin.host.name}, {origin.host.kernel}, {origin.host.machine}, {origin.python}"),
    ]
    if run.live:
        doctor = origin.doctor
        checked = [" of ".join(filter(None, (doctor.verdict, doctor.date_utc))), *doctor.caveats] if doctor else [NONE]
        if doctor and doctor.override:
            checked.append(f"overridden: {doctor.override}")
        rows += [("operator", origin.operator or "not stated"), ("driver", origin.driver or "not stated")]
        rows += [("doctor", ", ".join(checked))]
    return rows
