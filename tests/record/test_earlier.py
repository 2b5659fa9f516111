"""Records of earlier layouts: what the table of actors lacked follows from the rest."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from tests.analysis.made import BOX, put, write
from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.record.hashes import hash_part
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.record.reader import read_stored_table, read_table

LATER = ("height_m", "kind")
#: name in SUMO, radar cross section, and the kind that they mean
ACTORS = [
    ("sedan.3", 10.0, "car"),
    ("bus.15", 100.0, "bus"),
    ("lorry", 100.0, "truck"),
    ("walker", 0.5, "pedestrian"),
    ("declared", 100.0, "bus"),
    ("parked", 30.0, "car"),
]


def of_layout_8(folder: Path) -> Path:
    settings = {
        "title": "by hand", "seed": 1, "controller": {"name": "nobody"}, "radar": {},
        "actors": [{"id": "declared", "kind": "bus"}], "obstacles": [{"id": "parked"}],
    }  # fmt: skip
    record = write(folder, [{}, {}], layout=8, settings=settings)
    rows = [BOX | {"tick": 0, "actor": n, "x_m": 1.0, "radar_cross_section_m2": s} for n, s, _ in ACTORS]
    put(record, "actors", rows)
    file = record / "actors.parquet"
    pq.write_table(pq.read_table(file).drop_columns([*LATER]), file)
    return record


def test_kinds_and_heights_follow_from_declaration_name_and_cross_section(tmp_path: Path) -> None:
    table = read_table(of_layout_8(tmp_path / "old"), "actors")
    assert table.schema.names == SCHEMAS["actors"].names
    assert [BODY_KINDS[kind] for kind in table["kind"].to_pylist()] == [kind for _, _, kind in ACTORS]
    assert table["height_m"].to_pylist() == [1.5, 3.2, 3.5, 1.7, 3.2, 1.5]
    assert table.schema.field("kind").type == pa.int8()


def test_the_hash_is_that_of_what_the_record_holds(tmp_path: Path) -> None:
    old = of_layout_8(tmp_path / "old")
    assert set(LATER).isdisjoint(read_stored_table(old, "actors").schema.names)
    new = tmp_path / "new"
    shutil.copytree(old, new)
    pq.write_table(read_table(old, "actors"), new / "actors.parquet")
    assert hash_part(old, "actors") != hash_part(new, "actors")
    assert json.loads((old / "scenario.json").read_text(encoding="utf-8"))["layout"] == 8
