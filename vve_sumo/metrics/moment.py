"""Finds the moment of a drive that matters: the tick at which the conflict was closest, and with whom.

Reads what the metrics found of a drive; it must not know how the moment is drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.values import Floats

if TYPE_CHECKING:
    from vve_sumo.metrics.drive_data import DriveData

#: an actor that never came nearer than this had nothing to do with the drive [m], centre to centre
MAX_DISTANCE: Final = 60.0


#: a greater least gap says nothing of a conflict [m]
MAX_GAP: Final = 30.0


class MomentMeasure(StrEnum):
    """By what a moment was chosen."""

    CONTACT = "contact"
    TIME_TO_COLLISION = "TTC"
    GAP = "gap"
    DISTANCE = "distance"


@dataclass(frozen=True, slots=True)
class Moment:
    """The tick at which the conflict of a drive was closest."""

    row: int  #: of the ticks
    time: float  #: drive time [s]
    measure: MomentMeasure  #: by what it was chosen
    value: float  #: of the measure: [s] for a time to collision, else [m]; 0 for a contact
    actor: str  #: with whom


def moment_of(drive: DriveData) -> Moment | None:
    """Return the moment of the first contact; without one that of the least time to collision by predicted paths.

    Without such a time it is the moment of the least gap, if that is below MAX_GAP, else that of the least distance
    between the centres of the ego and any actor; None where no actor came within MAX_DISTANCE.
    """
    touched = next((row for row, names in enumerate(drive.ticks["contacts"].to_pylist()) if names), None)
    if touched is not None:
        actor = str(drive.ticks["contacts"][touched].as_py()).split("+")[0]
        return Moment(touched, float(drive.motion.time[touched]), MomentMeasure.CONTACT, 0.0, actor)
    candidates = (
        (MomentMeasure.TIME_TO_COLLISION, drive.conflict.time, drive.conflict.actor),
        (MomentMeasure.GAP, np.where(drive.lead.gap <= MAX_GAP, drive.lead.gap, np.nan), drive.lead.actor),
        (MomentMeasure.DISTANCE, *_nearest(drive)),
    )
    for measure, values, actors in candidates:
        if np.isfinite(values).any():
            row = int(np.nanargmin(values))
            return Moment(row, float(drive.motion.time[row]), measure, float(values[row]), actors[row])
    return None


def _nearest(drive: DriveData) -> tuple[Floats, list[str]]:
    """Return the least distance of the ego's centre to any actor's [m], and whose it is, tick by tick."""
    actors, ego = drive.actor_rows, drive.ego_boxes.select(drive.actor_rows.at)
    distance = np.hypot(actors.boxes.x - ego.x, actors.boxes.y - ego.y)
    least, names = np.full(drive.ticks.num_rows, np.nan), [""] * drive.ticks.num_rows
    near = np.flatnonzero(distance <= MAX_DISTANCE)
    for row in near[np.argsort(-distance[near], kind="stable")].tolist():
        at = int(actors.at[row])
        least[at], names[at] = distance[row], actors.names[actors.code[row]]
    return least, names
