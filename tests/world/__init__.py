"""Tests of the virtual road. Importing the room first keeps libsumo quiet (see its own first lines)."""

import vve_sumo.world  # noqa: F401
