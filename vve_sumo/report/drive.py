"""What the report of a drive says: what was asked, what happened, where it comes from.

Reads a record through the analysis and nothing else; must not know how the page is built or written.
"""

from __future__ import annotations

import shlex
from collections.abc import Hashable, Mapping
from typing import Any

from vve_sumo.analysis.latency import MEANINGS as LEGS
from vve_sumo.analysis.latency import latency_breakdown
from vve_sumo.analysis.over_time import exposure, over_time
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensing import radar_statistics
from vve_sumo.drive.verify import altered_parts
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.per_drive import OF_STOP, PER_DRIVE
from vve_sumo.metrics.table import PLAYBACK
from vve_sumo.report import asked, pictures, stops
from vve_sumo.report.html import Column, Html, folded, paragraphs, sub, table, tag
from vve_sumo.report.page import Part, Report, commands, hashes, versions
from vve_sumo.report.picture import Picture
from vve_sumo.report.sources import open_street_map
from vve_sumo.report.tables import about, meanings, named, of_frame
from vve_sumo.report.verdict import altered, figures_of, of_drive
from vve_sumo.report.words import NONE, count, number, said, share, short

Figures = Mapping[str, Any]

#: figures that the section on the stop tells
STOP = frozenset(OF_STOP)
#: actors whose radar statistics are shown
ACTORS = 30
#: of them, what everybody asks for first
RADAR = (
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


def report(run: Run) -> Report:
    """Return the report of a drive, whole or cut short."""
    figures, plots = figures_of(run), pictures.of_drive(run)
    verdict, changed = of_drive(run, figures), altered_parts(run.folder)
    return Report(
        kind=f"Report of a {kind_of(run, figures)}",
        title=run.title,
        verdict=altered(verdict, changed) if changed else verdict,
        parts=(
            Part("asked", "What was asked", _asked(run, figures)),
            Part("happened", "What happened", _happened(run, figures, plots[0])),
            Part("plots", "Plots", [picture.html() for picture in plots[1:]]),
            Part("source", "Where it comes from", _source(run, figures)),
        ),
        pictures=plots,
        sources=open_street_map(run.resolved["settings"], [str(run.resolved["files_sha256"].get("network"))]),
    )


def kind_of(run: Run, figures: Figures) -> str:
    """Return what kind of drive it was."""
    if run.live:
        return "live drive in shadow: every enable bit was off" if figures.get("shadow") else "live drive"
    return "recorded drive sent through the chain" if _is_playback(run) else "lockstep drive"


def _is_playback(run: Run) -> bool:
    return not run.live and "pose" in run.resolved["files_sha256"]


def _asked(run: Run, figures: Figures) -> list[Html]:
    settings = run.resolved["settings"]
    more = [("rig", str(figures.get("rig") or "named in the record"))] if run.live else []
    judged = isinstance(figures.get("passed"), bool)
    return [
        paragraphs(str(settings.get("description") or "")),
        asked.settings(settings, run.live, [*more, ("seed", short(settings.get("seed")))]),
        asked.parameters(settings),
        asked.criteria(settings.get("criteria") or {}, figures, judged),
    ]


def _happened(run: Run, figures: Figures, sheet: Picture) -> list[Html]:
    return [
        sheet.html(),
        _figures(figures),
        stops.stop(run),
        stops.promised(run),
        _exposure(run),
        _radar(run),
        _latency(run),
    ]


def _figures(figures: Figures) -> Html:
    rows: list[tuple[str, str]] = [
        (named(key), _said(key, figures))
        for key in ("outcome", *PER_DRIVE, *PLAYBACK)
        if key in figures and key not in STOP
    ]
    removed = figures.get("removed_at_entry") or ()
    if removed:
        rows.append(("vehicles removed where the car entered", str(len(removed))))
    if standoffs := figures.get("removed_after_standoff"):
        rows.append(("vehicles removed after a standoff with the car", str(len(standoffs))))
    return sub("Figures", table(("figure", Column("value", True)), rows, "figures of the drive"))


def _exposure(run: Run) -> Html:
    summed = exposure(over_time(run))
    rows = [(named(str(name)), _measure(name, value)) for name, value in summed.items()]
    return sub("Exposure and comfort", table(("measure", Column("value", True)), rows, "exposure and comfort"))


def _measure(name: Hashable, value: float) -> str:
    return share(value) if str(name).endswith("_share") else number(value, unit_of(str(name)))


def _radar(run: Run) -> Html:
    found = radar_statistics(run)
    if found.empty:
        return sub("Radar", tag("p", "Nothing ever stood in the radar's field of view."))
    said = (
        "What the radar showed of each actor against what there was to be seen, the first seen first. A drop-out is a "
        "stretch of scans between the first detection and the last that missed it."
    )
    shown = of_frame(found.head(ACTORS), "radar statistics", "actor", RADAR)
    more = len(found) - ACTORS
    rest = [tag("p", f"… and {count(more, 'more actor')}; `radar_statistics` has them all.")] if more > 0 else []
    return sub(
        "Radar",
        tag("p", said),
        shown,
        *rest,
        folded("Every figure", of_frame(found.head(ACTORS), "radar", "actor"), meanings(found)),
    )


def _latency(run: Run) -> Html:
    import pandas as pd

    if not run.holds("latency"):
        why = "The record holds no latencies." if run.live else "The clock was simulated: computing took no time in it."
        return sub("Latency", tag("p", why))
    said = "Where the time went between a fix and its command frame, leg by leg."
    legs = latency_breakdown(run)
    names = [about(str(leg).replace("_", " "), LEGS.get(str(leg), "")) for leg in legs.index]
    # An index of pandas' own strings would forget that these are HTML.
    told = legs.set_axis(pd.Index(names, dtype=object))
    return sub("Latency", tag("p", said), of_frame(told, "latency", "leg"))


def _said(key: str, figures: Figures) -> str:
    value = figures[key]
    if key == "outcome":
        return str(value)
    if key == "emergency_used":
        return "braked" if value else "not needed"
    if key == "impact_speed_mps" and not figures.get("collision"):
        return NONE
    return said(key, float("nan") if value is None else value)


def _source(run: Run, figures: Figures) -> list[Html]:
    name = run.folder.resolve().name
    again = [*_driven_again(run, name), ("Write this page again:", f"vve-sumo report {shlex.quote(name)}")]
    parts = [("the whole record", str(figures.get("record_sha256") or ""))]
    parts += [*(figures.get("record_parts_sha256") or {}).items(), *(figures.get("record_files_sha256") or {}).items()]
    files = [*(run.resolved.get("files_sha256") or {}).items()]
    return [
        table(("what", "value"), _provenance(run, figures, name), "provenance"),
        sub("How to reproduce", tag("p", "From the folder that holds the record:"), commands(again)),
        sub("Versions", versions(run.resolved.get("versions") or {})),
        sub(
            "Hashes",
            hashes([(part, value) for part, value in parts if value], "Of the record"),
            hashes(files, "Of the files that the drive read"),
        ),
    ]


def _driven_again(run: Run, name: str) -> list[tuple[str, str]]:
    """Return what drives a record again; nothing does a playback, whose recording is not a part of its record."""
    if _is_playback(run):
        return []
    chain = "Check the hashes, and feed the record to the same chain and gateway again:"
    replay = (chain, f"vve-sumo replay {shlex.quote(name)}")
    if run.live:
        return [replay]
    settings = run.resolved["settings"]
    line = ["vve-sumo", "drive", run.name, "--seed", str(settings["seed"])]
    line += ["--controller", str(settings["controller"]["name"]), "--out", "again"]
    same = "same files and versions, and nothing varied by a sweep: same hash"
    return [replay, (f"Drive the scenario again (name its file, of one of your own); {same}:", shlex.join(line))]


def _provenance(run: Run, figures: Figures, name: str) -> list[tuple[str, str]]:
    settings = run.resolved["settings"]
    digest = str(figures.get("record_sha256") or "none: the drive was never finished")
    return [
        ("record", name),
        ("scenario", run.name),
        ("seed", short(settings.get("seed"))),
        ("controller", str(settings["controller"]["name"])),
        ("hash of the record, as the drive left it", tag("span", digest, class_="hash")),
        ("ticks", f"{said('ticks', len(run.time))} of {number(1000.0 * run.period, 'ms', 0)}"),
        *_whence(run),
    ]


def _whence(run: Run) -> list[tuple[str, str]]:
    """Return the code, the machine and the people of a drive, as far as its record tells of them."""
    told = run.provenance
    if told is None:
        return []
    changed = ", with changes" if told.code.git_dirty else ""
    rows = [
        ("begun", told.began_utc),
        ("code of vve-sumo", tag("span", told.code.sha256, class_="hash")),
        ("commit", f"{told.code.git_commit}{changed}" if told.code.git_commit else "none: installed"),
        ("machine", f"{told.host.name}, {told.host.kernel}, {told.host.machine}, {told.python}"),
    ]
    if not run.live:
        return rows
    doctor = told.doctor
    verdict = (
        "none"
        if doctor is None
        else ", ".join([" of ".join(filter(None, (doctor.verdict, doctor.date_utc))), *doctor.caveats])
    )
    return [
        *rows,
        ("operator", told.operator or "not said"),
        ("driver", told.driver or "not said"),
        ("doctor", verdict),
    ]
