"""Records that the tests of the pages look at, and the files of their columns taken apart without the page."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.isolated import REPOSITORY


class Made(NamedTuple):
    drive: Path
    traffic: Path
    sweep: Path
    hostile: Path


def traffic(folder: str) -> None:
    """Drive past parked cars between which a child stands, at first; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.run import resolve_by_name

    resolved = resolve_by_name("occluded_pedestrian", REPOSITORY, values={"duration_s": 22.0})
    drives.run(resolved, Path(folder), REPOSITORY)


def taken_apart(packed: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return header and columns of a file of columns, read by its description alone."""
    whole = gzip.decompress(packed)
    assert whole[:4] == b"VVEF"
    (length,) = struct.unpack_from("<I", whole, 4)
    head = json.loads(whole[8 : 8 + length])
    base = 8 + length
    columns = {
        one["name"]: np.frombuffer(whole, np.dtype("<" + one["kind"]), one["count"], base + one["offset"])
        for one in head["columns"]
    }
    return head, columns
