"""The virtual road of a live drive: it waits for the operator's go, and a failure in it stops the car, not the process.

Knows neither car nor gateway: a failure is a reason code for the next tick.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping

from vve_sumo.drive.virtual_road import VirtualRoad
from vve_sumo.errors import VveError
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.values import Pose
from vve_sumo.world.ego_sync import EgoSyncReport
from vve_sumo.world.world import World


class LiveRoad(VirtualRoad):
    """A virtual road whose process goes on when SUMO, the traffic or the scenario's actors fail.

    The gateway then already has the newest fallback path, and the record can still be finished.
    """

    def __init__(self, world: World, engine: ScenarioEngine) -> None:
        super().__init__(world, engine, waits=True)
        self.traceback = ""  #: of the failure; empty while there was none

    def advance(self, poses: Mapping[str, Pose]) -> Mapping[str, EgoSyncReport]:
        """Advance as a virtual road does; after a failure, do nothing.

        Raises VveError only for the first pose, before which nothing is armed; the drive is then refused.
        """
        if self.traceback:
            return {}
        try:
            return super().advance(poses)
        except VveError:
            raise
        except Exception:
            self.traceback = traceback.format_exc()
            for around in self.around.values():
                around.faults += ("road_failed",)
            return {}
