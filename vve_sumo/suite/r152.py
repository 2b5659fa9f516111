"""UN R152 for cars (M1): a car that stands still or moves, and a child that crosses, laden and unladen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vve_sumo.suite import tables
from vve_sumo.suite.physics import Course, Need, full_braking, gap_used
from vve_sumo.suite.row import Approach, Row
from vve_sumo.suite.track import (
    AEB,
    CAR,
    KMH,
    LOADS,
    TARGET,
    gone_by,
    impact_at_most,
    said,
    scenario,
    target,
    time_to_brake,
)

#: the test speed may be less than stated, never more; so much less is driven [km/h]
BELOW = 0.2


def rows() -> Iterator[Row]:
    """Return the suite's rows."""
    moving = tables.R152_MOVING_TARGET_SPEED
    for load in LOADS:
        for entry in tables.R152_STATIONARY:
            yield from _car(entry, load, 0.0)
    for load in LOADS:
        for entry in tables.R152_MOVING:
            yield from _car(entry, load, moving)
    for load in LOADS:
        for entry in tables.R152_PEDESTRIAN:
            yield from _pedestrian(entry, load)


def _car(entry: tables.Impact, load: str, target_kmh: float) -> Iterator[Row]:
    ahead = tables.R152_LEAST_TTC * entry.speed * KMH
    actor = {"speed_mps": target_kmh * KMH}
    kind, what = "stationary", f"car stationary, {entry.speed:g} km/h"
    if target_kmh:
        kind, what = "moving", f"car moving at {target_kmh:g} km/h, {entry.speed:g} km/h faster"
    yield from _row(kind, what, entry, load, ahead, actor, lead=target_kmh * KMH)


def _pedestrian(entry: tables.Impact, load: str) -> Iterator[Row]:
    time, pace = tables.R152_LEAST_TTC, tables.R152_PEDESTRIAN_SPEED * KMH
    ahead = time * entry.speed * KMH
    # From the right; it would be in the middle of the car's way when the car comes by.
    actor = {"kind": "child", "speed_mps": pace, "offset_m": -time * pace, "turned_deg": 90.0}
    what = f"child crossing at {tables.R152_PEDESTRIAN_SPEED:g} km/h, {entry.speed:g} km/h"
    yield from _row("child", what, entry, load, ahead, actor, abort=gone_by(entry.speed * KMH, ahead))


def _row(
    kind: str,
    what: str,
    entry: tables.Impact,
    load: str,
    ahead: float,
    actor: dict[str, Any],
    *,
    lead: float = 0.0,
    abort: dict[str, Any] | None = None,
) -> Iterator[Row]:
    """Return the row of an entry at a load, or none; `lead` is how fast the target drives away [m/s]."""
    allowed = entry.laden if load == "laden" else entry.unladen
    if allowed is None:
        return
    relative, speed = entry.speed * KMH, entry.speed * KMH + lead
    driven = speed - BELOW * KMH
    needed = gap_used(full_braking(CAR, speed, LOADS[load]), Course(lead), allowed * KMH)
    yield Row(
        id=f"{kind}_{entry.speed:g}_{load}",
        what=f"{what}, {load}",
        required=said(allowed),
        scenario=scenario(
            f"R152: {what}, {load}",
            driven,
            lasts=ahead / relative + time_to_brake(speed),
            car={"mass_factor": LOADS[load]},
            controller={"tuning": AEB},
            actors=[target(driven, ahead, **actor)],
            criteria=impact_at_most(allowed * KMH),
            abort=abort or {"contact": True},
        ),
        approach=Approach(TARGET, speed, *(limit * KMH for limit in tables.R152_SPEED_TOLERANCE)),
        need=Need(needed, ahead),
    )
