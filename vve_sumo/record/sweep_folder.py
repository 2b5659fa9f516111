"""Reads the folder of many drives: its plan, and a row for every finished run, while they go on or afterwards.

A sweep, a suite and a certificate leave the same folder. Knows its layout (`vve_sumo/sweep/dataset.py` writes its
files) and the columns of a row; neither how runs are driven nor what their rows mean.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, get_args

import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import Kind, Metric, unit_of
from vve_sumo.metrics.own import DeclaredMetrics
from vve_sumo.metrics.table import FIGURES, NUMBERS, enter, rows
from vve_sumo.record.columns import described_schema
from vve_sumo.scenario.descriptions import meaning_of_key

if TYPE_CHECKING:
    from pyarrow.dataset import Dataset

VERSION = 4  #: of this layout; rows of earlier versions had fewer figures, and a column `fault` in place of `error`

_ARROW: dict[str, pa.DataType] = {"bool": pa.bool_(), "int": pa.int64(), "float": pa.float64(), "str": pa.string()}

#: columns of a run, beside its figures
RUN = rows(
    Metric("number", "number", "of the run, in the design's order", kind="int"),
    Metric("key", "key", "of the run; the same run has the same key in every sweep", kind="str"),
    Metric("seed", "seed", "of the run", kind="int"),
    Metric("error", "error", "why there are no figures; empty where there are", kind="str"),
    Metric(
        "undisturbed",
        "undisturbed",
        "whether the drive is a test of its criteria: false where the driver stepped in, or a gateway fault ended it "
        "that no criterion asks for; meets_… hold what each criterion comes to by itself",
        kind="bool",
    ),
)
#: machine resources that a run took, and the last lines that a run with an error printed
MACHINE = rows(
    RUN["number"],
    RUN["key"],
    Metric("wall_s", "wall time", "wall time that the run took"),
    Metric("cpu_s", "processor time", "processor time that it took"),
    Metric("shared_s", "shared time", "drive time up to which other runs of the sweep were driven as one with it"),
    Metric("peak_mb", "peak memory", "greatest memory of its process, 10^6 bytes"),
    Metric("said", "last words", "the last that a run with an error printed", kind="str"),
)
#: every column that is not a parameter; no parameter may have one of these names
COLUMNS: dict[str, Metric] = {**RUN, **FIGURES, **MACHINE}
MACHINE_KINDS: dict[str, Kind] = {name: column.kind for name, column in MACHINE.items()}
MACHINE_SCHEMA = described_schema((name, _ARROW[column.kind], column.meaning) for name, column in MACHINE.items())

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class SweepPlan:
    """The content of `sweep.json`."""

    spec: dict[str, Any]  #: the sweep as in its file
    scenario: str  #: its name
    table: dict[str, Any]  #: the scenario as in its file
    file: str  #: the scenario's; names in it are looked up beside it
    working: str  #: folder in which the sweep was begun
    cells: int  #: number of runs; for a search, the greatest number
    parameters: dict[str, Kind]
    criteria: list[str]  #: that the scenario states or a parameter sets
    #: hashes by role of the files that the first runs read; of a certificate of all that decides it: rig, scenario, the
    #: vehicle's model and the brain too
    files_sha256: dict[str, list[str]]
    versions: dict[str, str]
    rig: str = ""  #: file of the rig whose car drives; empty: the scenario's vehicle
    #: hashes of each controller's code by its name and the file's role; none of a shipped one
    controllers_sha256: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    #: rows of the metrics that each run has beside the shipped ones: a user's, a suite's, a certificate's
    metrics: list[dict[str, Any]] = field(default_factory=list)
    design: Literal["sweep", "suite", "certificate"] = "sweep"
    #: of a suite: scenario and requirements of each test, by its value of the parameter `row`
    tests: dict[str, Any] = field(default_factory=dict)

    def own(self) -> Mapping[str, Metric]:
        """Return the rows of `metrics`; raises ConfigError for what is none."""
        return DeclaredMetrics.from_dict({"per_drive": self.metrics}).per_drive

    @property
    def planned(self) -> int:
        """Number of runs that were asked for; for a search, the greatest number. A certificate may leave cases out."""
        left_out = self.design == "certificate" and "cases" in self.spec
        return len(self.spec["cases"]) * self.spec["seeds"] if left_out else self.cells

    def numbers(self) -> tuple[str, ...]:
        """Return the figures of a row that are numbers with a mean."""
        return (*NUMBERS, *(name for name, metric in self.own().items() if metric.kind == "float"))

    def columns(self) -> dict[str, Kind]:
        """Return name and kind of a row's columns, in their order."""
        met: dict[str, Kind] = {f"meets_{name}": "bool" for name in self.criteria}
        figures: dict[str, Kind] = {name: metric.kind for name, metric in {**FIGURES, **self.own()}.items()}
        run: dict[str, Kind] = {"seed": "int", "error": "str", "undisturbed": "bool"}
        return {"number": "int", "key": "str", **self.parameters, **run, **figures, **met}

    def units(self) -> dict[str, str]:
        """Return the units of the parameters that the scenario declares: those of the keys that they set."""
        declared = self.table.get("parameters", {})
        return {name: unit_of(declared[name]["sets"][0]) for name in self.parameters if name in declared}

    def meanings(self) -> dict[str, str]:
        """Return what every column of a row, and of the machine's table, means."""
        declared = self.table.get("parameters", {})
        varied = {name: _meaning_of_parameter(name, declared.get(name, {})) for name in self.parameters}
        met = {f"meets_{name}": f"whether the criterion {name} was met" for name in self.criteria}
        return {name: column.meaning for name, column in {**COLUMNS, **self.own()}.items()} | varied | met

    def schema(self) -> pa.Schema:
        """Return the Arrow schema of a part, with unit and meaning of every column."""
        meanings = self.meanings()
        return described_schema(
            ((name, _ARROW[kind], meanings[name]) for name, kind in self.columns().items()), self.units()
        )

    def text(self) -> str:
        """Return the text of `sweep.json`."""
        return json.dumps({"version": VERSION} | asdict(self), indent=1) + "\n"

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Return the plan of a sweep's folder; raises ConfigError where it is missing, damaged or of another layout."""
        file = folder / "sweep.json"
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            version = data["version"]
            data = _LATER_KEYS | data
        except OSError:
            other = earlier_layout(folder) or "no sweep.json: not a sweep's folder"
            raise ConfigError(f"{folder}: {other}") from None
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{file}: not what a sweep writes: {error!r}") from None
        if version != VERSION:
            other = f"layout {version} of a dataset, expected {VERSION}: another vve-sumo wrote it{_who(data)}"
            raise ConfigError(f"{file}: {other}; a sweep into another folder makes it anew")
        wrong = _wrong({name: value for name, value in data.items() if name != "version"}, cls)
        if wrong:
            raise ConfigError(f"{file}: not what a sweep writes: {wrong}")
        plan = cls(**{one.name: data[one.name] for one in fields(cls)})
        try:
            enter(plan.own())
        except ConfigError as error:
            raise ConfigError(f"{file}: not what a sweep writes: {error}") from None
        return plan


