"""The content of a sweep's report: what was varied, the results of the runs and of a search, the provenance.

Reads a dataset through the analysis and nothing else; must not know how the page is set or written.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency_margin import LatencyMargin
from vve_sumo.drive.plugged_in import CONTROLLER
from vve_sumo.metrics.metric import unit_of
from vve_sumo.report import formatting, key_figures, pictures, runs, search_results, settings, stops, study
from vve_sumo.report.formatting import count, integer, number, share, short
from vve_sumo.report.page import ReportPage, hashes, versions
from vve_sumo.report.points import points
from vve_sumo.report.sources import open_street_map
from vve_sumo.report.tables import Cell, Column, ReportTable, Row, meanings, named, of_frame
from vve_sumo.report.verdict import ReportVerdict, Word

if TYPE_CHECKING:
    import pandas as pd

#: figures that a table of combinations has room for
MAX_FIGURES = 5


def report(sweep: Sweep) -> ReportPage:
    """Return the report of a sweep, finished or not."""
    rows = runs.read(sweep)
    counted, margin = runs.counts(sweep, rows), study.study_of(sweep)
    drawn = (*([study.picture(margin)] if margin else []), *pictures.of_sweep(sweep, rows, _figures(sweep)))
    # Where all runs are alike in it, the map of the share that passed says nothing that the verdict does not.
    plots = sorted(drawn, key=lambda one: one.name == "map_passed" and rows["passed"].nunique() < 2)
    return ReportPage(
        template="sweep.html.j2",
        kind=f"Report of a {_kind(sweep, margin)}",
        title=sweep.title,
        verdict=verdict(sweep, rows, counted, margin),
        key_figures=key_figures.of_sweep(rows, counted.passed, counted.judged, _figures(sweep)),
        pictures=plots,
        sources=open_street_map(sweep.plan["table"], sweep.plan["files_sha256"].get("network") or ()),
        content=_settings(sweep, rows) | _study(margin) | _results(sweep, rows, counted) | _provenance(sweep),
        data=points(rows, sweep.parameters, _figures(sweep)),
    )


def _kind(sweep: Sweep, margin: LatencyMargin | None) -> str:
    return "study" if margin else "search" if _search(sweep) else str(sweep.plan["design"])


def _search(sweep: Sweep) -> dict[str, Any] | None:
    search: dict[str, Any] | None = sweep.plan["spec"].get("search")
    return search


def verdict(sweep: Sweep, rows: pd.DataFrame, counted: runs.Counts, margin: LatencyMargin | None) -> ReportVerdict:
    """Return the verdict on a sweep.

    It is `passed` where every run met its criteria. Where some did not, a sweep that varies nothing but the seed
    repeats one drive and has `FAILED`, and so has a suite, whose tests all have to be passed; one that varies a
    parameter looks for where its criteria hold, as a search or a study does, and is `explored`.
    """
    exploring = _search(sweep) is not None or margin is not None
    ends = (_driven(counted) if exploring else _judged(counted), *_extremes(rows))
    if _search(sweep) is not None:
        if sweep.search_result is None:
            return ReportVerdict("broken off", ("The search was stopped or still runs.", *ends))
        return ReportVerdict(
            "explored", (search_results.sentence(sweep.search_result, rows.attrs.get("units", {})), *ends)
        )
    if counted.finished < counted.planned:
        part = f"{integer(counted.finished)} of {count(counted.planned, 'run')} are finished"
        return ReportVerdict("broken off", (f"{part}: the sweep was stopped or still runs.", *ends))
    if margin is not None:
        return ReportVerdict("explored", (*study.sentences(margin), *ends))
    return ReportVerdict(_word(counted, repeated=not sweep.parameters or sweep.plan["design"] != "sweep"), ends)


def _word(counted: runs.Counts, repeated: bool) -> Word:
    if counted.failed:
        return "FAILED" if repeated else "explored"
    return "not judged" if counted.errors or not counted.judged else "passed"


def _driven(counted: runs.Counts) -> str:
    """Return how many runs there were; the share that passed would depend on the points that the search chose."""
    errors = f", {integer(counted.errors)} of them ended with an error" if counted.errors else ""
    return f"{count(counted.finished, 'run was', 'runs were')} driven{errors}."


def _judged(counted: runs.Counts) -> str:
    if not counted.judged:
        return f"Of {count(counted.finished, 'run')} none was judged; {counted.errors} ended with an error."
    errors = f"; {integer(counted.errors)} more ended with an error" if counted.errors else ""
    if counted.failed == 0:
        every = "The one judged run" if counted.judged == 1 else f"All {integer(counted.judged)} judged runs"
        return f"{every} passed{errors}."
    part = f"{integer(counted.passed)} of {integer(counted.judged)} judged runs met the criteria"
    return f"{part} ({share(counted.passed / counted.judged)}), {integer(counted.failed)} did not{errors}."


def _extremes(rows: pd.DataFrame) -> tuple[str, ...]:
    """Return the worst figures of all runs, as a sentence."""
    collision = rows["collision"].to_numpy(np.float64, na_value=np.nan)
    if not np.isfinite(collision).any():
        return ()
    impact, hits = -_least(rows, "impact_speed_mps", -1.0), int((collision == 1.0).sum())
    # A contact is below every gap; the gap that its run has to what stands behind is none of these.
    gap, closest = (np.nan if hits else _least(rows, name) for name in ("stop_gap_m", "min_gap_m"))
    hit = f"{count(hits, 'run')} with a collision" if hits else "no collision"
    hit += f", at {number(impact, 'm/s')} at most" if impact > 0.0 else ""
    parts = [f"smallest gap at rest {number(gap, 'm')}"] if gap > 0.0 else []
    parts += [f"smallest gap {number(closest, 'm')}"] if closest > 0.0 else []
    return (f"Over all runs: {', '.join([*parts, hit])}.",)


def _least(rows: pd.DataFrame, name: str, sign: float = 1.0) -> float:
    values = sign * rows[name].to_numpy(np.float64, na_value=np.nan)
    return float(np.nanmin(values)) if np.isfinite(values).any() else float("nan")


def _settings(sweep: Sweep, rows: pd.DataFrame) -> dict[str, object]:
    spec, scenario = sweep.plan["spec"], sweep.plan["table"]
    seeds, varied = spec.get("seeds", 1), settings.varied_keys(scenario, sweep.parameters)
    design = [("design", str(spec.get("design", "grid")))] if _search(sweep) is None else []
    design += [("points drawn", short(spec["samples"]))] if spec.get("samples") is not None else []
    more = [
        ("scenario", f"{sweep.scenario}: {scenario.get('title', '')}"),
        *design,
        ("seeds", f"{seeds} of each point" if isinstance(seeds, int) else ", ".join(map(short, seeds))),
        *((f"search: {key}", short(value)) for key, value in (_search(sweep) or {}).items()),
    ]
    return {
        "description": str(scenario.get("description") or ""),
        "varied": _varied(sweep, rows),
        "main_settings": settings.main_settings(scenario, False, more, varied),
        "every_setting": settings.every_setting(scenario, varied),
        "criteria": _criteria(sweep, rows),
    }


def _varied(sweep: Sweep, rows: pd.DataFrame) -> ReportTable:
    declared = sweep.plan["table"].get("parameters") or {}
    units = rows.attrs.get("units", {})
    spec, compared = sweep.plan["spec"].get("parameters") or {}, sweep.plan["spec"].get("controllers") or []
    lines, tests = [], list(sweep.plan["tests"])
    for name in sweep.parameters:
        parameter = declared.get(name) or {}
        meaning = parameter.get("meaning") or ", ".join(parameter.get("sets") or ())
        values = _values(_of_controllers(compared, name) or _in_spec(spec, name) or tests or None)
        unit = units.get(name) or unit_of(name)
        lines.append((Cell(name, str(meaning), "code"), f"{values} {unit}".strip()))
    return ReportTable("what was varied", ("parameter", "values"), lines)


def _of_controllers(compared: Sequence[Mapping[str, Any]], name: str) -> str:
    """Return what the compared controllers have under a column's name, each with its own; empty for none of them."""
    if name == "controller.name":
        return ", ".join(one["name"] for one in compared)
    key = name.removeprefix("controller.tuning.")
    tunings = {one["name"]: (one.get("tuning") or {}).get(key) for one in compared}
    return "; ".join(f"{_values(value)} ({name})" for name, value in tunings.items() if value is not None)


