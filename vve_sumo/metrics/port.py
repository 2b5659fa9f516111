"""The port of metrics: what a file of metrics offers, and how it is found by its name.

A file offers rows with the functions that measure them: of a whole drive, of every tick, or both. The shipped files use
the same port. Knows neither scenarios nor what anybody makes of a value. `tests/ports/metric.py` tests any file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, get_args

from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import Kind, Metric, MetricTable
from vve_sumo.ports import Port

if TYPE_CHECKING:
    from vve_sumo.metrics.drive_data import DriveData

#: Every file is found by a name of this table, as `file.py:function` or by entry point; `make()` returns its `Metrics`.
PORT: Final = Port(
    "metric",
    "vve_sumo.metrics",
    "()",
    {"per_drive": "vve_sumo.metrics.per_drive", "per_tick": "vve_sumo.metrics.per_tick"},
)

#: kinds of values that a column of ticks may hold
TICK_KINDS: Final = ("float", "str")
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
#: how the columns of a sweep's rows begin that say whether a criterion was met
_MEETS: Final = "meets_"


@dataclass(frozen=True, slots=True)
class Metrics:
    """What a file offers: rows are entered by `per_drive.add` and `per_tick.add`, each with its function.

    A function is handed the drive's tables. That of a drive returns one value of the row's kind; NaN stands for a drive
    that held nothing to measure. That of the ticks returns an array of numbers, or a list of texts, with an entry a
    tick; NaN and the empty text stand for nothing.
    """

    per_drive: MetricTable[DriveData] = field(default_factory=MetricTable)
    per_tick: MetricTable[DriveData] = field(default_factory=MetricTable)


def load(name: str) -> Metrics:
    """Return what a file of metrics offers; raises ConfigError, which begins with its name."""
    made = PORT.make(name, PORT.find(name))
    if not isinstance(made, Metrics):
        raise ConfigError(f"metric {name}: make returned {made!r}, expected Metrics of vve_sumo.metrics.port")
    if wrong := _wrong(made):
        raise ConfigError(f"metric {name}: {wrong}")
    return made


def shipped() -> Metrics:
    """Return what all shipped files offer."""
    whole = Metrics()
    for name in PORT.shipped:
        part = load(name)
        whole.per_drive.join(part.per_drive)
        whole.per_tick.join(part.per_tick)
    return whole


def installed() -> tuple[str, ...]:
    """Return the names by which installed packages offer metrics."""
    return tuple(name for name in PORT.known() if name not in PORT.shipped)


def _wrong(made: Any) -> str:
    """Return what is wrong with an offer in one phrase; empty where nothing is."""
    if not (isinstance(made.per_drive, MetricTable) and isinstance(made.per_tick, MetricTable)):
        return "per_drive and per_tick: expected a MetricTable each"
    if not made.per_drive and not made.per_tick:
        return "it offers no metric, expected one or more"
    if twice := sorted({*made.per_drive} & {*made.per_tick}):
        return f"{twice[0]} is a metric of the drive and of the ticks, expected another name for one of them"
    functions = {**made.per_drive.functions(), **made.per_tick.functions()}
    idle = (f"{name}: expected a function that measures it" for name in functions if not callable(functions[name]))
    return wrong_rows(made.per_drive.values(), made.per_tick.values()) or next(idle, "")


def wrong_rows(per_drive: Iterable[Metric], per_tick: Iterable[Metric]) -> str:
    """Return what is wrong with rows in one phrase; empty where nothing is."""
    columns = list(per_tick)
    wrong = (f"{row.name!r:.80}: {text}" for row in (*per_drive, *columns) if (text := _wrong_row(row)))
    kinds = " or ".join(TICK_KINDS)
    odd = (f"{row.name}: kind {row.kind!r}, of ticks expected {kinds}" for row in columns if row.kind not in TICK_KINDS)
    return next(wrong, "") or next(odd, "")


def _wrong_row(row: Any) -> str:
    if not (isinstance(row.name, str) and _NAME.fullmatch(row.name)):
        return "expected a name of small letters, digits and _, at most 64, with its unit at the end"
    if row.name.startswith(_MEETS):
        return f"expected a name that does not begin with {_MEETS}, as columns of sweeps do"
    texts = {"label": row.label, "meaning": row.meaning, "source": row.source}
    if bad := [word for word, text in texts.items() if not (isinstance(text, str) and text.isprintable() and text)]:
        return f"{bad[0]}: expected a text of one line, got {getattr(row, bad[0])!r}"
    if not (isinstance(row.missing, str) and isinstance(row.actor, str)):
        return "missing and actor: expected texts"
    if row.worse not in (None, "lower", "higher"):
        return f"worse: expected 'lower', 'higher' or None, got {row.worse!r}"
    if row.kind not in get_args(Kind):
        return f"kind: expected {', '.join(get_args(Kind))}, got {row.kind!r}"
    if not (isinstance(row.criterion, bool) and _is_number(row.absent) and _is_number(row.cap)):
        return "expected criterion as a truth value, absent and cap as numbers"
    return ""


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
