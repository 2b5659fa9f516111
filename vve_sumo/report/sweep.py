"""What the report of a sweep says: what was varied, what the runs came to, what a search found, where it comes from.

Reads a dataset through the analysis and nothing else; must not know how the page is built or written.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency_margin import LatencyMargin
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report import asked, found, pictures, runs, stops, study
from vve_sumo.report.html import Column, Html, folded, paragraphs, sub, table, tag
from vve_sumo.report.page import Part, Report, commands, hashes, versions
from vve_sumo.report.picture import Picture
from vve_sumo.report.sources import open_street_map
from vve_sumo.report.tables import about
from vve_sumo.report.verdict import Verdict, Word
from vve_sumo.report.words import asked as asked_for
from vve_sumo.report.words import count, number, said, share, short

if TYPE_CHECKING:
    import pandas as pd

#: figures that a table of combinations has room for
MOST = 5


def report(sweep: Sweep) -> Report:
    """Return the report of a sweep, finished or not."""
    rows = runs.read(sweep)
    counted, cliff = runs.counts(sweep, rows), study.study_of(sweep)
    plots = (*([study.picture(cliff)] if cliff else []), *pictures.of_sweep(sweep, rows, _figures(sweep)))
    return Report(
        kind="Report of a study" if cliff else ("Report of a search" if _search(sweep) else "Report of a sweep"),
        title=sweep.title,
        verdict=verdict(sweep, rows, counted, cliff),
        parts=(
            Part("asked", "What was asked", _asked(sweep, rows)),
            Part("happened", "What happened", _happened(sweep, rows, counted, cliff, plots[:1])),
            Part("plots", "Plots", [picture.html() for picture in plots[1:]]),
            Part("source", "Where it comes from", _source(sweep)),
        ),
        pictures=plots,
        sources=open_street_map(sweep.plan["table"], sweep.plan["files_sha256"].get("network") or ()),
    )


def _search(sweep: Sweep) -> dict[str, Any] | None:
    told: dict[str, Any] | None = sweep.plan["spec"].get("search")
    return told


def verdict(sweep: Sweep, rows: pd.DataFrame, counted: runs.Counts, cliff: LatencyMargin | None) -> Verdict:
    """Return the verdict on a sweep: nobody judges what a search or a study went looking for."""
    looked = _search(sweep) is not None or cliff is not None
    ends = (_driven(counted) if looked else _came(counted), *_extremes(rows))
    if _search(sweep) is not None:
        if sweep.found is None:
            return Verdict("broken off", ("The search was stopped or still goes on.", *ends))
        return Verdict("not judged", (found.sentence(sweep.found, rows.attrs.get("units")), *ends))
    if counted.finished < counted.asked:
        part = f"{said('runs', counted.finished)} of {count(counted.asked, 'run')} are finished"
        return Verdict("broken off", (f"{part}: the sweep was stopped or still goes on.", *ends))
    if cliff is not None:
        return Verdict("not judged", (*study.sentences(cliff), *ends))
    word: Word = "FAILED" if counted.failed else ("not judged" if counted.faults or not counted.judged else "passed")
    return Verdict(word, ends)


def _driven(counted: runs.Counts) -> str:
    """Say how many runs there were; the share that passed would tell of the points that were chosen, and no more."""
    faults = f", {said('runs', counted.faults)} of them to a fault" if counted.faults else ""
    return f"{count(counted.finished, 'run was', 'runs were')} driven{faults}."


def _came(counted: runs.Counts) -> str:
    if not counted.judged:
        return f"Of {count(counted.finished, 'run')} none was judged; {counted.faults} came to a fault."
    faults = f"; {count(counted.faults, 'more came', 'more came')} to a fault" if counted.faults else ""
    if counted.failed == 0:
        every = "The one judged run" if counted.judged == 1 else f"All {said('runs', counted.judged)} judged runs"
        return f"{every} passed{faults}."
    part = f"{said('runs', counted.passed)} of {said('runs', counted.judged)} judged runs passed"
    return f"{part} ({share(counted.passed / counted.judged)}), {said('runs', counted.failed)} failed{faults}."


def _extremes(rows: pd.DataFrame) -> tuple[str, ...]:
    """Return the worst of all runs, as a sentence."""
    collision = rows["collision"].to_numpy(np.float64, na_value=np.nan)
    if not np.isfinite(collision).any():
        return ()
    gap, least = _least(rows, "stop_gap_m"), _least(rows, "min_gap_m")
    impact, hits = -_least(rows, "impact_speed_mps", -1.0), int((collision == 1.0).sum())
    hit = f"{count(hits, 'run')} touched something" if hits else "no run touched anything"
    hit += f", at {number(impact, 'm/s')} at most" if impact > 0.0 else ""
    parts = [f"least gap at rest {number(gap, 'm')}"] if gap > 0.0 else []
    parts += [f"closest approach {number(least, 'm')}"] if least > 0.0 else []
    return (f"Over all runs: {', '.join([*parts, hit])}.",)


def _least(rows: pd.DataFrame, name: str, sign: float = 1.0) -> float:
    values = sign * rows[name].to_numpy(np.float64, na_value=np.nan)
    return float(np.nanmin(values)) if np.isfinite(values).any() else float("nan")


def _asked(sweep: Sweep, rows: pd.DataFrame) -> list[Html]:
    spec, scenario = sweep.plan["spec"], sweep.plan["table"]
    seeds = spec.get("seeds", 1)
    design = [("design", str(spec.get("design", "grid")))] if _search(sweep) is None else []
    design += [("points drawn", short(spec["samples"]))] if spec.get("samples") is not None else []
    more = [
        ("scenario", f"{sweep.scenario}: {scenario.get('title', '')}"),
        *design,
        ("seeds", f"{seeds} of each point" if isinstance(seeds, int) else ", ".join(map(short, seeds))),
        *((f"search: {key}", short(value)) for key, value in (_search(sweep) or {}).items()),
    ]
    return [
        paragraphs(str(scenario.get("description") or "")),
        _varied(sweep, rows),
        sub("The scenario", asked.settings(scenario, False, more, asked.varied_keys(scenario, sweep.parameters))),
        _criteria(sweep, rows),
    ]


def _varied(sweep: Sweep, rows: pd.DataFrame) -> Html:
    declared = sweep.plan["table"].get("parameters") or {}
    units = rows.attrs.get("units", {})
    written = sweep.plan["spec"].get("parameters") or {}
    lines: list[tuple[str, str]] = []
    for name in sweep.parameters:
        told = declared.get(name) or {}
        meaning = told.get("meaning") or ", ".join(told.get("sets") or ())
        values = f"{_values(_written(written, name))} {units.get(name) or unit_of(name)}"
        lines.append((about(tag("code", name), meaning), values.strip()))
    return sub("What was varied", table(("parameter", "values"), lines, "what was varied"))


def _written(parameters: dict[str, Any], name: str) -> object:
    """Return what a spec says of a parameter: under its whole name, or, as TOML takes dots, in tables of tables."""
    if name in parameters or "." not in name:
        return parameters.get(name)
    first, _, rest = name.partition(".")
    inner = parameters.get(first)
    return _written(inner, rest) if isinstance(inner, dict) else None


def _values(told: object) -> str:
    if isinstance(told, list):
        return ", ".join(map(short, told))
    if not isinstance(told, dict):
        return short(told)
    if "from" in told:
        steps = f"in steps of {short(told['step'])}" if "step" in told else f"{short(told.get('count'))} values"
        return f"{short(told['from'])} to {short(told.get('to'))}, {steps}"
    return f"between {short(told.get('min'))} and {short(told.get('max'))}{', logarithmic' if told.get('log') else ''}"


def _criteria(sweep: Sweep, rows: pd.DataFrame) -> Html:
    stated = sweep.plan["table"].get("criteria") or {}
    varied = asked.varied_criteria(sweep.plan["table"], sweep.parameters)
    lines = []
    for name in sweep.plan["criteria"]:
        met = rows[f"meets_{name}"].to_numpy(np.float64, na_value=np.nan)
        judged, good = int(np.isfinite(met).sum()), int((met == 1.0).sum())
        part = f"{said('runs', good)} of {said('runs', judged)}"
        looks = ("yes" if good == judged else "no") if judged else "quiet"
        wanted = "set by a parameter" if name in varied else asked_for(name, stated.get(name, False))
        lines.append(
            (label_of(name), wanted, tag("span", part, class_=looks), share(good / judged) if judged else "none")
        )
    columns = ("criterion", "asked", Column("runs that met it", True), Column("share", True))
    return sub("Criteria", table(columns, lines, "criteria")) if lines else Html("")


def _figures(sweep: Sweep) -> list[str]:
    """Return the figures that criteria ask for, or those that matter most."""
    wanted = [name for name in sweep.plan["criteria"] if name in sweep.figures]
    sought = [value for key, value in (_search(sweep) or {}).items() if key in ("highest", "lowest")]
    return list(dict.fromkeys([*sought, *(wanted or runs.MAIN)]))[:MOST]


def _happened(
    sweep: Sweep, rows: pd.DataFrame, counted: runs.Counts, cliff: LatencyMargin | None, first: Sequence[Picture]
) -> list[Html]:
    figures = _figures(sweep)
    searched = _search(sweep) is not None
    return [
        *(picture.html() for picture in first),
        study.shown(cliff) if cliff is not None else Html(""),
        found.shown(sweep.found, rows.attrs.get("units")) if sweep.found is not None else Html(""),
        runs.overview(counted, searched),
        Html("") if searched else runs.spread(rows, sweep.figures),
        Html("") if searched else runs.combinations(sweep, rows, figures),
        runs.worst(rows, sweep, figures, sweep.folder.resolve().name),
        stops.flagged(rows),
        runs.faults(rows),
    ]


def _source(sweep: Sweep) -> list[Html]:
    name = shlex.quote(sweep.folder.resolve().name)
    again = [("Drive one run again, with its full record, and compare its hash:", f"vve-sumo sweep --rerun {name} KEY")]
    again += [("Write this page again:", f"vve-sumo report {name}")]
    files = [(role, digest) for role, all_of in sweep.plan["files_sha256"].items() for digest in all_of]
    spec = tag("pre", tag("code", json.dumps(sweep.plan["spec"], indent=1, ensure_ascii=False)), tabindex="0")
    rows = [
        ("dataset", sweep.folder.resolve().name),
        ("scenario", sweep.scenario),
        ("controller", str((sweep.plan["table"].get("controller") or {}).get("name", "follow_and_stop"))),
        ("rows", f"{said('runs', sweep.finished)}, in rows/part-*.parquet"),
    ]
    return [
        table(("what", "value"), rows, "provenance"),
        sub(
            "How to reproduce",
            tag("p", "From the folder that holds the dataset; KEY is a run's:"),
            commands(again),
            folded("The sweep as it was asked for", spec),
        ),
        sub("Versions", versions(sweep.plan["versions"])),
        sub("Hashes", hashes(files, "Of the files that the runs read")),
    ]
