"""What a scenario of several egos needs beyond one ego at a time: where they start, what each one's record says.

Knows resolved scenarios; neither SUMO nor how egos are driven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

from vve_sumo.drive.standstill_cause import DeclaredBodies
from vve_sumo.errors import ConfigError
from vve_sumo.frames import move_point
from vve_sumo.geometry import behind_bumper, overlap
from vve_sumo.values import EGO, Point, Pose

if TYPE_CHECKING:
    from vve_sumo.drive.resolved_scenario import ResolvedScenario


#: key of a record's scenario.json: its ego was simulated beside the real car of a live drive
BESIDE_LIVE = "beside_live_car"


def require_one_ego(resolved: ResolvedScenario, why: str) -> None:
    """Raise ConfigError, with the reason `why`, for a scenario with several egos."""
    if resolved.others:
        raise ConfigError(f"{resolved.file}: egos: {why}; take [[egos]] out, or drive it in lockstep (vve-sumo drive)")


def refuse_overlap(egos: Sequence[ResolvedScenario]) -> None:
    """Raise ConfigError where two egos start in one place."""
    boxes = {}
    for one in egos:
        start = one.path.at(one.scenario.ego.initial_s_m)
        axle = Pose(0.0, Point.REAR_AXLE, start.x, start.y, start.heading, 0.0, 0.0, 0.0, 0.0, 0.0)
        front = move_point(axle, one.vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER)
        boxes[one.ego_id] = behind_bumper(front.x, front.y, front.heading, one.vehicle.length, one.vehicle.width)
    for (first, box), (second, other) in combinations(boxes.items(), 2):
        if overlap(box, other):
            raise ConfigError(
                f"{egos[0].file}: egos.{second}: it starts where {first} does; expected another path, or "
                "initial_speed_mps with another initial_s_m"
            )


def further_ego(ego: str, declared: DeclaredBodies) -> dict[str, Any]:
    """Return what the record of a further ego keeps of the drive's scenario besides its own."""
    return {"id": ego} | {name: list(ids) for name, ids in declared._asdict().items()}


def recorded_ego(resolved: Mapping[str, Any]) -> tuple[str, DeclaredBodies | None]:
    """Return the id of the ego whose record's `scenario.json` this is, and of a further ego what `declared` holds.

    Raises ConfigError where a further ego's is of no version that is known.
    """
    if (further := resolved.get("further_ego")) is None:
        return EGO, None
    try:
        return str(further["id"]), DeclaredBodies(*(tuple(further[name]) for name in DeclaredBodies._fields))
    except (KeyError, TypeError) as error:
        raise ConfigError(f"scenario.json: further_ego: none of this version: {error!r}") from None
