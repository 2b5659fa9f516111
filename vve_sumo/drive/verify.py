"""Checks whether a record is as its drive left it: compares every hash, and the summary with the tables.

Reads a record and runs no code that it names. The checks find damage and casual changes, not a careful forgery, which
computes the hashes anew.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from vve_sumo.drive import provenance
from vve_sumo.drive.several_egos import BESIDE_LIVE, recorded_ego
from vve_sumo.drive.snapshots import NO_ACTORS, snapshots
from vve_sumo.drive.standstill_cause import DeclaredBodies, StandstillClassifier
from vve_sumo.drive.summary import EXTERNAL_CONTROLLER, summary_of, without_verdict
from vve_sumo.drive.termination import END_REASONS, MOVING_SPEED, DriveEnd, Outcome, TerminationMonitor
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.own import Measured
from vve_sumo.path import ReferencePath
from vve_sumo.record.alterations import SUMMARY, Alteration, alterations_by_hash, is_live, parts_of, table_in
from vve_sumo.record.declared import read_resolved, recorded_path, recorded_vehicle
from vve_sumo.record.latencies import latency_summary
from vve_sumo.record.layout import recorded_brain, recorded_metrics
from vve_sumo.record.reader import read_commanded, read_table
from vve_sumo.record.roads import read_roads
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import EndTrigger, Scenario
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, Point, Pose, Vehicle
from vve_sumo.vehicle.arming import DRIVER_REASONS

#: relative and absolute tolerance of a metric: another processor rounds differently
RELATIVE_TOLERANCE: Final = 1e-9
#: outcomes of a lockstep drive that did not end by the car's motion or the time limit
ABNORMAL_OUTCOMES: Final = frozenset({Outcome.INTERRUPTED, Outcome.BROKEN})
#: columns of the true pose of the rear axle
TRUE_POSE_COLUMNS: Final = ("true_x_m", "true_y_m", "true_heading_rad", "true_speed_mps")
#: reason codes of a live drive's summary, for a lost process, that no row of the ticks or the gateway has
PROCESS_LOSS_REASONS: Final = frozenset({"drive_lost", "gateway_gone"})


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A record's copy of the scenario that was driven; no file that the record names is read."""

    name: str
    scenario: Scenario
    path: ReferencePath
    vehicle: Vehicle
    declared: DeclaredBodies | None  #: of a further ego: whom the drive's scenario puts on the virtual road


def altered_parts(folder: Path) -> list[str] | None:
    """Return the names of the parts that are not as the drive left them, as `alterations` does."""
    return parts_of(alterations(folder))


def alterations(folder: Path) -> list[Alteration] | None:
    """Return everything in a record that is not as its drive left it, as `alterations_by_hash` does.

    Where all hashes are in order, what the summary says is compared with the tables.
    """
    found = alterations_by_hash(folder)
    if found is None or found:
        return found
    summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    return [Alteration(SUMMARY, why) for why in _contradictions(folder, summary)]


def _contradictions(folder: Path, summary: dict[str, Any]) -> list[str]:
    """Return where a summary contradicts the rest of the record, whose hashes are all in order.

    Another version of this program may compute metrics differently, so only the version that wrote a summary checks it.
    Nothing is checked for a killed drive, which has no metrics, nor for a record whose recorder failed to write parts.
    """
    if "max_speed_mps" not in summary or summary.get("record_broken"):
        return []
    try:
        if not provenance.same_code(provenance.read(folder)):
            return []
        resolved = read_resolved(folder)
        recorded = _recorded_drive(resolved, folder / "scenario.json")
        metrics, names = _metrics(folder, recorded, summary), _names(resolved, summary)
        return [*metrics, *names, *_ending(folder, resolved, recorded, summary)]
    except (ConfigError, KeyError, TypeError, ValueError) as error:
        return [f"it does not fit to the record: {error!r}"]


def _recorded_drive(resolved: dict[str, Any], file: Path) -> RecordedDrive:
    return RecordedDrive(
        name=resolved["scenario"],
        scenario=parse(resolved["settings"], file),
        path=recorded_path(resolved),
        vehicle=recorded_vehicle(resolved),
        declared=recorded_ego(resolved)[1],
    )


