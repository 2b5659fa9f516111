"""Computes the content of a drive's `summary.json`: figures, and whether they meet the scenario's criteria.

Knows tables and figures; neither how a drive is run nor how a summary is shown.
"""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any, Protocol

import pyarrow as pa

from vve_sumo.drive.resolved_scenario import PERIOD, versions
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.path import Path
from vve_sumo.record.hashes import hash_files, whole
from vve_sumo.record.reader import read_table
from vve_sumo.scenario.schema import Band, Criteria, Scenario
from vve_sumo.values import Vehicle


class DrivenScenario(Protocol):
    """The scenario by which a drive's figures are judged: a resolved scenario, or a record's copy of one."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        ...

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        ...

    @property
    def path(self) -> Path:
        """The path of the rear axle, in the virtual road's map."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The car as declared."""
        ...


def summarise(driven: DrivenScenario, done: DriveEnd, folder: FilePath, parts: dict[str, str]) -> dict[str, Any]:
    """Return the content of `summary.json` for the record in `folder`; `parts` are the hashes of its parts."""
    summary = summary_of(driven, done, read_table(folder, "ticks"), read_table(folder, "actors"), parts)
    return summary | {"record_files_sha256": hash_files(folder)}


def summary_of(
    driven: DrivenScenario, done: DriveEnd, ticks: pa.Table, actors: pa.Table, parts: dict[str, str]
) -> dict[str, Any]:
    """Return a drive's summary without the hashes of files; `parts` are the hashes of the record's parts."""
    summary: dict[str, Any] = {
        "scenario": driven.name,
        "title": driven.scenario.title,
        "seed": driven.scenario.seed,
        "controller": driven.scenario.controller.name,
        "outcome": done.outcome.value,
        "reasons": list(done.reasons),
        **PER_DRIVE.measure(DriveData(ticks, actors, driven.path, driven.vehicle, PERIOD)),
        **done.extra,
        "removed_at_entry": list(done.cleared),
        "removed_after_standoff": list(done.standoffs),
        "sumo_warnings": list(done.warnings),
        "text": done.text,
        "versions": versions(),
    }
    failed = unmet_criteria(driven.scenario.criteria, summary)
    passed = None if done.outcome is Outcome.PLAYED else not failed
    hashes = {"record_sha256": whole(parts), "record_parts_sha256": parts}
    return summary | {"passed": passed, "failed": failed} | hashes


def unmet_criteria(criteria: Criteria, summary: dict[str, Any]) -> list[str]:
    """Return a line for every criterion that a drive's summary does not meet."""
    if summary["outcome"] == Outcome.PLAYED:
        return []
    failed = []
    for name, wanted in criteria:
        if wanted is None:
            continue
        got = summary[name]
        if isinstance(wanted, Band):
            got = PER_DRIVE[name].absent if math.isnan(got) else got
            good = (wanted.min is None or got >= wanted.min) and (wanted.max is None or got <= wanted.max)
            if not good:
                failed.append(f"{name} is {got:.3f}, expected {_band(wanted)}")
        elif got != wanted:
            failed.append(f"{name} is {got}, expected {wanted}")
    if summary["outcome"] in (Outcome.BROKEN, Outcome.INTERRUPTED):
        failed.append(f"the drive was {summary['outcome']}")
    if summary["outcome"] == Outcome.FAULT and criteria.outcome is None:
        failed.append("a fault ended the drive")
    return failed


def _band(band: Band) -> str:
    if band.min is None:
        return f"at most {band.max:g}"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"
