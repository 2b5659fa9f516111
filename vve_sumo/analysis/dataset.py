"""A sweep's dataset: its rows whole, in portions or by SQL, what groups of them come to, and its records.

Reads a sweep's folder, finished or not, as it was when it was opened. It must not know how a sweep is run, nor what
anybody makes of its figures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.analysis import json_models
from vve_sumo.analysis.groups import COUNTS, NEEDED, grouped, meanings, numbered, repeated_by_seed
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.shown import shown
from vve_sumo.analysis.units import described
from vve_sumo.config_file import read_json
from vve_sumo.errors import ConfigError, hint
from vve_sumo.record.sweep_folder import SweepSnapshot

if TYPE_CHECKING:
    import duckdb
    import pandas as pd
    from matplotlib.figure import Figure


class Sweep:
    """A sweep's dataset, read from its folder as it is needed: a row a run; `load` opens one.

    >>> import vve_sumo as vve
    >>> sweep = vve.load("probe")
    >>> sweep.rows(["ego.speed_mps", "passed"])["ego.speed_mps"].tolist()
    [5, 10]
    >>> figure = sweep.plot("stop_gap_m")
    """

    def __init__(self, folder: Path) -> None:
        """Open a sweep's folder.

        Raises ConfigError in one line where there is none, one of another layout, one whose parts do not belong
        together, or one without a finished run.
        """
        self.folder = folder
        self._snapshot = SweepSnapshot.of(folder)
        json_models.check(self.plan, json_models.SweepModel, folder / "sweep.json")
        if self._snapshot.finished == 0:
            raise ConfigError(f"{folder}: no run of this sweep is finished; vve-sumo sweep … --resume goes on with it")

    @cached_property
    def plan(self) -> dict[str, Any]:
        """Content of `sweep.json`."""
        return asdict(self._snapshot.plan)

    @property
    def title(self) -> str:
        """Title of the sweep, or the scenario's name where it has none."""
        return str(self._snapshot.plan.spec.get("title") or self.scenario)

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self._snapshot.plan.scenario

    @property
    def parameters(self) -> list[str]:
        """What was varied: names of columns."""
        return list(self._snapshot.plan.parameters)

    @property
    def figures(self) -> list[str]:
        """What was measured, as far as it has a mean: names of columns."""
        return list(self._snapshot.plan.numbers())

    @property
    def columns(self) -> list[str]:
        """Names of all columns of a row."""
        return list(self._snapshot.plan.columns())

    @property
    def planned(self) -> int:
        """How many runs were asked for; of a search, at most."""
        return self._snapshot.plan.planned

    @property
    def finished(self) -> int:
        """How many runs are finished."""
        return self._snapshot.finished

    @cached_property
    def search_result(self) -> dict[str, Any] | None:
        """What a search found, content of `search.json`; None of a sweep that is none, or goes on."""
        file = self.folder / "search.json"
        if not file.exists():
            return None
        content = read_json(file, "a search", "search")
        json_models.check(
            content, json_models.Boundaries if content["search"] == "boundary" else json_models.SearchModel, file
        )
        return content

    def rows(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return every finished run, a row each, in the design's order; all columns or these.

        What a run has not is NaN in a number and NA elsewhere. Raises ConfigError for a column that is not there.
        """
        return self._frame(pa.concat_tables(self._snapshot.tables(self._known(columns))))

    def batches(self, columns: Sequence[str] | None = None) -> Iterator[pd.DataFrame]:
        """Return the rows as `rows` does in portions, about a thousand at a time, for a dataset larger than memory."""
        tables = self._snapshot.tables(self._known(columns))
        return (self._frame(table) for table in tables if table.num_rows)

    def machine(self) -> pd.DataFrame:
        """Return what every finished run took of the machine; `said` is the last that a run with an error printed."""
        return self._frame(pa.concat_tables(self._snapshot.machine()))

    def sql(self, query: str) -> pd.DataFrame:
        """Return the answer to a query in DuckDB's SQL over the tables `runs` and `machine`.

        Columns with dots in their names are quoted: `SELECT "ego.speed_mps" FROM runs`. The files are read as the query
        needs them, and what does not fit into memory goes to disk. Raises ConfigError for a query that is wrong, and
        where DuckDB is not installed.
        """
        if not query.strip():
            raise ConfigError(f"{self.folder}: sql: expected a query, got none")
        try:
            import duckdb
        except ImportError:
            raise ConfigError("sql needs DuckDB: pip install 'vve-sumo[sql]'") from None
        with tempfile.TemporaryDirectory() as spill:
            settings: dict[str, Any] = {"temp_directory": spill, "python_enable_replacements": "false"}
            with duckdb.connect(":memory:", config=settings) as connection:
                return self._described(self._answer(connection, query))

    def _described(self, answer: pd.DataFrame) -> pd.DataFrame:
        """Return an answer whose `attrs` know the columns of `rows`, of `machine` and of `grouped` by their names."""
        known = meanings(self._meanings)
        frame = described(answer, {name: known.get(name, "computed by the query") for name in map(str, answer)})
        frame.attrs["units"] |= {name: unit for name, unit in self._snapshot.plan.units().items() if name in frame}
        return frame

    def _answer(self, connection: duckdb.DuckDBPyConnection, query: str) -> pd.DataFrame:
        import duckdb

        try:
            connection.register("runs", self._snapshot.lazy())
            connection.register("machine", self._snapshot.lazy("machine"))
            answer: pd.DataFrame = connection.execute(query).df()
        except (duckdb.Error, pa.ArrowException, OSError) as error:
            raise ConfigError(f"{self.folder}: sql: {' '.join(str(error).split())[:300]}") from None
        return answer

    def grouped(self, by: Sequence[str] | None = None, figures: Sequence[str] | None = None) -> pd.DataFrame:
        """Return what the runs come to by combination of `by`, all that was varied if not said; see `groups.grouped`.

        `figures` are `self.figures` if not said; a truth value's mean is its share. Intervals are given of runs that
        chance made differ and nobody chose: repetitions of one combination by seed, and the points of a random design.
        """
        apart = self.parameters if by is None else list(by)
        wanted = self.figures if figures is None else list(figures)
        kinds = self._snapshot.plan.columns()
        text = next((name for name in wanted if kinds.get(name) == "str"), None)
        if text is not None:
            raise ConfigError(f"{self.folder}: figures: {text} is a text, which has no mean")
        counted = next((name for name in apart if name in COUNTS), None)
        if counted is not None:
            raise ConfigError(f"{self.folder}: by: {counted} is a column of what comes out, expected another")
        needed = dict.fromkeys([*apart, *self.parameters, "seed", *NEEDED, *self.figures, *wanted])
        frame = self.rows(list(needed))
        return described(grouped(frame, apart, wanted, self._by_chance(frame, apart)), meanings(self._meanings))

    def _by_chance(self, frame: pd.DataFrame, by: Sequence[str]) -> NDArray[np.bool_]:
        """Return whether each run (n) belongs to a group by `by` whose runs differ by chance alone."""
        spec, group = self._snapshot.plan.spec, numbered(frame, by)
        if spec.get("search") is not None:  # it chose its runs by what the others came to
            return np.zeros(len(frame), bool)
        if spec.get("design") == "random" and spec.get("seeds", 1) == 1:
            return np.asarray(np.bincount(group)[group] > 1) if len(frame) else np.zeros(0, bool)
        return repeated_by_seed(frame, group, self.parameters)

    def run(self, key: str) -> Run:
        """Return the record of a run; raises ConfigError where it was not kept, or where no run has the key."""
        record = self.folder / "records" / key
        if record.is_dir():
            return Run(record)
        if not any(key in batch["key"].to_numpy() for batch in self.batches(["key"])):
            raise ConfigError(
                f"{self.folder}: no finished run has the key {key!r}; the column key of its rows has them"
            )
        if self._snapshot.plan.design == "certificate":  # keeps the record of every drive, and none can be made again
            raise ConfigError(f"{record}: no record of {key}: its case was not driven, or its record was removed")
        raise ConfigError(
            f"{self.folder}: the record of {key} was not kept; vve-sumo sweep --rerun {self.folder} {key} makes it"
        )

    def export(self, form: str = "csv", out: str | Path | None = None) -> list[Path]:
        """Write the rows as "csv", beside them what their columns mean; return the files. `out` is as in `Run.export`.

        >>> import vve_sumo as vve
        >>> [file.name for file in vve.load("probe").export()]
        ['probe.csv', 'probe.columns.csv']
        """
        files: list[Path] = shown("export.write:export", self, form, out)
        return files

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
        drawn: Figure = shown("api.results:sweep_plot", self, figure, x, y, by, facet)
        return drawn

    def view(self) -> Any:
        """Show the sweep in the cell of a notebook, as a table that sorts and plots.

        The cell holds the whole page, but for the records of the runs: `vve-sumo view` opens these from the table.
        """
        return shown("view.notebook:ShownPage", self.folder)

    def __repr__(self) -> str:
        return str(shown("api.results:sweep_text", self))

    def _repr_html_(self) -> str:
        return str(shown("api.results:sweep_html", self))

    def _known(self, columns: Sequence[str] | None) -> list[str] | None:
        if columns is None:
            return None
        unknown = next((name for name in columns if name not in self.columns), None)
        if unknown is not None:
            raise ConfigError(f"{self.folder}: no column {unknown!r}; {hint(unknown, self.columns)}")
        return list(columns)

    def _frame(self, table: pa.Table) -> pd.DataFrame:
        # What may be missing; plain numpy would make objects of truth values, and floats of whole numbers.
        missing = {"bool": "boolean", "int": "Int64"}
        kinds = self._snapshot.plan.columns()
        sure = {"number", "seed", *self.parameters}
        if self._snapshot.plan.spec.get("controllers"):  # of which each has keys of its own
            sure = {name for name in sure if not name.startswith("controller.tuning.")}
        better = {
            name: missing[kinds[name]] for name in table.column_names if name not in sure and kinds.get(name) in missing
        }
        frame = described(table.to_pandas().astype(better), self._meanings)
        frame.attrs["units"] |= {name: unit for name, unit in self._snapshot.plan.units().items() if name in frame}
        return frame

    @cached_property
    def _meanings(self) -> dict[str, str]:
        return self._snapshot.plan.meanings()
