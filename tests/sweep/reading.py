"""A dataset's rows as the tests of this room look at them, without the analysis."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa

from vve_sumo.record.sweep_folder import read_tables


def load_rows(folder: Path) -> pd.DataFrame:
    """Return every finished run of a sweep, one row each, in cell order; of a sweep that is not finished, too."""
    return pa.concat_tables(read_tables(folder)).to_pandas()
