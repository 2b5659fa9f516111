"""The finished drives of a suite, a line each, so that a killed suite can be continued.

Knows outcomes and lines of JSON; neither how a drive is run nor how it is printed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from vve_sumo.errors import ConfigError
from vve_sumo.suite.row import RowOutcome, RowVerdict, SuiteRow
from vve_sumo.vehicle.model import VehicleModel

NAME = "journal.jsonl"
#: fields of an outcome that a line holds unchanged
PLAIN = ("why", "cut_in_ttc_s", "impact_mps", "least_gap_m", "deceleration_mps2", "demand_mps2", "cpu_s")


class SuiteJournal:
    """An open journal, to which finished drives are appended."""

    def __init__(
        self, folder: Path, rows: Sequence[SuiteRow], *, resume: bool, car: VehicleModel | None = None, code: str = ""
    ) -> None:
        """Begin a journal in `folder`, or continue the existing one; raises ConfigError where that is not of `rows`.

        A row with another `car` is another test, even if the car's file has the same name. `code` is the hash of the
        driving code: a journal of another controller's code, or of another vve-sumo, is refused.
        """
        file = folder / NAME
        self._digests, self._code = {row.id: digest(row, car) for row in rows}, code
        #: drives that were finished before
        self.known = _read(file, {row.id: row for row in rows}, self._digests, code) if resume else []
        folder.mkdir(parents=True, exist_ok=True)
        fresh = file.with_suffix(".new")
        with fresh.open("w", encoding="utf-8") as new:
            new.writelines(self._line(outcome) for outcome in self.known)
        fresh.replace(file)
        self._file = file.open("a", encoding="utf-8")

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def add(self, outcome: RowOutcome) -> None:
        """Append a finished drive."""
        self._file.write(self._line(outcome))
        self._file.flush()

    def _line(self, outcome: RowOutcome) -> str:
        fields: dict[str, Any] = {
            "row": outcome.row.id,
            "digest": self._digests[outcome.row.id],
            "code": self._code,
            "seed": outcome.seed,
            "verdict": outcome.verdict.value,
            "approach_mps": outcome.approach_mps,
            "record": None if outcome.record is None else str(outcome.record),
        }
        return json.dumps(fields | {name: getattr(outcome, name) for name in PLAIN}) + "\n"


def digest(row: SuiteRow, car: VehicleModel | None = None) -> str:
    """Return a hash of the row's scenario, its requirements and the car."""
    scenario = None if row.scenario is None else row.scenario.model_dump(mode="json")
    text = json.dumps(scenario, sort_keys=True) + repr((row.approach, row.cut_in, row.need, row.demand))
    if car is not None:
        text += json.dumps(car.to_dict(), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(file: Path, rows: dict[str, SuiteRow], digests: dict[str, str], code: str) -> list[RowOutcome]:
    """Return the drives of a journal up to its last complete line; none where there is no journal."""
    try:
        lines = file.read_bytes().split(b"\n")[:-1]  # a kill may have cut the last line short
    except FileNotFoundError:
        return []
    outcomes = []
    for number, line in enumerate(lines, 1):
        try:
            fields = json.loads(line)
            id, row_digest = fields["row"], fields["digest"]
            if digests.get(id) == row_digest and fields.get("code") == code:
                outcomes.append(_outcome(rows[id], fields))
                continue
        except (ValueError, KeyError, TypeError):
            raise ConfigError(f"{file}: line {number}: expected a finished drive; the file is damaged") from None
        if digests.get(id) == row_digest:
            other = f"row {id!r} was driven by other code of its controller, or by another vve-sumo"
            raise ConfigError(f"{file}: line {number}: {other}; drive the suite into another --out")
        raise ConfigError(
            f"{file}: line {number}: row {id!r} differs from the begun suite's, expected the same suite and car"
        )
    return outcomes


def _outcome(row: SuiteRow, fields: dict[str, Any]) -> RowOutcome:
    approach, record = fields["approach_mps"], fields["record"]
    return RowOutcome(
        row=row,
        seed=fields["seed"],
        verdict=RowVerdict(fields["verdict"]),
        approach_mps=None if approach is None else (approach[0], approach[1]),
        record=None if record is None else Path(record),
        **{name: fields[name] for name in PLAIN},
    )
