"""Folders that a report is written of: a drive, one that was killed, a sweep, and one with names that are code."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.drive.street import altered
from tests.isolated import REPOSITORY, isolated
from tests.once import once
from tests.sweep.test_dataset import PLAN
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec

#: what a user may call things
CODE = "</title><script>window.hit=1</script><img src=x onerror='window.hit=1'>\"&amp; $\\frac{$ \u202e _x_"
HOSTILE = f"{CODE}\ud800"  #: with half a character, which JSON holds


class Folders(NamedTuple):
    drive: Path
    killed: Path
    sweep: Path
    hostile: Path


def drive(folder: str) -> None:
    """Drive to a car that is parked near the start; call it through `isolated`."""
    from vve_sumo.drive import run as drives

    drives.run(altered({"obstacles.0.at_m": 60.0, "road.demand": []}), Path(folder), REPOSITORY)


def driven(factory: pytest.TempPathFactory, folder: Path) -> Path:
    """Return the folder with a copy of the record of that drive, which is driven once in a session."""
    shutil.copytree(once(factory, "near_drive", lambda record: isolated(drive, str(record))), folder)
    return folder


def cut_short(record: Path, folder: Path) -> Path:
    """Leave of a record what a kill does: tables that are streams still, and no summary."""
    folder.mkdir()
    for name in ("scenario.json", "pose.bin", "can.log"):
        shutil.copy(record / name, folder)
    for name in ("ticks", "readings", "sensor_radar", "actors"):
        table = pq.read_table(record / f"{name}.parquet")
        with pa.OSFile(str(folder / f"{name}.arrows"), "wb") as file, pa.ipc.new_stream(file, table.schema) as stream:
            stream.write_table(table.slice(0, table.num_rows // 2))
    return folder


def spoiled(record: Path, folder: Path) -> Path:
    """Write into a copy of a record what nobody should call anything."""
    shutil.copytree(record, folder)
    declared = json.loads((folder / "scenario.json").read_text(encoding="utf-8"))
    declared["settings"] |= {"title": CODE, "description": HOSTILE}
    declared["settings"]["obstacles"][0]["id"] = HOSTILE
    declared["settings"]["controller"]["name"] = HOSTILE
    (folder / "scenario.json").write_text(json.dumps(declared), encoding="utf-8")
    ended = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    ended |= {"outcome": "broken", "text": HOSTILE, "passed": False, "failed": [HOSTILE]}
    (folder / "summary.json").write_text(json.dumps(ended), encoding="utf-8")
    return folder


def runs() -> Iterator[tuple[RunSpec, RunResult]]:
    for number in range(36):
        speed, gap = float(number % 6), float(number // 6)
        hit = speed > gap + 2.0
        figures: dict[str, Any] = {"outcome": "contact" if hit else "stopped", "passed": not hit, "collision": hit}
        figures |= {"failed": CODE if hit else "", "stop_gap_m": None if hit else 1.0 + gap, "min_gap_m": gap - 1.0}
        figures |= {"impact_speed_mps": speed if hit else 0.0, "meets_stop_gap_m": not hit, "min_ttc_s": 1.0 + gap}
        figures |= {"stop_onset_speed_mps": speed + 5.0, "stop_distance_m": 10.0 + speed, "stop_bound_m": 12.0}
        figures |= {"stop_tolerance_m": 0.1, "hunting": False}
        figures |= {"stop_demand_mps2": 5.0, "stop_reaction_s": 0.1, "record_sha256": "0"}
        error = "crashed: SIGSEGV <b>" if number == 5 else ""
        values = {"ego.speed_mps": speed, "gap": gap}
        yield RunSpec(number, f"{number:016x}", values, 1), RunResult("", {} if error else figures, error)


def swept(folder: Path) -> Path:
    table = {"title": CODE, "description": CODE, "criteria": {"stop_gap_m": {"min": 1.0}}}
    table |= {"road": {"network": "linden"}, "parameters": {"gap": {"sets": ["a.b_m"], "meaning": CODE}}}
    kinds: dict[str, Any] = {"ego.speed_mps": "float", "gap": "float"}
    spec = {"title": "a sweep", "scenario": "s", "parameters": {"ego.speed_mps": [0.0, 5.0], "gap": [0.0, 5.0]}}
    dataset = Dataset(folder, replace(PLAN, spec=spec, table=table, cells=36, parameters=kinds), resume=True)
    for cell, result in runs():
        if not dataset.holds(cell.number):
            dataset.add(cell, result)
    dataset.close()
    return folder
