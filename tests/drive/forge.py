"""What becomes of a record: cut off as by a kill, or altered by somebody who writes new hashes with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tests.record.declared import LIVE_TABLES
from vve_sumo.record.hashes import hash_files, hash_parts, whole
from vve_sumo.record.layout import OPTIONAL_SCHEMAS
from vve_sumo.record.summary import write_summary


def cut_off(folder: Path) -> None:
    """Leave of a record what a kill under way leaves: open tables, and no summary."""
    (folder / "summary.json").unlink()
    for file in [file for name in LIVE_TABLES | OPTIONAL_SCHEMAS if (file := folder / f"{name}.parquet").exists()]:
        table = pq.read_table(file)
        stream = str(file.with_suffix(".arrows"))
        with pa.OSFile(stream, "wb") as sink, pa.ipc.new_stream(sink, table.schema) as open_table:
            open_table.write_table(table)
        file.unlink()


def seal_again(folder: Path, **changes: Any) -> None:
    """Write the hashes of a record as it is now, and keys of its summary."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    parts = hash_parts(folder)
    hashes = {"record_sha256": whole(parts), "record_parts_sha256": parts, "record_files_sha256": hash_files(folder)}
    write_summary(folder, summary | hashes | changes)


def change_json(file: Path, *keys: str | int, value: Any) -> None:
    """Set a key of a JSON file, in the form that the file has."""
    content = json.loads(file.read_text(encoding="utf-8"))
    inner = content
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
