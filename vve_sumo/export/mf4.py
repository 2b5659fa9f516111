"""The CAN part of a drive as ASAM MDF 4.1 with bus events (MF4), written with asammdf.

All frames are one group `CAN_DataFrame`, as ASAM's associated standard for bus logging names it and its members.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.bus import LoggedFrame
from vve_sumo.errors import ConfigError
from vve_sumo.export.can_frames import frames_of
from vve_sumo.export.part import ExportPart
from vve_sumo.export.unix_time import MICROSECONDS, date_of, unix_of_drive
from vve_sumo.version import __version__

if TYPE_CHECKING:
    from asammdf import MDF

VERSION: Final = "4.10"  #: of MDF
DEFLATE: Final = 2  #: asammdf's number of the compression that transposes first: the smallest files
GROUP: Final = "CAN_DataFrame"
MAX_DATA: Final = 8  #: bytes of a classic frame
MEMBERS: Final = np.dtype(
    [
        (f"{GROUP}.BusChannel", "<u1"),
        (f"{GROUP}.ID", "<u4"),
        (f"{GROUP}.IDE", "<u1"),
        (f"{GROUP}.DLC", "<u1"),
        (f"{GROUP}.DataLength", "<u1"),
        (f"{GROUP}.DataBytes", f"({MAX_DATA},)u1"),
        (f"{GROUP}.Dir", "<u1"),
        (f"{GROUP}.EDL", "<u1"),
        (f"{GROUP}.BRS", "<u1"),
        (f"{GROUP}.ESI", "<u1"),
    ]
)


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the file; its time 0 is the drive's. Raises ConfigError where asammdf is not installed."""
    try:
        from asammdf import MDF, Signal, Source
        from asammdf.blocks.v4_blocks import FileHistory
    except ImportError:
        raise ConfigError("mf4 needs asammdf: pip install 'vve-sumo[mf4]'") from None
    frames, begin = frames_of(run), unix_of_drive(run, 0.0)
    time = np.array([round(one.time * MICROSECONDS) - begin for one in frames], np.int64) / MICROSECONDS
    source = Source("CAN", "CAN", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    written = FileHistory()
    # asammdf would enter the moment of writing; the same record shall give the same bytes.
    written.time_stamp = date_of(begin)
    written.comment = (
        f"<FHcomment><TX>exported</TX><tool_id>vve_sumo</tool_id><tool_vendor>vve_sumo</tool_vendor>"
        f"<tool_version>{__version__}</tool_version></FHcomment>"
    )
    with MDF(version=VERSION) as file:
        file.header.start_time = date_of(begin)
        file.file_history.append(written)
        file.append(Signal(_members(frames), time, name=GROUP, source=source), comment=run.title)
        yield ExportPart("", _content(file))


def _members(frames: Sequence[LoggedFrame]) -> NDArray[Any]:
    rows = np.zeros(len(frames), MEMBERS)
    rows[f"{GROUP}.BusChannel"] = [1 + one.channel for one in frames]
    rows[f"{GROUP}.ID"] = [one.frame.id for one in frames]
    rows[f"{GROUP}.DLC"] = rows[f"{GROUP}.DataLength"] = [len(one.frame.data) for one in frames]
    data = b"".join(one.frame.data.ljust(MAX_DATA, b"\0") for one in frames)
    rows[f"{GROUP}.DataBytes"] = np.frombuffer(data, np.uint8).reshape(-1, MAX_DATA)
    rows[f"{GROUP}.Dir"] = [one.sent for one in frames]
    return rows


def _content(file: MDF) -> bytes:
    with tempfile.TemporaryDirectory(prefix="vve_sumo_") as folder:
        saved = Path(folder) / "log.mf4"
        file.save(saved, compression=DEFLATE, add_history_block=False)
        return saved.read_bytes()