#: keys of a plan that sweeps had not at first
_LATER_KEYS: dict[str, Any] = {
    "rig": "", "controllers_sha256": {}, "metrics": [], "design": "sweep", "tests": {}
}  # fmt: skip


def earlier_layout(folder: Path) -> str:
    """Return what a folder is that a suite or a certificate of an earlier vve-sumo left; empty for another folder."""
    if (folder / "sweep.json").is_file():
        return ""
    of = "a certificate" if (folder / "query.json").is_file() and (folder / "cases").is_dir() else ""
    of = of or ("a suite" if (folder / "journal.jsonl").is_file() else "")
    anew = "its tables can be read as they are; to go on, begin anew in another folder"
    return f"no sweep.json: the layout that {of} of an earlier vve-sumo left; {anew}" if of else ""


def _meaning_of_parameter(name: str, declared: Mapping[str, Any]) -> str:
    """Return what the scenario declares of a parameter, or what the key means that it sets."""
    key = declared["sets"][0] if declared else name
    return str(declared.get("meaning") or "") or meaning_of_key(key) or f"the scenario's {key}"


def _who(data: Mapping[str, Any]) -> str:
    versions = data.get("versions")
    version = versions.get("vve-sumo") if isinstance(versions, dict) else None
    return f", version {version}" if isinstance(version, str) else ""