def _in_spec(parameters: dict[str, Any], name: str) -> object:
    """Return the values of a parameter in a spec: under its whole name, or, as TOML takes dots, in nested tables."""
    if name in parameters or "." not in name:
        return parameters.get(name)
    first, _, rest = name.partition(".")
    inner = parameters.get(first)
    return _in_spec(inner, rest) if isinstance(inner, dict) else None


def _values(spec: object) -> str:
    if isinstance(spec, list):
        return ", ".join(map(short, spec))
    if not isinstance(spec, dict):
        return short(spec)
    if "from" in spec:
        steps = f"in steps of {short(spec['step'])}" if "step" in spec else f"{short(spec.get('count'))} values"
        return f"{short(spec['from'])} to {short(spec.get('to'))}, {steps}"
    return f"between {short(spec.get('min'))} and {short(spec.get('max'))}{', logarithmic' if spec.get('log') else ''}"


def _criteria(sweep: Sweep, rows: pd.DataFrame) -> ReportTable:
    stated = sweep.plan["table"].get("criteria") or {}
    varied = settings.varied_criteria(sweep.plan["table"], sweep.parameters)
    lines = []
    for name in sweep.plan["criteria"]:
        met = rows[f"meets_{name}"].to_numpy(np.float64, na_value=np.nan)
        judged, good = int(np.isfinite(met).sum()), int((met == 1.0).sum())
        part = f"{integer(good)} of {integer(judged)}"
        result = Cell(part, kind="quiet") if not judged else Cell(part, kind="yes" if good == judged else "no")
        wanted = "set by a parameter" if name in varied else formatting.criterion(name, stated.get(name, False))
        lines.append((named(name), result, wanted, share(good / judged) if judged else "none"))
    columns = ("criterion", Column("runs that met it", True), "asked", Column("share", True))
    return ReportTable("criteria", columns, lines)


