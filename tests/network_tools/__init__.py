"""Tests of the tools. Importing SUMO's room first keeps libsumo quiet (see its own first lines)."""

import vve_sumo.world  # noqa: F401
