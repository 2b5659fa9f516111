"""Schemas of tables that say of every column its unit and its meaning, to Arrow and, read from Parquet, to pandas.

Knows names, units and meanings; nothing of which tables there are.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Final

import pyarrow as pa

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of

#: key of a Parquet file's metadata under which pandas (2.1 and later) keeps the `attrs` of a DataFrame, as JSON
PANDAS_ATTRS: Final = "PANDAS_ATTRS"


def described_schema(
    columns: Iterable[tuple[str, pa.DataType, str]], units: Mapping[str, str] | None = None
) -> pa.Schema:
    """Return the schema of columns given as (name, type, meaning); `units` are of names that do not end in theirs.

    Every field's metadata has `meaning` and `unit`. `pandas.read_parquet` finds units, labels and meanings in `attrs`.
    """
    known = [(name, kind, meaning, (units or {}).get(name, unit_of(name))) for name, kind, meaning in columns]
    attrs = {
        "units": {name: unit for name, _, _, unit in known},
        "labels": {name: label_of(name) for name, *_ in known},
        "meanings": {name: meaning for name, _, meaning, _ in known},
    }
    fields = [pa.field(name, kind, metadata={"meaning": meaning, "unit": unit}) for name, kind, meaning, unit in known]
    return pa.schema(fields, metadata={PANDAS_ATTRS: json.dumps(attrs)})