_PLAIN = {"str": str, "int": int, "dict": dict, "list": list, "Literal": str}


def _wrong(data: Mapping[str, Any], plan: type[SweepPlan]) -> str:
    """Return what is wrong with the content of `sweep.json`, empty where nothing is."""
    for one in fields(plan):
        if type(data.get(one.name)) is not _PLAIN[str(one.type).partition("[")[0]]:
            return f"expected a {str(one.type).partition('[')[0]} as its {one.name}"
    unknown = [name for name in data if name not in {one.name for one in fields(plan)}]
    kinds = [f"{name}: {kind}" for name, kind in data["parameters"].items() if kind not in get_args(Kind)]
    return "".join(f"got {name}" for name in (unknown + kinds)[:1])


class SweepPart(NamedTuple):
    """A file of finished runs with consecutive numbers."""

    file: Path
    first: int  #: number of the file's first run
    runs: int


def parts(folder: Path, columns: Mapping[str, Kind]) -> list[SweepPart]:
    """Return the parts of a sweep's folder in the order of their runs; reads only the footer of each file.

    Raises ConfigError where a part cannot be read, has other columns, or shares runs with another part.
    """
    schema = schema_of(columns)
    files = sorted((folder / "rows").glob("part-*.parquet"))
    found = sorted((_part(file, schema) for file in files), key=lambda part: part.first)
    for one, other in pairwise(found):
        if one.first + one.runs > other.first:
            raise ConfigError(f"{other.file}: holds run {other.first}, as {one.file.name} does: not of one sweep")
    return found


def _part(file: Path, schema: pa.Schema) -> SweepPart:
    try:
        footer = pq.read_metadata(file)
        there = footer.schema.to_arrow_schema()
        spans = [footer.row_group(group).column(0).statistics for group in range(footer.num_row_groups)]
    except (pa.ArrowException, OSError) as error:
        raise unreadable(file, error) from None
    if there.names != schema.names or there.types != schema.types:
        pairs = zip_longest(schema, there)
        name = next((one or other).name for one, other in pairs if one is None or other is None or one != other)
        other = f"its columns are not those of this sweep, from {name} on"
        raise ConfigError(f"{file}: {other}: another vve-sumo or another sweep wrote it")
    data = [span for span in spans if span is not None and span.has_min_max]
    first, last = (min((int(span.min) for span in data), default=-1), max((int(span.max) for span in data), default=-1))
    if first < 0 or last - first + 1 != footer.num_rows:
        raise ConfigError(f"{file}: its runs do not follow each other: not a part that a sweep writes")
    return SweepPart(file, first, int(footer.num_rows))


def unreadable(file: Path, error: Exception) -> ConfigError:
    """Return the error for a file that cannot be read, with a message of one line."""
    return ConfigError(f"{file}: cannot be read: {' '.join(str(error).split())[:200]}")


