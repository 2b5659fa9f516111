"""A virtual road with nothing on it but the scenario's obstacles; it has the face of `VirtualRoad`, and no SUMO.

Must not know what drives on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.virtual_road import EgoSurroundings, no_signals, obstacle_position
from vve_sumo.geometry import Box, behind_bumper, overlap
from vve_sumo.intersections import SignalPhase
from vve_sumo.values import EGO, Actors, Floats, Pose, SignalChange
from vve_sumo.world.ego_sync import EgoSyncReport


class EmptyRoad:
    """Standing obstacles, which the ego may touch."""

    def __init__(self, resolved: ResolvedScenario) -> None:
        obstacles, vehicle = resolved.scenario.obstacles, resolved.vehicle
        places = [obstacle_position(one, resolved.path) for one in obstacles]
        self._boxes = {
            one.id: Box(place.x, place.y, place.heading, one.length_m, one.width_m)
            for one, place in zip(obstacles, places, strict=True)
        }
        self._kinds = [one.kind for one in obstacles]
        self._length, self._width = vehicle.length, vehicle.width
        self.around = {EGO: EgoSurroundings(self._standing())}  #: of the only ego

    def _standing(self) -> Actors:
        boxes = self._boxes.values()

        def column(name: str) -> Floats:
            return np.array([getattr(box, name) for box in boxes], dtype=np.float64)

        zeros = np.zeros(len(boxes))
        return Actors(
            time=0.0,
            ids=tuple(self._boxes),
            x=column("x"),
            y=column("y"),
            heading=column("heading"),
            speed=zeros,
            length=column("length"),
            width=column("width"),
            radar_cross_section=np.array([TYPICAL[kind].radar_cross_section for kind in self._kinds], dtype=np.float64),
            lateral_speed=zeros,
            height=np.array([TYPICAL[kind].height for kind in self._kinds], dtype=np.float64),
            kind=np.array([number_of(kind) for kind in self._kinds], dtype=np.int8),
        )

    def signal_changes(self, since: int) -> Sequence[SignalChange]:
        """Return none."""
        return ()

    def timed_signals(self) -> Callable[[float], Mapping[str, SignalPhase]]:
        """Return what tells what the signals show: there are none."""
        return no_signals

    def advance(self, poses: Mapping[str, Pose]) -> Mapping[str, EgoSyncReport]:
        """Place the ego's front bumper at a pose; without one, nothing is done. There is no report of a placement."""
        if (pose := poses.get(EGO)) is None:
            return {}
        ego, around = behind_bumper(pose.x, pose.y, pose.heading, self._length, self._width), self.around[EGO]
        around.contacts = tuple(name for name, box in self._boxes.items() if overlap(ego, box))
        around.faults = ("virtual_contact",) if around.contacts else ()
        around.actors = replace(around.actors, time=pose.time)
        return {}
