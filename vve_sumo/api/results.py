"""Drives and sweeps as the analysis reads them, which also plot themselves and show themselves in a notebook."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.analysis import dataset, run
from vve_sumo.analysis.effects import chosen_axes
from vve_sumo.analysis.load import open_folder
from vve_sumo.metrics.key_figures import key_figures
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from vve_sumo.view.notebook import ShownPage

#: combinations of a sweep that its table in a notebook shows
MAX_ROWS = 30
#: of a sweep that no criterion asks a number of
USUAL_FIGURES = ("stop_gap_m", "min_ttc_s")


class Run(run.Run):
    """A drive, read from its record's folder as it is needed.

    >>> import vve_sumo as vve
    >>> run = vve.load("mine")  # what vve.drive returns, read again
    >>> print(run.summary["outcome"], "from", round(run.ticks["speed_mps"].max()), "m/s")
    stopped from 12 m/s
    >>> figure = run.plot()
    """

    def plot(self) -> Figure:
        """Draw the page of the drive: path and actors from above; speed, gap and more over time."""
        from vve_sumo.plotting import drive_overview

        return drive_overview(self)

    def export(self, form: str, out: str | Path | None = None) -> list[Path]:
        """Write the drive as "csv", "fcd", "commonroad" or "openscenario"; return the files.

        `out` is a file that does not exist yet, or a folder; by default the working folder. Raises ConfigError for a
        format that there is not or that is not installed, and where a file exists.

        >>> import vve_sumo as vve
        >>> [file.name for file in vve.load("mine").export("csv")]
        ['mine.csv', 'mine.actors.csv', 'mine.columns.csv']
        """
        from vve_sumo.export.write import export

        return export(self, form, out)

    def view(self) -> ShownPage:
        """Show the drive in the cell of a notebook, and play it back, wherever the notebook's kernel runs.

        The cell holds the whole page, a few megabytes of a long drive. In a browser `vve-sumo view` shows it.
        """
        from vve_sumo.view.notebook import ShownPage

        return ShownPage(self.folder)

    def __repr__(self) -> str:
        return f"<Run {self.name} in {self.folder}: {self._verdict}>"

    def _repr_html_(self) -> str:
        figures = {} if self.summary is None else key_figures(self.summary)
        parts = (_title(self.title), f"<p>{escape(self._verdict)}</p>", _facts(figures), _picture(self.plot()))
        return "".join(parts)

    @property
    def _verdict(self) -> str:
        from vve_sumo.report.verdict import figures_of, of_drive

        return of_drive(self, figures_of(self)).line


class Sweep(dataset.Sweep):
    """A sweep's dataset, read from its folder as it is needed: a row a run.

    >>> import vve_sumo as vve
    >>> sweep = vve.load("probe")
    >>> sweep.rows(["ego.speed_mps", "passed"])["ego.speed_mps"].tolist()
    [5, 10]
    >>> figure = sweep.plot("stop_gap_m")
    """

    def run(self, key: str) -> Run:
        """Return the record of a run; raises ConfigError where it was not kept, or where no run has the key."""
        return Run(super().run(key).folder)

    def export(self, form: str = "csv", out: str | Path | None = None) -> list[Path]:
        """Write the rows as "csv", beside them what their columns mean; return the files. `out` is as in `Run.export`.

        >>> import vve_sumo as vve
        >>> [file.name for file in vve.load("probe").export()]
        ['probe.csv', 'probe.columns.csv']
        """
        from vve_sumo.export.write import export

        return export(self, form, out)

    def plot(
        self,
        figure: str = "stop_gap_m",
        x: str | None = None,
        y: str | None = None,
        *,
        by: str | None = None,
        facet: str | None = None,
    ) -> Figure:
        """Draw the mean of a figure over two parameters: `x` and `y`, or the two that explain most of its variance.

        Only numbers become axes that are not asked for. Of one, the figure is drawn over it; of none, its distribution.
        `by` and `facet` are parameters whose values have lines or panels of their own; the controller where there are
        several and nothing else is said, or another text that was varied.
        """
        from vve_sumo.plotting import distribution, heat_map, response

        asked = [name for name in (x, y, by, facet) if name is not None]
        known = ("seed", "error", "collision", "outcome", figure)
        rows = self.rows(list(dict.fromkeys([*self.parameters, *known, *asked])))
        chosen = chosen_axes(rows, figure, [name for name in self.parameters if name not in asked])
        first, second = (name for name in [*(one for one in chosen[:2] if one), None, None][:2])
        y = y or (first if x else second)
        x = x or first
        by = by or (chosen.by if chosen.by not in (x, y, facet) else None)
        if x is None:
            return distribution(rows, figure, by, facet=facet)
        if y is None:
            return response(rows, x, figure, by=by, facet=facet)
        return heat_map(rows, x, y, figure, by=by, facet=facet)

    def view(self) -> ShownPage:
        """Show the sweep in the cell of a notebook, as a table that sorts and plots.

        The cell holds the whole page, but for the records of the runs: `vve-sumo view` opens these from the table.
        """
        from vve_sumo.view.notebook import ShownPage

        return ShownPage(self.folder)

    def __repr__(self) -> str:
        return f"<Sweep {self.title} in {self.folder}: {self._counts}>"

    def _repr_html_(self) -> str:
        table = self._combinations()
        more = f"<p>… and {len(table) - MAX_ROWS} more combinations: .grouped()</p>" if len(table) > MAX_ROWS else ""
        shown = table.head(MAX_ROWS).to_html(index=False, float_format="{:.3g}".format, na_rep="none")
        picture = _picture(self.plot(self._shown_figures()[0]))
        return "".join((_title(self.title), f"<p>{escape(self._counts)}</p>", shown, more, picture))

    @property
    def _counts(self) -> str:
        rows = self.rows(["passed", "error"])
        passed, failed = (int(rows["passed"].eq(which).sum()) for which in (True, False))
        errors = int(rows["error"].ne("").sum())
        of = "" if self.found is not None or self.finished == self.asked else f" of {self.asked}"
        return f"{self.finished}{of} runs: {passed} passed, {failed} failed, {errors} with an error"

    def _shown_figures(self) -> Sequence[str]:
        """Return the figures that the scenario's criteria ask for, as far as they are numbers, or the usual ones."""
        return [name for name in self.plan["criteria"] if name in self.figures][:4] or USUAL_FIGURES

    def _combinations(self) -> pd.DataFrame:
        """Return a row a combination of what was varied, its columns by label and unit."""
        figures = self._shown_figures()
        groups = self.grouped(figures=figures)
        kept = [column.format(name) for name in figures for column in ("mean_{}", "{}_count", "worst_{}")]
        shown = groups[[*self.parameters, "runs", "passed", "judged", "collisions", *kept]]
        units = self.rows(self.parameters).attrs["units"]
        heads = {name: _head(label_of(name), units[name]) for name in self.parameters}
        heads |= {f"{name}_count": f"runs with {label_of(name)}" for name in figures}
        for which in ("mean", "worst"):
            heads |= {f"{which}_{name}": f"{which} {_head(label_of(name), unit_of(name))}" for name in figures}
        return shown.rename(columns=heads)


def load(path: Path | str) -> Run | Sweep:
    """Return the drive or the sweep whose folder this is; its tables are read when they are asked for.

    Raises ConfigError in one line where there is none, or one that cannot be read.

    >>> import vve_sumo as vve
    >>> vve.load("mine").title
    "The paper's drive: a car parked in the middle of the road"
    """
    return open_folder(Path(path), Run, Sweep)


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
