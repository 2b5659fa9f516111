"""What groups of runs come to: how many, how often they passed, where their figures lie.

Knows rows as a table; nothing of where they come from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.survivors import contacts, with_contacts, without_contacts
from vve_sumo.metrics.contacts import BEYOND, at_contact
from vve_sumo.metrics.table import METRICS
from vve_sumo.statistics import student, wilson
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: quantiles of a figure, by how their columns begin
QUANTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}

#: what a figure's columns begin with, and what they are, over the runs that have it; of a figure that a contact is
#: beyond, over those of them without a contact
SPREAD = {
    "mean": "mean over the runs that have it; of gaps, times to collision and DRAC over those without a contact",
    "half_width": "half of Student's 95 % interval of the mean; none where chance did not make the runs differ",
    "worst": "worst, a contact as no gap, no time, the greatest DRAC; none of a figure of which neither way is worse",
    "least": "least",
    **{name: f"quantile {share:g}" for name, share in QUANTILES.items()},
    "greatest": "greatest",
}
#: how the column begins that also counts runs with a contact, and what it is
MEDIAN_OF_ALL = "median_all"
MEDIAN_OF_ALL_MEANS = (
    "median over all runs that have it or a contact, which is beyond every value; none where half had one"
)
#: how the columns end that say of how many runs a figure is, and what they are; the first three add up to `runs`
NUMBERS_OF = {
    "count": "runs of which the mean is",
    "contacts": "runs that a contact leaves without it; none of a figure that a contact leaves as it is",
    "missing": "runs without it for another reason",
    "share": "count over runs",
}

COUNTS = {
    "runs": "finished runs",
    "errors": "of them with an error: without figures, neither passed nor failed",
    "collisions": "of them with a collision",
    "stopped_by_gateway": "of them that the gateway stopped for a reason code: the outcome is fault",
    "judged": "of them that passed or failed",
    "passed": "of them that passed",
    "passed_share": "passed over judged; none where none was judged",
    "passed_low_share": "lower end of Wilson's 95 % interval of that share; none as for half_width",
    "passed_high_share": "its upper end",
}
#: columns of the rows that the counts take
NEEDED = ("passed", "error", "collision", "outcome")


def grouped(
    rows: pd.DataFrame, by: Sequence[str], figures: Sequence[str], repeated: NDArray[np.bool_] | None = None
) -> pd.DataFrame:
    """Return a row for every combination of values in the columns `by`, in the order in which they first come.

    Beside them the columns of COUNTS and for every figure those of SPREAD, such as `mean_min_ttc_s`, over the runs that
    have it, and of how many runs they are, with the endings of NUMBERS_OF, such as `min_ttc_s_count`. A contact is
    beyond every gap, time to collision and DRAC: a run with one is in no mean of them, and they have `median_all_…`
    too. `rows` has the columns NEEDED too. `repeated` says of every run (n) whether the runs of its group are
    repetitions by chance: only of those there are intervals; all if not said.
    """
    import pandas as pd

    by = list(by)
    group = numbered(rows, by)
    heads = rows[by].drop_duplicates().reset_index(drop=True) if by else pd.DataFrame(index=range(min(len(rows), 1)))
    sure = np.ones(len(heads), bool)
    if repeated is not None:
        sure[group[~repeated]] = False
    columns: dict[str, Any] = {**{name: heads[name] for name in by}, **_counts(rows, group, sure)}
    for name in figures:
        columns |= _spread(name, rows, group, sure)
    return pd.DataFrame(columns, index=heads.index)


def numbered(rows: pd.DataFrame, by: Sequence[str]) -> NDArray[np.int64]:
    """Return for every run (n) the number of its group, from 0 in the order in which the groups first come."""
    if not by:
        return np.zeros(len(rows), np.int64)
    return np.asarray(rows.groupby(list(by), sort=False, dropna=False).ngroup(), np.int64)


def repeated_by_seed(rows: pd.DataFrame, group: NDArray[np.int64], parameters: Sequence[str]) -> NDArray[np.bool_]:
    """Return whether each run (n) belongs to a group of repetitions that differ by their seed alone, and do differ.

    Where the values of a parameter differ within the group, its runs are cells of a design that somebody chose, and
    where every figure is the same with every seed, chance has no part in the runs: neither has a sampling error.
    A run with an error has no figures, and so differs in none. `rows` has `seed`, `error`, the parameters, and the
    figures by which runs are told apart.
    """
    import pandas as pd

    parts, driven = rows.groupby(group), rows["error"].fillna("").eq("").to_numpy(bool)
    of_driven = rows[driven].groupby(group[driven])
    alone = pd.Series(True, index=parts.size().index)
    for name in parameters:
        alone &= parts[name].nunique(dropna=False) == 1
    told = [name for name in rows.columns if name in METRICS]
    differ = pd.Series(False, index=alone.index)
    for name in told:
        differ |= (of_driven[name].nunique(dropna=False) > 1).reindex(differ.index, fill_value=False)
    repetitions = alone & differ & (parts["seed"].nunique() > 1)
    which: NDArray[np.bool_] = repetitions.to_numpy(bool)[group] if len(rows) else np.zeros(0, bool)
    return which


def meanings(of: Mapping[str, str]) -> dict[str, str]:
    """Return what the columns of such a table mean, given what those of the rows do."""
    spread = {f"{name}_{figure}": f"{what}: {of[figure]}" for figure in of for name, what in SPREAD.items()}
    censored = {
        f"{MEDIAN_OF_ALL}_{figure}": f"{MEDIAN_OF_ALL_MEANS}: {of[figure]}" for figure in BEYOND if figure in of
    }
    counts = {f"{figure}_{ending}": f"{what}: {figure}" for figure in of for ending, what in NUMBERS_OF.items()}
    return {**of, **COUNTS, **spread, **censored, **counts}


def _counts(rows: pd.DataFrame, group: NDArray[np.int64], sure: NDArray[np.bool_]) -> dict[str, Any]:
    passed = rows["passed"].to_numpy(np.float64, na_value=np.nan)
    groups = len(sure)

    def count(which: NDArray[np.bool_]) -> NDArray[np.int64]:
        return np.bincount(group[which], minlength=groups)

    judged, good = count(np.isfinite(passed)), count(passed == 1.0)
    share = np.divide(good, judged, out=np.full(groups, np.nan), where=judged > 0)
    counts = (
        count(np.ones(len(rows), bool)),
        count(rows["error"].fillna("").to_numpy() != ""),
        count(rows["collision"].eq(True).fillna(False).to_numpy(bool)),
        count(rows["outcome"].eq("fault").fillna(False).to_numpy(bool)),
    )
    return dict(zip(COUNTS, (*counts, judged, good, share, *_intervals(good, judged, sure)), strict=True))


def _intervals(good: NDArray[np.int64], judged: NDArray[np.int64], sure: NDArray[np.bool_]) -> Floats:
    """Return lower and upper ends of Wilson's intervals (2 x n); NaN of groups that are no repetitions."""
    found = [
        wilson(*pair) if known else (np.nan, np.nan)
        for *pair, known in zip(good.tolist(), judged.tolist(), sure.tolist(), strict=True)
    ]
    return np.array(found, np.float64).reshape(-1, 2).T


