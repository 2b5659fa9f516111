"""`vve-sumo report`: writes the page and says where it is. The only module of the room that prints."""

from __future__ import annotations

from pathlib import Path

from vve_sumo.report.write import put, report_of


def report(folder: Path) -> int:
    """Run the command: write the report of a folder, print its place and the verdict; return the exit code, 0."""
    told = report_of(folder)
    page = put(told, folder)
    print(told.verdict.line)
    print(f"report: {page}")
    return 0
