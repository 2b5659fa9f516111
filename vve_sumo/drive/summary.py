"""Computes the content of a drive's `summary.json`: metrics, and whether they meet the scenario's criteria.

Knows tables and metrics; neither how a drive is run nor how a summary is shown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Protocol

import pyarrow as pa

from vve_sumo.drive.reasons import in_words
from vve_sumo.drive.resolved_scenario import versions
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.own import Measured, OwnMetrics
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.table import METRICS, label_of
from vve_sumo.path import ReferencePath
from vve_sumo.record.hashes import hash_files, whole
from vve_sumo.record.layout import TICK_METRICS
from vve_sumo.record.reader import read_commanded, read_table
from vve_sumo.record.roads import read_roads
from vve_sumo.record.tick_metrics import tick_metrics_table, write_tick_metrics
from vve_sumo.scenario.schema import Criteria, CriterionBand, Scenario
from vve_sumo.timing import PERIOD
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.arming import DRIVER_REASONS

NOTHING: Final = Measured()
NO_METRICS: Final = OwnMetrics()
#: what stands in the place of the controller's name where an external controller decided
EXTERNAL_CONTROLLER: Final = "foreign_brain"


class DrivenScenario(Protocol):
    """The scenario by which a drive's metrics are judged: a resolved scenario, or a record's copy of one."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        ...

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        ...

    @property
    def path(self) -> ReferencePath:
        """The path of the rear axle, in the virtual road's map."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The car as declared."""
        ...


def summarise(
    driven: DrivenScenario, done: DriveEnd, folder: Path, parts: dict[str, str], own: OwnMetrics = NO_METRICS
) -> dict[str, Any]:
    """Return the content of `summary.json` for the record in `folder`; `parts` are the hashes of its parts.

    What the user's metrics `own` say of every tick becomes a table of the record; where it cannot be written, the
    metrics have failed.
    """
    ticks, actors = read_table(folder, "ticks"), read_table(folder, "actors")
    roads, commanded = read_roads(folder), read_commanded(folder)
    measured = measure(driven, own, ticks, actors, roads, commanded)
    try:
        write_tick_metrics(folder, tick_metrics_table(own.declared.per_tick, measured.per_tick, ticks))
    except OSError as error:
        lost = dict.fromkeys(measured.per_tick, f"{TICK_METRICS} cannot be written: {error.strerror}")
        measured = measured._replace(errors={**measured.errors, **lost})
    summary = summary_of(driven, done, ticks, actors, parts, roads, measured, commanded)
    return summary | {"record_files_sha256": hash_files(folder)}


def measure(
    driven: DrivenScenario,
    own: OwnMetrics,
    ticks: pa.Table,
    actors: pa.Table,
    roads: pa.Table | None,
    commanded: pa.Table | None = None,
) -> Measured:
    """Return what a user's metrics say of a drive; they get tables of their own, so that they change no others'."""
    if not own.parts:
        return Measured()
    return own.measure(DriveData(ticks, actors, driven.path, driven.vehicle, PERIOD, roads, commanded))


def summary_of(
    driven: DrivenScenario,
    done: DriveEnd,
    ticks: pa.Table,
    actors: pa.Table,
    parts: dict[str, str],
    roads: pa.Table | None = None,
    measured: Measured = NOTHING,
    commanded: pa.Table | None = None,
) -> dict[str, Any]:
    """Return a drive's summary without the hashes of files.

    `parts` are the hashes of the record's parts; without `roads` actors are expected to keep to no lane. `measured` is
    what the user's metrics say of the drive. `commanded` are the paths that commands carry, None for a drive without
    any.
    """
    summary: dict[str, Any] = {
        "scenario": driven.name,
        "title": driven.scenario.title,
        "seed": driven.scenario.seed,
        "controller": driven.scenario.controller.name,
        "outcome": done.outcome.value,
        "reasons": list(done.reasons),
        **PER_DRIVE.measure(DriveData(ticks, actors, driven.path, driven.vehicle, PERIOD, roads, commanded)),
        **measured.per_drive,
        **({"metric_errors": dict(measured.errors)} if measured.errors else {}),
        **done.extra,
        "removed_at_entry": list(done.removed_at_entry),
        "removed_after_standoff": list(done.removed_after_standoff),
        "sumo_warnings": list(done.warnings),
        "text": done.text,
        "versions": versions(),
    }
    failed = unmet_criteria(driven.scenario.criteria, summary)
    passed = None if done.outcome is Outcome.PLAYED else not failed
    hashes = {"record_sha256": whole(parts), "record_parts_sha256": parts}
    return summary | {"passed": passed, "failed": failed} | hashes


