"""A user's metrics: those that a scenario names, declared for records and sweeps, and measured of a drive.

Code of a user may fail: whatever it does becomes one line for the metric, and never an exception. Knows the port and a
drive's tables; neither scenarios nor records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.metrics import port
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.table import METRICS, SHIPPED_METRICS, enter
from vve_sumo.ports import error_text

if TYPE_CHECKING:
    from vve_sumo.metrics.drive_data import DriveData

#: names in summaries and in rows of sweeps that are no metrics
RESERVED: Final = frozenset(
    {"scenario", "title", "seed", "controller", "versions", "text", "brain", "rig", "shadow", "latency"}
    | {"gateway_steps", "metric_errors", "record_broken", "summary_sha256", "record_parts_sha256"}
    | {"record_files_sha256", "number", "key", "error", "undisturbed", "wall_s", "cpu_s", "peak_mb", "shared_s", "said"}
    | {"tick"}
)
#: characters of a text that a metric may return, and of the message about one that failed
MAX_TEXT: Final = 200
MAX_WHY: Final = 300
#: greatest whole number that a table holds
MAX_INT: Final = 2**63 - 1

#: what was expected of a metric, by the kind of its values
_EXPECTED: Final = {
    "bool": "True or False",
    "int": "a whole number",
    "float": "a finite number, or NaN where there is nothing to measure",
    "str": f"a text of one line, at most {MAX_TEXT} characters",
}


class Measured(NamedTuple):
    """What a user's metrics say of a drive."""

    per_drive: Mapping[str, Any] = {}  #: values by name; NaN, or None of another kind than float, where one failed
    per_tick: Mapping[str, Sequence[Any]] = {}  #: columns by name, an entry a tick; none of a metric that failed
    errors: Mapping[str, str] = {}  #: of each metric that failed, why, in one line


@dataclass(frozen=True, slots=True)
class DeclaredMetrics:
    """The rows of a user's metrics, without the functions: all that a record or a sweep keeps of them."""

    per_drive: Mapping[str, Metric] = field(default_factory=dict)
    per_tick: Mapping[str, Metric] = field(default_factory=dict)

    def to_dict(self) -> dict[str, list[dict[str, Any]]]:
        """Return the rows for JSON."""
        tables = {"per_drive": self.per_drive, "per_tick": self.per_tick}
        return {which: [row.to_dict() for row in rows.values()] for which, rows in tables.items()}

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """Return the rows that `to_dict` returned, of which the names of shipped metrics are left out.

        Those were a user's in an earlier version. Raises ConfigError in a few words for what is none.
        """
        try:
            tables = {which: [Metric.from_dict(row) for row in data.get(which, ())] for which in cls.__slots__}
            if wrong := port.wrong_rows(*tables.values()):
                raise ValueError(wrong)
        except (AttributeError, TypeError, ValueError) as error:
            raise ConfigError(f"metrics: no rows of this version: {error}") from None
        return cls(
            **{
                which: {row.name: row for row in rows if row.name not in SHIPPED_METRICS}
                for which, rows in tables.items()
            }
        )

    def enter(self) -> None:
        """Make the rows known by name to all that judges and shows figures."""
        enter({**self.per_drive, **self.per_tick})

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self.per_drive or self.per_tick)


@dataclass(frozen=True, slots=True)
class OwnMetrics:
    """The metrics that a scenario names, by the names of their files, in order."""

    parts: Mapping[str, port.Metrics] = field(default_factory=dict)

    @property
    def declared(self) -> DeclaredMetrics:
        """Their rows."""
        parts = self.parts.values()
        return DeclaredMetrics(
            {name: row for part in parts for name, row in part.per_drive.items()},
            {name: row for part in parts for name, row in part.per_tick.items()},
        )

    def measure(self, drive: DriveData) -> Measured:
        """Return what all metrics say of a drive; from then on these are what their names mean."""
        self.declared.enter()
        values: dict[str, Any] = {}
        columns: dict[str, Sequence[Any]] = {}
        errors: dict[str, str] = {}
        for file, part in self.parts.items():
            for name, row in part.per_drive.items():
                values[name] = math.nan if row.kind == "float" else None
                try:
                    values[name] = _value(row, part.per_drive.functions()[name](drive))
                except (Exception, SystemExit) as error:
                    errors[name] = f"metric {file}: {name} {_why(error)}"
            for name, row in part.per_tick.items():
                try:
                    columns[name] = _column(row, part.per_tick.functions()[name](drive), drive.ticks.num_rows)
                except (Exception, SystemExit) as error:
                    errors[name] = f"metric {file}: {name} {_why(error)}"
        return Measured(values, columns, errors)


