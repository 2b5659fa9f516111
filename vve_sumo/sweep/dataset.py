"""The folder of a sweep, a suite or a certificate: its plan, a row for every finished run, how they survive a kill.

    sweep.json               the spec, the scenario, hashes of what they name, versions; written first; changed only
                             where a suite or a certificate is continued with more seeds
    journal.jsonl            a line for every finished run that is in no part yet; on the disk before a run counts
    search.json              of a search: its result; written at its end
    rows/part-00000.parquet  1000 cells each, in their order; written once all of them are finished
    machine/part-*.parquet   beside each: wall time, memory; different in every sweep
    records/KEY              full records, where they are kept
    .lock                    held by the sweep that is at work

A finished run is at every instant in the journal or in a part. A part is written beside its place, synced, and renamed
into it, first the machine's, then the rows'; only then the journal is written anew without its lines, the same way. A
kill before the second rename leaves the journal whole, and the part is written again, with the same bytes. A line cut
by a kill has no end; it is cut off, and that run, which never counted, is run again. A part never changes; where runs
are added to its numbers, or its rows are judged anew, its rows go back into the journal, and only then the part is
deleted. So lines of the journal that belong to a part are as new as the part or newer: when the sweep continues, they
replace the part's rows, and the part is written again.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.record.sweep_folder import MACHINE_SCHEMA, Row, SweepPlan, SweepSnapshot, earlier_layout, journal, parts
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.journal import Journal, replace_file, sync_folder
from vve_sumo.sweep.run_specs import RunSpec

ROWS_PER_PART = 1000

#: keys of a spec that no row depends on; they may change before a sweep continues
IGNORED_KEYS = frozenset({"title", "keep"})
#: keys of a spec that may also change, by design: with more seeds there are more runs, other limits judge anew
CHANGING_KEYS = {
    "sweep": frozenset[str](), "suite": frozenset({"seeds"}), "certificate": frozenset({"seeds", "cases", "limits"})
}  # fmt: skip


def refuse_mixed(folder: Path, stored: Mapping[str, str], current: Mapping[str, str]) -> None:
    """Raise ConfigError unless a folder began with these versions of the software that determines a drive."""
    for name in sorted({*stored, *current}):
        began, now = stored.get(name, "none"), current.get(name, "none")
        if began != now:
            raise ConfigError(f"{folder}: mixed versions: its rows are of {name} {began}, got {now}")


def refuse_other(folder: Path, stored: SweepPlan, current: SweepPlan) -> None:
    """Raise ConfigError with the difference unless the runs in a folder are those of this plan.

    A suite and a certificate may have more seeds than there; a certificate other cases and limits.
    """
    if stored.design != current.design:
        raise ConfigError(f"{folder}: holds a {stored.design}, expected a {current.design}; choose another --out")
    refuse_mixed(folder, stored.versions, current.versions)
    another = f"{folder}: holds another {stored.design}"
    ignored = IGNORED_KEYS | CHANGING_KEYS[stored.design]
    for key in sorted({*stored.spec, *current.spec} - ignored):
        if stored.spec.get(key) != current.spec.get(key):
            raise ConfigError(f"{another}: its {key} differs; choose another --out")
    changed = [f"the scenario {stored.scenario}"] if stored.table != current.table else []
    changed += [f"the file of {role}" for role in _differing(stored.files_sha256, current.files_sha256)]
    changed += [f"the test {name}" for name in _differing(stored.tests, current.tests)]
    if changed:
        raise ConfigError(f"{folder}: {changed[0]} has changed since that {stored.design} began; choose another --out")
    if stored.columns() != current.columns() or (stored.cells != current.cells and "seeds" not in ignored):
        raise ConfigError(f"{another}: its columns or its number of runs differ")
    if stored.cells > current.cells:
        raise ConfigError(f"{folder}: holds {stored.spec['seeds']} seeds, expected as many or more")


def _differing(stored: Mapping[str, object], current: Mapping[str, object]) -> list[str]:
    return sorted(name for name in {*stored, *current} if stored.get(name) != current.get(name))


class Dataset:
    """A sweep's folder, locked by one process at a time; opening it repairs the state after a kill."""

    def __init__(
        self,
        folder: Path,
        plan: SweepPlan,
        *,
        resume: bool,
        hold: Callable[[Iterator[Row]], list[Row]] = lambda _rows: [],
        rows_per_part: int = ROWS_PER_PART,
    ) -> None:
        """Open a folder for a plan; `hold` receives the rows of its finished runs and returns what changes of them.

        Raises ConfigError, without any change, where the folder is locked, holds another sweep or other files, or holds
        this sweep and `resume` is false; so does `hold`.
        """
        self.folder, self.plan, self._per_part = folder, plan, rows_per_part
        self._cells = plan.cells
        _claim(folder, plan, resume=resume)
        with self._writing():
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = _locked(folder)
        try:
            _claim(folder, plan, resume=resume)
            changes = hold(self._stored_rows()) if (folder / "sweep.json").is_file() else []
            with self._writing():
                self._begin(changes)
        except BaseException:
            os.close(self._lock)
            raise

    def _stored_rows(self) -> Iterator[Row]:
        noted = {row["number"]: row for row in journal(self.folder)}
        return (noted.get(row["number"], row) for row in self.rows())

    def _begin(self, revised: Sequence[Row]) -> None:
        file = self.folder / "sweep.json"
        if not file.exists() or (self.plan.design != "sweep" and SweepPlan.of(self.folder) != self.plan):
            replace_file(file, self.plan.text().encode())
        for place in (self.folder, self.folder / "rows", self.folder / "machine"):
            place.mkdir(exist_ok=True)
            for left in place.glob(".*.tmp"):
                left.unlink()
        self._sealed = {
            int(part.file.stem.removeprefix("part-")): part.runs for part in parts(self.folder, self.plan.columns())
        }
        self._open: dict[int, Row] = {}
        self._finished_in: Counter[int] = Counter()
        noted = {row["number"]: row for row in journal(self.folder)}
        changes = noted | {row["number"]: noted.get(row["number"], {}) | row for row in revised}
        self._journal = Journal(self.folder / "journal.jsonl")
        # With more seeds than before, the last part of a suite or a certificate has room for further runs.
        growing = self.plan.design != "sweep"
        short = {part for part, runs in self._sealed.items() if growing and runs < self._size(part)}
        self._unseal(sorted(short | {number // self._per_part for number in changes} & self._sealed.keys()), changes)
        self._seal_complete()

    def close(self) -> None:
        """Unlock the folder; remove the journal of a complete sweep."""
        self._journal.close()
        if self.complete:
            (self.folder / "journal.jsonl").unlink()
        os.close(self._lock)

    @property
    def finished(self) -> int:
        """Number of finished runs."""
        return sum(self._sealed.values()) + len(self._open)

    @property
    def complete(self) -> bool:
        """Whether all runs are finished."""
        return self.finished == self._cells

    def holds(self, number: int) -> bool:
        """Whether the cell with this number is finished."""
        return number in self._open or number // self._per_part in self._sealed

    def settle(self, cells: int) -> None:
        """Set the number of runs of a sweep whose number was unknown; all of them are finished."""
        self._cells = cells
        with self._writing():
            self._seal_complete()

    def rows(self, columns: Sequence[str] | None = None) -> Iterator[Row]:
        """Yield the rows of all finished runs, without what they took of the machine, in the order of their numbers."""
        return (row for table in SweepSnapshot.of(self.folder).tables(columns) for row in table.to_pylist())

    def add(self, cell: RunSpec, result: RunResult) -> Row:
        """Store a finished run and return its row; after that, a kill does not lose it.

        Raises SimulationError where the disk cannot be written; rows stored before remain.
        """
        if self.holds(cell.number):
            raise ValueError(f"cell {cell.number} is finished already")
        row = row_of(self.plan, cell, result)
        with self._writing():
            self._journal.add(row)
            self._take(row)
            if self._part_complete(part := cell.number // self._per_part):
                self._seal(part)
        return row

    def _take(self, row: Row) -> None:
        self._open[row["number"]] = row
        self._finished_in[row["number"] // self._per_part] += 1

    def _size(self, part: int) -> int:
        return min(self._per_part, self._cells - part * self._per_part)

    def _part_complete(self, part: int) -> bool:
        return self._finished_in[part] == self._size(part)

    def _seal_complete(self) -> None:
        for part in [part for part in self._finished_in if self._part_complete(part)]:
            self._seal(part)

    def _unseal(self, numbers: Sequence[int], changes: Mapping[int, Row]) -> None:
        """Move the rows of parts into the journal, with changed and further rows by number; then delete the parts."""
        places = [self.folder / "rows", self.folder / "machine"]
        for part in numbers:
            del self._sealed[part]
            tables = (pq.read_table(place / _part_name(part)).to_pylist() for place in places)
            for row, took in zip(*tables, strict=True):
                self._take(row | took)
        for number, change in changes.items():
            if number in self._open:
                self._open[number] |= change
            else:
                self._take(change)
        self._journal.rewrite(self._open.values())
        for place in places:  # the rows first: rows without their machine's part would be a damaged sweep
            for part in numbers:
                (place / _part_name(part)).unlink()
            sync_folder(place)

    def _seal(self, part: int) -> None:
        """Write a part, then the journal without its rows."""
        first = part * self._per_part
        rows = [self._open[number] for number in range(first, first + self._size(part))]
        name = _part_name(part)
        replace_file(self.folder / "machine" / name, _parquet(rows, MACHINE_SCHEMA))
        replace_file(self.folder / "rows" / name, _parquet(rows, self.plan.schema()))
        self._sealed[part] = len(rows)
        del self._finished_in[part]
        for row in rows:
            del self._open[row["number"]]
        self._journal.rewrite(self._open.values())  # the rows of incomplete parts alone

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with _interrupted_afterwards():
                yield
        except OSError as error:
            raise SimulationError(
                f"{self.folder}: cannot be written: {error.strerror or error}; "
                "finished runs are stored; free some space and continue with --resume"
            ) from None


def _part_name(part: int) -> str:
    return f"part-{part:05d}.parquet"


def row_of(plan: SweepPlan, cell: RunSpec, result: RunResult) -> Row:
    """Return the row of a finished run; a missing metric is None."""
    machine = {"wall_s": result.wall_s, "cpu_s": result.cpu_s, "peak_mb": result.peak_mb, "said": result.said}
    machine |= {"shared_s": result.shared_s}
    fields = {
        "number": cell.number,
        "key": cell.key,
        "seed": cell.seed,
        "error": result.error,
        **cell.values,
        **machine,
    }
    return dict.fromkeys(plan.columns()) | {k: v for k, v in result.figures.items() if k in plan.columns()} | fields


def _claim(folder: Path, plan: SweepPlan, *, resume: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file, expected a folder for the {plan.design}")
    if (folder / "sweep.json").is_file():
        refuse_other(folder, SweepPlan.of(folder), plan)
        if not resume:
            raise ConfigError(f"{folder}: holds this {plan.design} already; --resume continues it")
        return
    if earlier := earlier_layout(folder):
        raise ConfigError(f"{folder}: {earlier}")
    began = {".lock", ".sweep.json.tmp"}  # by a sweep that was killed before it wrote its plan
    other = next((file for file in sorted(folder.glob("*")) if file.name not in began), None)
    if other is not None:
        raise ConfigError(f"{folder}: holds something else ({other.name}), expected an empty or absent folder")


def _locked(folder: Path) -> int:
    lock = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise ConfigError(f"{folder}: another process is driving into it") from None
    return lock


@contextlib.contextmanager
def _interrupted_afterwards() -> Iterator[None]:
    """Delay SIGINT until the block ends, so that the disk and the counts stay consistent.

    Only the main thread receives interrupts.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    interrupts: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: interrupts.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if interrupts:
            signal.raise_signal(signal.SIGINT)


def _parquet(rows: list[Row], schema: pa.Schema) -> bytes:
    """Return the bytes of a Parquet file; the same for the same rows."""
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(rows, schema), sink, use_dictionary=False, compression="zstd")
    data: bytes = sink.getvalue().to_pybytes()
    return data