def _figures(sweep: Sweep) -> list[str]:
    """Return the figures that criteria ask for, or those that matter most."""
    wanted = [name for name in sweep.plan["criteria"] if name in sweep.figures]
    sought = [value for key, value in (_search(sweep) or {}).items() if key in ("highest", "lowest")]
    return list(dict.fromkeys([*sought, *(wanted or runs.MAIN)]))[:MAX_FIGURES]


def _study(margin: LatencyMargin | None) -> dict[str, object]:
    if margin is None:
        return {"study": ()}
    edges, steps = study.in_ms(margin.edges), study.in_ms(margin.steps)
    return {
        "study": study.sentences(margin),
        "edges": of_frame(edges, "delays at which the margin is zero"),
        "edge_meanings": meanings(edges),
        "steps": of_frame(steps, "every step"),
        "step_meanings": meanings(steps),
    }


def _results(sweep: Sweep, rows: pd.DataFrame, counted: runs.Counts) -> dict[str, object]:
    figures, units, searched = _figures(sweep), rows.attrs.get("units", {}), _search(sweep) is not None
    return {
        "search_sentence": search_results.sentence(sweep.search_result, units)
        if sweep.search_result is not None
        else None,
        "search_table": search_results.table_of(sweep.search_result, units)
        if sweep.search_result is not None
        else None,
        "searched": searched,
        "overview": runs.overview(sweep, counted, searched),
        "spread": runs.spread(rows, sweep.figures),
        "combinations": runs.combinations(sweep, rows, figures),
        "failed": runs.failed_runs(rows, sweep.parameters, figures),
        **stops.bound_checks(rows),
        "errors": runs.errors(rows),
    }


def _controller(name: str, code: Mapping[str, Sequence[str]]) -> Cell:
    """Return a controller of a sweep, with the hash of each file of its code; none of a shipped one."""
    hashed = ", ".join(f"{role.removeprefix(CONTROLLER)} {' or '.join(digests)}" for role, digests in code.items())
    return Cell(f"{name}: {hashed}" if hashed else name)


def _provenance(sweep: Sweep) -> dict[str, object]:
    folder = sweep.folder.resolve().name
    rows: list[Row] = [
        ("dataset", folder),
        ("scenario", sweep.scenario),
        *(("controller", _controller(name, code)) for name, code in sweep.plan["controllers_sha256"].items()),
        ("rows", f"{integer(sweep.finished)}, in rows/part-*.parquet"),
    ]
    files = [(role, digest) for role, digests in sweep.plan["files_sha256"].items() for digest in digests]
    return {
        "provenance": ReportTable("provenance", ("what", "value"), rows),
        "rerun_command": f"vve-sumo sweep --rerun {shlex.quote(folder)}",
        "report_command": f"vve-sumo report {shlex.quote(folder)}",
        "spec": json.dumps(sweep.plan["spec"], indent=1, ensure_ascii=False),
        "versions": versions(sweep.plan["versions"]),
        "file_hashes": hashes(files, "hashes of the files"),
    }
