"""The five figures at the top of a report: of a drive, and of the runs of a sweep.

Knows names of metrics and criteria; neither the page nor where the values come from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vve_sumo.analysis.survivors import contacts, without_contacts
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import METRICS, label_of, meaning_of
from vve_sumo.report import formatting
from vve_sumo.report.formatting import integer, number, share

if TYPE_CHECKING:
    import pandas as pd

#: figures at the top
MANY = 5
#: figures of a drive that are shown where no criterion asks for others, the first ones first
OF_DRIVE = ("min_gap_m", "min_ttc_s", "stop_gap_m", "max_deceleration_mps2", "max_speed_mps", "duration_s")
#: figures of a sweep likewise
OF_SWEEP = ("min_gap_m", "min_ttc_s", "stop_gap_m", "max_deceleration_mps2", "max_lateral_deviation_m")


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A figure at the top of the page."""

    label: str
    value: str
    meaning: str = ""
    note: str = ""  #: beneath the value
    kind: Literal["", "yes", "no"] = ""  #: whether it met what was asked; empty where nothing was


def of_drive(figures: Mapping[str, Any], criteria: Mapping[str, Any]) -> list[KeyFigure]:
    """Return the key figures of a drive: of a contact, of its `criteria`, and those that always matter."""
    names = ["impact_speed_mps"] if figures.get("collision") else []
    names += [name for name in criteria if _is_number(name) and name != "duration_s" and criteria[name] is not None]
    names += [name for name in OF_DRIVE if not math.isnan(_value(figures, name))]
    failed = [str(line) for line in figures.get("failed") or ()]
    judged = isinstance(figures.get("passed"), bool)
    return [_of_drive(name, figures, criteria.get(name), failed, judged) for name in dict.fromkeys(names)][:MANY]


def _of_drive(name: str, figures: Mapping[str, Any], required: Any, failed: Sequence[str], judged: bool) -> KeyFigure:
    value = number(_value(figures, name), unit_of(name))
    note = "" if required is None else f"asked: {formatting.criterion(name, required)}"
    missed = any(line.startswith(f"{name} is ") for line in failed)
    kind: Literal["", "yes", "no"] = "" if required is None or not judged else ("no" if missed else "yes")
    if name == "impact_speed_mps":
        kind = "no"
    return KeyFigure(label_of(name), value, meaning_of(name), note, kind)


def of_sweep(rows: pd.DataFrame, passed: int, judged: int, criteria: Sequence[str]) -> list[KeyFigure]:
    """Return the key figures of a sweep: how many runs passed and collided, and the worst of three measures.

    Each worst value says of how many runs it is the worst: runs that have no such value are not in it.
    """
    rate = f"{share(passed / judged)} of the runs that were judged" if judged else "no run was judged"
    first = KeyFigure("met every criterion", f"{integer(passed)} of {integer(judged)}", "", rate)
    collision = rows["collision"].to_numpy(np.float64, na_value=np.nan)
    hits, known = int((collision == 1.0).sum()), int(np.isfinite(collision).sum())
    hit = KeyFigure("collisions", f"{integer(hits)} of {integer(known)}", meaning_of("collision"), _hardest(rows))
    names = dict.fromkeys([*(name for name in criteria if _is_number(name)), *OF_SWEEP])
    worst = [_worst(rows, name) for name in names if name in rows and METRICS[name].worse]
    return [first, hit, *(one for one in worst if one)][:MANY]


def _hardest(rows: pd.DataFrame) -> str:
    speed = rows["impact_speed_mps"].to_numpy(np.float64, na_value=np.nan)
    hard = float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
    return f"at {number(hard, 'm/s')} at most" if hard > 0.0 else ""


def _worst(rows: pd.DataFrame, name: str) -> KeyFigure | None:
    values, hits = without_contacts(rows, name), int(contacts(rows, name).sum())
    known = int(np.isfinite(values).sum())
    if not known:
        return None
    lower = METRICS[name].worse == "lower"
    row = int(np.nanargmin(values) if lower else np.nanargmax(values))
    note = f"run {rows['key'].iloc[row]}; {integer(known)} of {integer(len(rows))} runs have one"
    note += f", {integer(hits)} had a contact instead" if hits else ""
    label = f"{label_of(name)}, {'least' if lower else 'greatest'} of all runs"
    return KeyFigure(label, number(float(values[row]), unit_of(name)), meaning_of(name), note)


def _is_number(name: str) -> bool:
    return name in METRICS and METRICS[name].kind == "float"


def _value(figures: Mapping[str, Any], name: str) -> float:
    value = figures.get(name)
    return math.nan if value is None else float(value)