def _metrics(folder: Path, recorded: RecordedDrive, summary: dict[str, Any]) -> Iterator[str]:
    """Compute every metric and the verdict again from the tables, and compare."""
    done = DriveEnd(
        Outcome(summary["outcome"]),
        tuple(summary["reasons"]),
        tuple(summary["removed_at_entry"]),
        tuple(summary["sumo_warnings"]),
        summary["text"],
        tuple(summary["removed_after_standoff"]),
        extra={"egos": summary["egos"]} if "egos" in summary else {},
    )
    ticks, actors = read_table(folder, "ticks"), read_table(folder, "actors")
    roads, commanded = read_roads(folder), read_commanded(folder)
    resolved = read_resolved(folder)
    own_metrics = _measured(resolved, summary)
    again = summary_of(recorded, done, ticks, actors, summary["record_parts_sha256"], roads, own_metrics, commanded)
    again |= {"versions": resolved["versions"]}
    if recorded_brain(resolved):
        again |= {"controller": EXTERNAL_CONTROLLER}
    if resolved.get("gateway", {}).get("shadow"):
        again = without_verdict(again)
    if is_live(folder, summary):
        again |= {"gateway_steps": read_table(folder, "gateway").num_rows}
        latency = read_table(folder, "latency")
        again |= {"latency": latency_summary(latency) if latency.num_rows else {}}
    for key, value in again.items():
        if not _same(summary.get(key), value):
            yield f"{key} is {summary.get(key)!r}, the tables come to {value!r}"


def _measured(resolved: dict[str, Any], summary: dict[str, Any]) -> Measured:
    """Return what the user's metrics said of the drive, by the summary itself: their code is not run."""
    own = recorded_metrics(resolved)
    own.enter()
    rows = own.per_drive
    values = {name: summary[name] for name in rows}
    missing = {name: math.nan for name, row in rows.items() if row.kind == "float" and values[name] is None}
    return Measured(values | missing, {}, table_in(summary, "metric_errors"))


def _same(recorded: object, again: object) -> bool:
    if isinstance(again, float) and not math.isfinite(again):
        return recorded is None
    if isinstance(again, float) and isinstance(recorded, (int, float)):
        return math.isclose(recorded, again, rel_tol=RELATIVE_TOLERANCE, abs_tol=RELATIVE_TOLERANCE)
    return recorded == again


def _names(resolved: dict[str, Any], summary: dict[str, Any]) -> Iterator[str]:
    """Compare the external controller, and of a live drive the rig's name and the shadow mode, with `scenario.json`."""
    brain = recorded_brain(resolved)
    expected = {"brain": brain} if brain else {}
    if "rig" in resolved:
        expected |= {"rig": resolved["rig_name"], "shadow": resolved["gateway"]["shadow"]}
    for key, value in expected.items():
        if summary.get(key) != value:
            yield f"{key} is {summary.get(key)!r}, scenario.json says {value!r}"


def _ending(folder: Path, resolved: dict[str, Any], recorded: RecordedDrive, summary: dict[str, Any]) -> Iterator[str]:
    """Compare outcome and reasons with the rows."""
    outcome, reasons = Outcome(summary["outcome"]), summary["reasons"]
    ticks = read_table(folder, "ticks")
    if "rig" in resolved:
        # The key is absent where the recorder was lost during the drive: its rows lack the end and its reasons.
        if "record_broken" in summary:
            yield from _live_ending(outcome, reasons, ticks, read_table(folder, "gateway"))
    elif resolved.get(BESIDE_LIVE):
        # When the car of [ego] went, and when its drive was over, only that car's record says.
        if (outcome is Outcome.CONTACT) != any(ticks["contacts"].to_pylist()):
            yield f"outcome is {outcome}, the ticks show another thing of contacts"
    elif "pose" in resolved["files_sha256"]:
        if outcome not in (Outcome.PLAYED, Outcome.INTERRUPTED, Outcome.BROKEN):
            yield f"outcome is {outcome}, of a playback"
    else:
        ended = _ended(ticks, read_table(folder, "actors"), recorded)
        yield from _lockstep_ending(outcome, reasons, ticks, recorded, ended)


