"""Registers the environments with gymnasium: importing this module is what makes their names known.

`gymnasium.make("vve_sumo.bridges.environments:vve_sumo/ParkedCar-v0")` imports it by itself.
"""

from __future__ import annotations

from typing import Final

import gymnasium

ENTRY_POINT: Final = "vve_sumo.bridges.drive_environment:DriveEnvironment"

#: the paper's drive, and any scenario that the keyword `scenario` names; an agent's drive ends by itself
gymnasium.register(id="vve_sumo/ParkedCar-v0", entry_point=ENTRY_POINT, kwargs={"scenario": "parked_car"})
gymnasium.register(id="vve_sumo/Drive-v0", entry_point=ENTRY_POINT, kwargs={"agent_steers": True})
