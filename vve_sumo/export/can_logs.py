"""The CAN part of a drive as logs of Vector's tools, BLF and ASC. The bus room writes them, with python-can."""

from __future__ import annotations

from collections.abc import Iterator

from vve_sumo.analysis.run import Run
from vve_sumo.bus import written_log
from vve_sumo.export.can_frames import frames_of
from vve_sumo.export.part import ExportPart


def asc_of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the log as text, times to the microsecond."""
    yield ExportPart("", written_log(frames_of(run), "asc"))


def blf_of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the log as BLF, compressed; python-can's times come back within a microsecond."""
    yield ExportPart("", written_log(frames_of(run), "blf"))
