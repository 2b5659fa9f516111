"""What a drive and a sweep show of themselves: a line, the cell of a notebook, a plot of what was varied."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.effects import chosen_axes
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.key_figures import key_figures
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: combinations of a sweep that its table in a notebook shows
MAX_ROWS = 30
#: of a sweep that no criterion asks a number of
USUAL_FIGURES = ("stop_gap_m", "min_ttc_s")


def run_text(run: Run) -> str:
    """Return a drive in one line."""
    return f"<Run {run.name} in {run.folder}: {_verdict(run)}>"


def run_html(run: Run) -> str:
    """Return a drive for the cell of a notebook."""
    figures = {} if run.summary is None else key_figures(run.summary)
    parts = (_title(run.title), f"<p>{escape(_verdict(run))}</p>", _facts(figures), _picture(run.plot()))
    return "".join(parts)


def _verdict(run: Run) -> str:
    from vve_sumo.report.verdict import figures_of, of_drive

    return of_drive(run, figures_of(run)).line


def sweep_plot(sweep: Sweep, figure: str, x: str | None, y: str | None, by: str | None, facet: str | None) -> Figure:
    """Draw a figure of a sweep; see `Sweep.plot`."""
    from vve_sumo.plotting import distribution, heat_map, response

    asked = [name for name in (x, y, by, facet) if name is not None]
    known = ("seed", "error", "collision", "outcome", figure)
    rows = sweep.rows(list(dict.fromkeys([*sweep.parameters, *known, *asked])))
    chosen = chosen_axes(rows, figure, [name for name in sweep.parameters if name not in asked])
    first, second = (name for name in [*(one for one in chosen[:2] if one), None, None][:2])
    y = y or (first if x else second)
    x = x or first
    by = by or (chosen.by if chosen.by not in (x, y, facet) else None)
    if x is None:
        return distribution(rows, figure, by, facet=facet)
    if y is None:
        return response(rows, x, figure, by=by, facet=facet)
    return heat_map(rows, x, y, figure, by=by, facet=facet)


def sweep_text(sweep: Sweep) -> str:
    """Return a sweep in one line."""
    return f"<Sweep {sweep.title} in {sweep.folder}: {_counts(sweep)}>"


def sweep_html(sweep: Sweep) -> str:
    """Return a sweep for the cell of a notebook."""
    table = _combinations(sweep)
    more = f"<p>… and {len(table) - MAX_ROWS} more combinations: .grouped()</p>" if len(table) > MAX_ROWS else ""
    shown = table.head(MAX_ROWS).to_html(index=False, float_format="{:.3g}".format, na_rep="none")
    picture = _picture(sweep.plot(_shown_figures(sweep)[0]))
    return "".join((_title(sweep.title), f"<p>{escape(_counts(sweep))}</p>", shown, more, picture))


def _counts(sweep: Sweep) -> str:
    rows = sweep.rows(["passed", "error"])
    passed, failed = (int(rows["passed"].eq(which).sum()) for which in (True, False))
    errors = int(rows["error"].ne("").sum())
    of = "" if sweep.search_result is not None or sweep.finished == sweep.planned else f" of {sweep.planned}"
    return f"{sweep.finished}{of} runs: {passed} passed, {failed} failed, {errors} with an error"


def _shown_figures(sweep: Sweep) -> Sequence[str]:
    """Return the figures that the scenario's criteria ask for, as far as they are numbers, or the usual ones."""
    return [name for name in sweep.plan["criteria"] if name in sweep.figures][:4] or USUAL_FIGURES


def _combinations(sweep: Sweep) -> pd.DataFrame:
    """Return a row a combination of what was varied, its columns by label and unit."""
    figures = _shown_figures(sweep)
    groups = sweep.grouped(figures=figures)
    kept = [column.format(name) for name in figures for column in ("mean_{}", "{}_count", "worst_{}")]
    shown = groups[[*sweep.parameters, "runs", "passed", "judged", "collisions", *kept]]
    units = sweep.rows(sweep.parameters).attrs["units"]
    heads = {name: _head(label_of(name), units[name]) for name in sweep.parameters}
    heads |= {f"{name}_count": f"runs with {label_of(name)}" for name in figures}
    for which in ("mean", "worst"):
        heads |= {f"{which}_{name}": f"{which} {_head(label_of(name), unit_of(name))}" for name in figures}
    return shown.rename(columns=heads)


def _title(text: str) -> str:
    return f"<p><b>{escape(text)}</b></p>"


def _facts(facts: Mapping[str, str]) -> str:
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in facts.items())
    return f"<table>{''.join(rows)}</table>" if facts else ""


def _head(label: str, unit: str) -> str:
    return f"{label} [{unit}]" if unit else label


def _picture(figure: Figure) -> str:
    from io import BytesIO

    png = BytesIO()
    figure.savefig(png, format="png")
    return f'<img style="max-width: 100%" src="data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}">'