def _spread(name: str, rows: pd.DataFrame, group: NDArray[np.int64], sure: NDArray[np.bool_]) -> dict[str, Any]:
    import pandas as pd

    hit = contacts(rows, name)
    groups = pd.Series(without_contacts(rows, name)).groupby(group)
    hits, size = pd.Series(hit).groupby(group).sum(), groups.size()
    count, mean, least, greatest = groups.count(), groups.mean(), groups.min(), groups.max()
    reach = np.array([student(int(number) - 1) for number in count]) if len(count) else np.zeros(0)
    quantiles = groups.quantile(np.array(list(QUANTILES.values()))).unstack()
    worse = METRICS[name].worse if name in METRICS else None
    worst = {"lower": least, "higher": greatest, None: pd.Series(np.nan, index=mean.index)}[worse]
    worst = worst.where(hits == 0, at_contact(name)) if hit.any() else worst
    half = (groups.sem() * reach).where(sure)
    spread = (mean, half, worst, least, *(quantiles[q] for q in QUANTILES.values()), greatest)
    columns = {f"{which}_{name}": each for which, each in zip(SPREAD, spread, strict=True)}
    if name in BEYOND and "collision" in rows:
        # The order alone decides a median: what is known to lie beyond need not be known itself.
        middle = pd.Series(with_contacts(rows, name)).groupby(group).median()
        columns[f"{MEDIAN_OF_ALL}_{name}"] = middle.where(np.isfinite(middle))
    numbers = (count, hits, size - count - hits, count / size)
    return columns | {f"{name}_{ending}": each for ending, each in zip(NUMBERS_OF, numbers, strict=True)}