def _lockstep_ending(
    outcome: Outcome, reasons: list[str], ticks: pa.Table, recorded: RecordedDrive, ended: Outcome | None
) -> Iterator[str]:
    """Compare outcome and reasons of a lockstep drive with those of its rows; `ended` is the outcome that they show."""
    triggered = not END_REASONS.isdisjoint(reasons[:1])
    if triggered:
        if recorded.scenario.end_trigger == EndTrigger():
            yield f"reasons begin with {reasons[0]}, and the scenario has no [end_trigger]"
        ended = Outcome.CONTACT if any(ticks["contacts"].to_pylist()) else Outcome.COMPLETED
    if outcome is not ended and not (outcome in ABNORMAL_OUTCOMES and ended is None):
        yield f"outcome is {outcome}, the ticks come to {ended or 'no end'}"
    gateway_reasons = reasons[1:] if triggered else reasons
    last = [code for code in (ticks["reasons"][-1].as_py() if ticks.num_rows else "").split("+") if code]
    if outcome not in (Outcome.INTERRUPTED, Outcome.BROKEN) and gateway_reasons != last:
        yield f"reasons are {gateway_reasons}, the last tick's are {last}"


def _ended(ticks: pa.Table, actors: pa.Table, recorded: RecordedDrive) -> Outcome | None:
    """Return a lockstep drive's outcome by the first of its rows that shows an end; None where no row does."""
    ending = TerminationMonitor(recorded.path.length, recorded.scenario.after_stop_s)
    standstill = StandstillClassifier(recorded.scenario, recorded.path, recorded.vehicle, recorded.declared)
    seen = snapshots(actors)
    last = round(recorded.scenario.duration_s / PERIOD) - 1
    names = ("tick", "time_s", "s_m", "state", "reasons", "contacts", *TRUE_POSE_COLUMNS)
    for row in zip(*(ticks[name].to_pylist() for name in names), strict=True):
        tick, time, s, state, reasons, contacts, x, y, heading, speed = row
        pose = Pose(time, Point.REAR_AXLE, x, y, heading, speed, 0.0, 0.0, 0.0, 0.0)
        ahead = partial(standstill.classify, pose, s, seen.get(tick, NO_ACTORS))
        outcome = ending.step(time, speed, s, ArmingState(state), reasons.split("+"), bool(contacts), ahead)
        if outcome is None and tick >= last:
            outcome = ending.unless_contact(Outcome.TIMEOUT)
        if outcome is not None:
            return outcome
    return None


def _live_ending(outcome: Outcome, reasons: list[str], ticks: pa.Table, gateway: pa.Table) -> Iterator[str]:
    """Compare outcome and reasons of a live drive with the contacts and reason codes in its rows."""
    contacts, speeds, states = (ticks[name].to_pylist() for name in ("contacts", "speed_mps", "state"))
    if outcome is Outcome.CONTACT and not any(contacts):
        yield f"outcome is {outcome}, and nothing was touched"
    # A contact at rest, before or after the drive, does not decide the outcome.
    under_way = [
        speed > MOVING_SPEED and state == ArmingState.ENGAGED for speed, state in zip(speeds, states, strict=True)
    ]
    if outcome in (Outcome.STOPPED, Outcome.ARRIVED) and any(map(all, zip(contacts, under_way, strict=True))):
        yield f"outcome is {outcome}, and something was touched"
    if outcome is Outcome.DRIVER and DRIVER_REASONS.isdisjoint(reasons):
        yield f"outcome is {outcome}, and no reason says that the driver stepped in"
    reported = {
        code for table in (ticks, gateway) for joined in table["reasons"].to_pylist() for code in joined.split("+")
    }
    if strange := [code for code in reasons if code not in reported | PROCESS_LOSS_REASONS]:
        yield f"reasons are {reasons}, the gateway never said {strange[0]}"
