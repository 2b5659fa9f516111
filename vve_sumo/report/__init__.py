"""The report of a drive or a sweep: one page that anybody can read, and its plots beside it."""

from __future__ import annotations

from vve_sumo.report.write import write_report

__all__ = ["write_report"]