def without_verdict(summary: dict[str, Any]) -> dict[str, Any]:
    """Return a summary of a drive that is no test of anything: in shadow mode the gateway commands nothing."""
    return summary | {"passed": None, "failed": []}


def unmet_criteria(criteria: Criteria, summary: Mapping[str, Any]) -> list[str]:
    """Return a line for every criterion that a drive's summary does not meet: its name, what came, what was expected.

    A value that is missing is `none`, with what that means; a value that is about an actor names the actor.
    """
    if summary["outcome"] == Outcome.PLAYED:
        return []
    own = [*filter(None, judged(criteria, summary).values()), *invalidating_events(criteria, summary)]
    return own + of_others(summary)


def of_others(summary: Mapping[str, Any]) -> list[str]:
    """Return the lines of criteria that the drive's other egos do not meet, by the summary of the first."""
    egos: Mapping[str, Any] = summary.get("egos") or {}
    return [f"ego {ego}: {line}" for ego, one in egos.items() for line in one["failed"]]


def judged(criteria: Criteria, summary: Mapping[str, Any]) -> dict[str, str]:
    """Return for every stated criterion the line of `unmet_criteria`, empty where the drive meets it.

    Each is judged by itself, on what the drive shows, whatever ended it.
    """
    return {name: _unmet(name, wanted, summary) for name, wanted in criteria if wanted is not None}


def invalidating_events(criteria: Criteria, summary: Mapping[str, Any]) -> list[str]:
    """Return a line for everything that makes a drive no test of its criteria, however many of them it meets.

    The drive was lost, its driver stepped in, or a gateway fault that no criterion speaks of ended it.
    """
    found = []
    if summary["outcome"] in (Outcome.BROKEN, Outcome.INTERRUPTED):
        found.append(f"the drive was {summary['outcome']}{_why('outcome', summary)}")
    if not DRIVER_REASONS.isdisjoint(summary.get("reasons") or ()):
        found.append(f"the driver stepped in{_why('outcome', summary)}")
    elif summary["outcome"] == Outcome.FAULT and criteria.outcome is None:
        found.append(f"a gateway fault ended the drive{_why('outcome', summary)}")
    return found


def _unmet(name: str, required: Any, summary: Mapping[str, Any]) -> str:
    """Return what a drive shows of a criterion that it does not meet; empty where it meets it."""
    got = summary[name]
    band = isinstance(required, CriterionBand)
    if failed := (summary.get("metric_errors") or {}).get(name):
        return f"{name} is none ({failed}), expected {_band(required) if band else required}"
    if band:
        met = _within(required, METRICS[name].absent if math.isnan(got) else got)
        return "" if met else f"{name} is {_value_in_words(name, got, summary)}, expected {_band(required)}"
    return "" if got == required else f"{name} is {got}{_why(name, summary)}, expected {required}"


def _within(band: CriterionBand, value: float) -> bool:
    return (band.min is None or value >= band.min) and (band.max is None or value <= band.max)


def _value_in_words(name: str, value: float, summary: Mapping[str, Any]) -> str:
    """Return the value of a metric that missed its band, with whom it is about, or with what it means to have none."""
    metric = METRICS[name]
    if math.isnan(value):
        return f"none ({metric.missing or 'nothing was measured'})"
    about = summary.get(metric.actor) if metric.actor else ""
    return f"{value:.3f} ({label_of(metric.actor)} {about})" if about else f"{value:.3f}"


def _why(name: str, summary: Mapping[str, Any]) -> str:
    """Return in words for which reasons a drive ended as it did; empty for another name than the outcome's."""
    codes = summary.get("reasons") or ()
    return f" ({', '.join(map(in_words, codes))})" if name == "outcome" and codes else ""


def _band(band: CriterionBand) -> str:
    if band.min is None:
        return f"at most {band.max:g}"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"