@dataclass(frozen=True, slots=True)
class SweepSnapshot:
    """A sweep's folder as it was at one instant; the sweep may go on meanwhile."""

    folder: Path
    plan: SweepPlan
    parts: list[SweepPart]  #: in the order of run numbers
    rest: list[Row]  #: of runs that are in no part, in the order of run numbers

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read a folder; raises ConfigError where it holds no sweep, or one that cannot be read."""
        plan = SweepPlan.of(folder)
        # Runs move between the journal and parts: what was read while they moved may lack some of them.
        while True:
            before = _part_names(folder)
            noted, there = journal(folder), parts(folder, plan.columns())
            if _part_names(folder) == before:
                break
        rest = {row["number"]: row for row in noted if not _sealed(there, row["number"])}
        snapshot = cls(folder, plan, there, [rest[number] for number in sorted(rest)])
        snapshot._noted(plan.columns(), snapshot.rest)
        return snapshot

    @property
    def finished(self) -> int:
        """Number of finished runs."""
        return sum(part.runs for part in self.parts) + len(self.rest)

    def tables(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Yield the rows in the order of run numbers, in portions; None is all columns.

        Raises ConfigError for a damaged part.
        """
        return self._portions(self.plan.columns(), columns, "rows")

    def machine(self) -> Iterator[pa.Table]:
        """Yield the machine resources that the runs took, in the order of `tables`."""
        return self._portions(MACHINE_KINDS, None, "machine")

    def lazy(self, place: Literal["rows", "machine"] = "rows") -> Dataset:
        """Return the rows, or the machine resources, as a dataset of which only what a query needs is read."""
        from pyarrow import dataset

        kinds = self.plan.columns() if place == "rows" else MACHINE_KINDS
        files = [self.folder / place / part.file.name for part in self.parts]
        absent = next((file for file in files if not file.is_file()), None)
        if absent is not None:
            raise ConfigError(f"{absent}: not there: a part of the dataset is missing")
        sealed = dataset.dataset([str(file) for file in files], schema=schema_of(kinds), format="parquet")
        return dataset.dataset([sealed, dataset.dataset(self._noted(kinds, self.rest))])

    def _portions(self, kinds: Mapping[str, Kind], columns: Sequence[str] | None, place: str) -> Iterator[pa.Table]:
        names, at = list(kinds if columns is None else columns), 0
        for part in self.parts:
            before = at
            while at < len(self.rest) and self.rest[at]["number"] < part.first:
                at += 1
            if at > before:
                yield self._noted(kinds, self.rest[before:at]).select(names)
            yield _read(self.folder / place / part.file.name, names)
        yield self._noted(kinds, self.rest[at:]).select(names)

    def _noted(self, kinds: Mapping[str, Kind], rows: Iterable[Row]) -> pa.Table:
        try:
            return table_of(rows, kinds)
        except (pa.ArrowException, TypeError) as error:
            raise unreadable(self.folder / "journal.jsonl", error) from None


def _part_names(folder: Path) -> list[str]:
    return sorted(file.name for file in (folder / "rows").glob("part-*.parquet"))


def _sealed(sealed_parts: Sequence[SweepPart], number: int) -> bool:
    """Return whether a run is in one of the parts."""
    at = bisect_right(sealed_parts, number, key=lambda part: part.first) - 1
    return at >= 0 and number < sealed_parts[at].first + sealed_parts[at].runs


def _read(file: Path, columns: list[str]) -> pa.Table:
    try:
        return pq.ParquetFile(file).read(columns).select(columns)
    except (pa.ArrowException, OSError, KeyError) as error:
        raise unreadable(file, error) from None


def read_tables(folder: Path) -> Iterator[pa.Table]:
    """Yield the rows of a sweep, finished or not, in the order of run numbers, in portions.

    Raises ConfigError where the folder holds no sweep, or one that cannot be read.
    """
    return SweepSnapshot.of(folder).tables()


def journal(folder: Path) -> list[Row]:
    """Return the rows of a journal up to its last complete line; raises ConfigError for a line that is no run."""
    return journal_entries(folder / "journal.jsonl", {"number": int}, "run")


def journal_entries(file: Path, keys: Mapping[str, type], what: str) -> list[dict[str, Any]]:
    """Return the entries of a journal up to its last complete line; none where there is no file.

    Raises ConfigError for a line that is none of a finished `what`: no table with these keys and types of values.
    """
    try:
        lines = file.read_bytes().split(b"\n")[:-1]  # the last line has no line end: incomplete, or empty
    except FileNotFoundError:
        return []
    entries: list[dict[str, Any]] = []
    for number, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
        except ValueError:
            entry = None
        if not (isinstance(entry, dict) and all(isinstance(entry.get(key), kind) for key, kind in keys.items())):
            raise ConfigError(f"{file}: line {number} is no finished {what}: the file was damaged")
        entries.append(entry)
    return entries


def schema_of(columns: Mapping[str, Kind]) -> pa.Schema:
    """Return the Arrow schema of a part with these columns."""
    return pa.schema([(name, _ARROW[kind]) for name, kind in columns.items()])


def table_of(rows: Iterable[Row], columns: Mapping[str, Kind]) -> pa.Table:
    """Return rows as a table; a value that a row lacks is null."""
    return pa.Table.from_pylist(list(rows), schema=schema_of(columns))
