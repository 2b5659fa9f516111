"""What drives mean: records and sweeps' datasets read, measured, compared, drawn and reported."""

from __future__ import annotations

from vve_sumo.analysis.run import Motion, Run

__all__ = ["Motion", "Run"]
