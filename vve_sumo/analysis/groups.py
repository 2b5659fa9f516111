"""What groups of runs come to: how many, how often they passed, where their figures lie.

Knows rows as a table; nothing of where they come from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vve_sumo.statistics import student, wilson
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: quantiles of a figure, by how their columns begin
QUANTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}

#: what a figure's columns begin with, and what they are
SPREAD = {
    "mean": "mean",
    "half_width": "half of Student's 95 % interval of the mean, which fewer than two runs do not have",
    "least": "least",
    **{name: f"quantile {share:g}" for name, share in QUANTILES.items()},
    "greatest": "greatest",
}

COUNTS = {
    "runs": "finished runs",
    "faults": "of them with a fault: without figures, neither passed nor failed",
    "judged": "of them that passed or failed",
    "passed": "of them that passed",
    "passed_share": "passed over judged; NaN for none",
    "passed_low_share": "lower end of Wilson's 95 % interval of that share",
    "passed_high_share": "its upper end",
}


def grouped(rows: pd.DataFrame, by: Sequence[str], figures: Sequence[str]) -> pd.DataFrame:
    """Return a row for every combination of values in the columns `by`, in the order in which they first come.

    Beside them the columns of COUNTS and for every figure those of SPREAD, such as `mean_min_ttc_s`, over the runs that
    have it, and how many those are: `min_ttc_s_count`. `rows` has `passed` and `fault` too.
    """
    import pandas as pd

    by = list(by)
    group: NDArray[np.int64] = np.zeros(len(rows), np.int64)
    if by:
        group = np.asarray(rows.groupby(by, sort=False, dropna=False).ngroup(), np.int64)
    heads = rows[by].drop_duplicates().reset_index(drop=True) if by else pd.DataFrame(index=range(min(len(rows), 1)))
    columns: dict[str, Any] = {**{name: heads[name] for name in by}, **_counts(rows, group, len(heads))}
    for name in figures:
        columns |= _spread(name, rows[name].to_numpy(np.float64, na_value=np.nan), group)
    return pd.DataFrame(columns, index=heads.index)


def meanings(of: Mapping[str, str]) -> dict[str, str]:
    """Return what the columns of such a table mean, given what those of the rows do."""
    spread = {f"{name}_{figure}": f"{what}: {of[figure]}" for figure in of for name, what in SPREAD.items()}
    return {**of, **COUNTS, **spread, **{f"{figure}_count": f"runs that have {figure}" for figure in of}}


def _counts(rows: pd.DataFrame, group: NDArray[np.int64], groups: int) -> dict[str, Any]:
    passed = rows["passed"].to_numpy(np.float64, na_value=np.nan)

    def count(which: NDArray[np.bool_]) -> NDArray[np.int64]:
        return np.bincount(group[which], minlength=groups)

    judged, good = count(np.isfinite(passed)), count(passed == 1.0)
    intervals = np.array([wilson(*pair) for pair in zip(good.tolist(), judged.tolist(), strict=True)]).reshape(-1, 2)
    share = np.divide(good, judged, out=np.full(groups, np.nan), where=judged > 0)
    faults = count(rows["fault"].to_numpy() != "")
    all_of_them = count(np.ones(len(rows), bool))
    return dict(zip(COUNTS, (all_of_them, faults, judged, good, share, *intervals.T), strict=True))


def _spread(name: str, values: Floats, group: NDArray[np.int64]) -> dict[str, Any]:
    import pandas as pd

    groups = pd.Series(values).groupby(group)
    count, mean = groups.count(), groups.mean()
    reach = np.array([student(int(number) - 1) for number in count])
    quantiles = groups.quantile(np.array(list(QUANTILES.values()))).unstack()
    said = (mean, reach * groups.sem(), groups.min(), *(quantiles[q] for q in QUANTILES.values()), groups.max())
    columns = {f"{which}_{name}": each for which, each in zip(SPREAD, said, strict=True)}
    return {**columns, f"{name}_count": count}