def load_own(names: Iterable[str]) -> OwnMetrics:
    """Load a user's metrics by the names of their files.

    Raises ConfigError naming the file: where there is none, where what it offers is wrong, and for a metric's name that
    is taken.
    """
    parts: dict[str, port.Metrics] = {}
    taken: dict[str, str] = {}
    for file in names:
        if file in port.PORT.shipped:
            raise ConfigError(f"metric {file}: shipped metrics are always measured, expected a user's")
        parts[file] = port.load(file)
        for name in (*parts[file].per_drive, *parts[file].per_tick):
            if name in SHIPPED_METRICS or name in RESERVED:
                raise ConfigError(f"metric {file}: {name} is a name that vve_sumo uses itself, expected another")
            if name in taken:
                raise ConfigError(f"metric {file}: {name} is also a metric of {taken[name]}, expected another name")
            taken[name] = file
        _refuse_unknown_actors(file, parts[file])
    return OwnMetrics(parts)


def _refuse_unknown_actors(file: str, part: port.Metrics) -> None:
    known = {**METRICS, **part.per_drive}
    for name, row in part.per_drive.items():
        if row.actor and (row.actor not in known or known[row.actor].kind != "str"):
            raise ConfigError(f"metric {file}: {name}: actor: no metric {row.actor!r} that names an actor")


class _WrongValueError(Exception):
    """A metric returned what is no value of its kind."""


def _why(error: BaseException) -> str:
    return str(error) if isinstance(error, _WrongValueError) else f"raised {error_text(error, __file__)}"[:MAX_WHY]


def _value(row: Metric, value: Any) -> Any:
    """Return the value of a metric of a drive as plain Python; raises _WrongValueError where it is none of its kind."""
    if row.kind == "bool" and isinstance(value, (bool, np.bool_)):
        return bool(value)
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if row.kind == "int" and whole and -MAX_INT <= value <= MAX_INT:
        return int(value)
    if row.kind == "float" and _is_number(value) and not math.isinf(value):
        return float(value)
    if row.kind == "str" and _is_text(value):
        return value
    raise _WrongValueError(f"returned {_short(value)}, expected {_EXPECTED[row.kind]}")


def _column(row: Metric, values: Any, ticks: int) -> Sequence[Any]:
    """Return the column of a metric of the ticks; raises _WrongValueError where it is none of its kind and length."""
    if row.kind == "str":
        texts = list(values) if isinstance(values, (list, tuple, np.ndarray)) else None
        if texts is None or len(texts) != ticks or not all(map(_is_text, texts)):
            raise _WrongValueError(f"returned {_short(values)}, expected a list of {ticks} texts, one a tick")
        return [str(text) for text in texts]
    numbers = np.asarray(values)
    if numbers.dtype.kind not in "iuf" or numbers.shape != (ticks,):
        found = f"an array of {numbers.dtype} of shape {numbers.shape}"
        raise _WrongValueError(f"returned {found}, expected {ticks} numbers, one a tick")
    if np.isinf(numbers).any():
        raise _WrongValueError(f"returned {numbers[np.isinf(numbers)][0]} at a tick, expected finite numbers, or NaN")
    column: Sequence[Any] = numbers.astype(np.float64).tolist()
    return column


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MAX_TEXT and (value.isprintable() or not value)


def _short(value: Any) -> str:
    try:
        text = " ".join(repr(value).split())
    except Exception:
        return f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"a {type(value).__name__}"
