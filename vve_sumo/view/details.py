"""What of a record takes longer to compute than opening it may: gaps, actors that a sensor did not see, and the lot.

A second file of columns in the form of `frames`. Knows records; nothing of pages or servers.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensed import SensedTable, pose_at
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.record.layout import ACTOR_COLUMNS
from vve_sumo.values import Actors, FallbackPath, Point, Pose, Setpoint, resolve_fallback_path
from vve_sumo.vehicle import link
from vve_sumo.view.frames import Column, Frames, pack
from vve_sumo.view.lot_view import LotView
from vve_sumo.view.scene import VERSION, rig_of
from vve_sumo.view.sight import FieldOfViewCheck, MissReason

#: ticks from one footprint to the next; the page shows each for at most FOOTPRINT_LIFE ticks
FOOTPRINT_STEP: Final = 10

#: the reasons, as the file numbers them
WHY: Final = [why.value for why in MissReason]


class _Unseen(NamedTuple):
    """Actors that a sensor did not see: rows of reading k from first[k] to first[k + 1]."""

    first: list[int]
    code: list[int]
    why: list[str]


def details(run: Run) -> bytes:
    """Return the file of a record's details."""
    columns: dict[str, Column] = {"gap": run.data.strip_lead.gap.astype(np.float32), **_lot_columns(run)}
    looks = _looks(run)
    for number, table in enumerate(run.sensed.values()):
        found = _unseen(run, table, looks)
        columns |= {
            f"unseen{number}_first": np.array(found.first, np.int32),
            f"unseen{number}_code": np.array(found.code, np.int32),
            f"unseen{number}_why": np.array([WHY.index(why) for why in found.why], np.int32),
        }
    return pack(columns, {"version": VERSION, "texts": {"why": WHY}})


def _unseen(run: Run, table: SensedTable, looks: dict[int, Actors]) -> _Unseen:
    """Return the actors that a sensor did not see; none of one that declares no field of view, or names no actor."""
    view = table.drawing.view
    if view is None or table.actors is None:
        return _Unseen([0] * (len(table.at) + 1), [], [])
    look, pose, detected = FieldOfViewCheck(view), pose_at(run, table.measured), table.actors_of_readings()
    codes = {name: code for code, name in enumerate(run.data.actor_rows.names)}
    found = _Unseen([0], [], [])
    measured_at = np.clip(np.searchsorted(run.time, table.measured - 0.5 * run.period), 0, len(run.time) - 1)
    for reading, at in enumerate(measured_at.tolist()):
        x, y, heading = pose[:, reading].tolist()
        actors = looks.get(at)
        if actors is not None and np.isfinite(x + y + heading):
            missing = look.undetected((x, y, heading), actors, detected[reading])
            found.code.extend(codes[name] for name in missing)
            found.why.extend(why.value for why in missing.values())
        found.first.append(len(found.code))
    return found


def _looks(run: Run) -> dict[int, Actors]:
    """Return the actors that each tick saw, by the tick's index."""
    table = run.arrow("actors")
    at = index_of_tick(run.arrow("ticks"), table)
    names = table["actor"].to_pylist()
    columns = [table[name].to_numpy() for name in ACTOR_COLUMNS]
    ticks, begins = np.unique(at, return_index=True)
    ends = np.append(begins, len(at))[1:]  # none where no actor came into range
    return {
        tick: Actors(float(run.time[tick]), tuple(names[begin:end]), *(column[begin:end] for column in columns))
        for tick, begin, end in zip(ticks.tolist(), begins.tolist(), ends.tolist(), strict=True)
        if tick >= 0
    }


def _lot_columns(run: Run) -> dict[str, Column]:
    """Return metres to the edge at every tick, and the footprints; without a lot there are none."""
    rig = rig_of(run.resolved)
    if rig is None:
        empty = np.zeros(0, np.int32)
        nowhere = np.full(len(run.time), np.nan, np.float32)
        nothing = {"footprint_x": np.zeros(0, np.float32), "footprint_y": np.zeros(0, np.float32)}
        return {"to_edge": nowhere, "footprint_tick": empty, "footprint_first": np.zeros(1, np.int32), **nothing}
    lot, motion = LotView(rig, run.resolved, run.vehicle), run.motion
    real = Frames(run).columns
    places = (real[name].astype(np.float64) for name in ("real_x", "real_y", "real_heading"))
    ticks, first, lines = [], [0], [np.zeros((0, 2))]
    moved = (motion.x, motion.y, motion.heading, motion.speed, motion.acceleration)
    for at, (steering, fallback_path) in _profiles(run).items():
        x, y, heading, speed, acceleration = (float(column[at]) for column in moved)
        pose = Pose(float(run.time[at]), Point.REAR_AXLE, x, y, heading, speed, 0.0, 0.0, acceleration, 0.0)
        line = lot.footprint(lot.place(pose), steering, fallback_path)
        if line is not None:
            lines.append(line)
        ticks.append(at)
        first.append(first[-1] + (0 if line is None else len(line)))
    corners = np.concatenate(lines).astype(np.float32)
    return {
        "to_edge": lot.to_edges(*places).astype(np.float32),
        "footprint_tick": np.array(ticks, np.int32),
        "footprint_first": np.array(first, np.int32),
        "footprint_x": corners[:, 0].copy(),
        "footprint_y": corners[:, 1].copy(),
    }


def _profiles(run: Run) -> dict[int, tuple[float, FallbackPath | None]]:
    """Return measured steering and fallback path of every FOOTPRINT_STEP-th tick, by the tick's index.

    A live record keeps the setpoints' datagrams with the gateway's steps.
    """
    if not run.holds("gateway"):
        return {}
    gateway = run.arrow("gateway")
    times, datagrams = gateway["time_s"].to_numpy(), gateway["setpoint"].to_pylist()
    carrying = np.array([bool(data) for data in datagrams], bool)
    rows = np.flatnonzero(carrying)
    steering = run.data.column("measured_steering_rad")
    found: dict[int, tuple[float, FallbackPath | None]] = {}
    if not len(rows):
        return found
    for at in range(0, len(run.time), FOOTPRINT_STEP):
        row = rows[min(np.searchsorted(times[rows], run.time[at]), len(rows) - 1)]
        setpoint = link.decode_setpoint(datagrams[row])
        if isinstance(setpoint, Setpoint) and abs(setpoint.time - run.time[at]) < FOOTPRINT_STEP * run.period:
            found[at] = (float(steering[at]), resolve_fallback_path(setpoint.fallback_path))
    return found
