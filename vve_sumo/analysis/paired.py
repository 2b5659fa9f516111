"""Two sweeps, or two controllers of one, compared run by run: pairs that have parameters and seed in common.

Knows rows as tables; it must not know which of the two is the better one, nor draw conclusions beyond these pairs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.resampling import bootstrap_median, sign_test
from vve_sumo.analysis.survivors import ordered, without_contacts
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError, hint
from vve_sumo.metrics.table import METRICS, NUMBERS, OWN_METRICS, label_of, meaning_of
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: what runs are paired by besides parameters
SEED: Final = "seed"

FIGURES: Final = {
    "pairs": "pairs of which both runs have the figure, of a gap, a time to collision or a DRAC without a contact",
    "only_one": "pairs of which the run of the one alone has it so",
    "only_other": "pairs of which the run of the other alone has it so",
    "median_one": "median of the one over those pairs",
    "median_other": "median of the other over those pairs",
    "median_difference": "median of the differences, other minus one; another number than the medians' difference",
    "low_difference": "lower end of the bootstrap's 95 % interval of that median; none for fewer than two pairs",
    "high_difference": "its upper end",
    "least_difference": "least difference",
    "greatest_difference": "greatest difference",
    "lower": "pairs in which the other has less; a contact is less than every gap and time, more than every DRAC, and "
    "a drive without a conflict the other way round",
    "same": "pairs in which both have the same, or a contact, or no conflict",
    "higher": "pairs in which the other has more",
    "sign_test_p": "two-sided probability of so many more on one side by chance (sign test, exact)",
    "worse": "which way the figure is worse: lower, higher, or neither",
}
VERDICTS: Final = {
    "both": "pairs of which it is true of both runs",
    "only_one": "pairs of which it is true of the run of the one alone",
    "only_other": "pairs of which it is true of the run of the other alone",
    "neither": "pairs of which it is true of neither run",
    "mcnemar_p": "two-sided probability of only_one and only_other lying so far apart by chance (McNemar, exact)",
}
#: values of a parameter that are compared each with each other, at most
MAX_VALUES: Final = 6


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """Runs of two sweeps or controllers, side by side."""

    one: str  #: what the one is called
    other: str
    by: tuple[str, ...]  #: columns that a pair has in common, the seed among them
    pairs: pd.DataFrame  #: a row a pair: `by`, then one_… and other_… of every figure and verdict
    figures: pd.DataFrame  #: a row a figure, with the columns of FIGURES
    verdicts: pd.DataFrame  #: a row for `passed`, `collision`, with the columns of VERDICTS: a two-by-two table each
    unpaired: tuple[int, int]  #: runs of the one, and of the other, that have no partner

    def difference(self, figure: str) -> Floats:
        """Return other minus one of every pair (n); NaN where a run lacks the figure."""
        return self.values(figure, "other") - self.values(figure, "one")

    def values(self, figure: str, side: str) -> Floats:
        """Return a figure of every pair (n) on a side, "one" or "other"; NaN where the run lacks it.

        A run with a contact lacks every gap, time to collision and DRAC.
        """
        if f"{side}_{figure}" not in self.pairs:
            raise ConfigError(f"the pairs have no figure {figure!r}; there are {', '.join(self.figures.index)}")
        return without_contacts(_side(self.pairs, side), figure)


def compare_sweeps(one: Sweep, other: Sweep, figures: Sequence[str] | None = None) -> PairedComparison:
    """Return two sweeps compared run by run, paired by seed and by the parameters that both varied.

    `figures` are all numbers that both have if not said. A parameter that one of them alone varied takes no part in
    the pairing, so each combination of the rest and seed must be there once. Raises ConfigError where it is there more
    often, or where there is no pair.
    """
    by = [name for name in one.parameters if name in other.parameters]
    names = [sweep.folder.resolve().name for sweep in (one, other)]
    if names[0] == names[1]:
        names = [str(sweep.folder) for sweep in (one, other)]
    return compare_rows(one.rows(), other.rows(), by, names[0], names[1], figures)


def compare_within(
    sweep: Sweep, column: str, values: Sequence[Any] | None = None, figures: Sequence[str] | None = None
) -> PairedComparison:
    """Return two values of a parameter of one sweep, such as its controllers, compared run by run.

    `values` are the two values, the only two that there are if not said; `compare_each` takes more. Raises ConfigError
    where there are others, and as `compare_sweeps` does.
    """
    rows = sweep.rows()
    if column not in sweep.parameters:
        raise ConfigError(f"{sweep.folder}: {column!r} was not varied; there are {', '.join(sweep.parameters)}")
    there = rows[column].unique().tolist()
    both = there if values is None else list(values)
    if len(both) != 2 or any(value not in there for value in both):
        raise ConfigError(f"{column}: expected two of its values, {', '.join(map(str, there))}, got {both}")
    parts = [rows[rows[column] == value].reset_index(drop=True) for value in both]
    # What one of the two never has, as a key of the other controller's tuning, makes no pairs.
    by = [
        name
        for name in sweep.parameters
        if name != column and all(part[name].notna().any() for part in parts) and _any_common(parts, name)
    ]
    first, second = parts
    return compare_rows(first, second, by, str(both[0]), str(both[1]), figures)


def compare_each(sweep: Sweep, column: str, figures: Sequence[str] | None = None) -> list[PairedComparison]:
    """Return every two values of a parameter of one sweep, such as its controllers, compared as `compare_within` does.

    Each comparison is by itself: of many, some differ by chance alone. Raises ConfigError where the parameter has one
    value, or more than MAX_VALUES, and as `compare_within` does.
    """
    if column not in sweep.parameters:
        raise ConfigError(f"{sweep.folder}: {column!r} was not varied; there are {', '.join(sweep.parameters)}")
    there = sweep.rows([column])[column].unique().tolist()
    if not 2 <= len(there) <= MAX_VALUES:
        raise ConfigError(f"{column}: expected 2 to {MAX_VALUES} values to compare each with each, it has {len(there)}")
    return [compare_within(sweep, column, both, figures) for both in itertools.combinations(there, 2)]


def _any_common(parts: Sequence[pd.DataFrame], name: str) -> bool:
    """Whether any value of a column stands in all of some tables."""
    return bool(set.intersection(*(set(part[name].dropna()) for part in parts)))


def compare_rows(
    one: pd.DataFrame,
    other: pd.DataFrame,
    by: Sequence[str],
    one_name: str = "one",
    other_name: str = "other",
    figures: Sequence[str] | None = None,
) -> PairedComparison:
    """Return the rows of two sweeps compared run by run, paired by the columns `by` and by the seed; see FIGURES."""
    import pandas as pd

    keys = list(dict.fromkeys([*by, SEED]))
    for name, rows in ((one_name, one), (other_name, other)):
        _once(rows, keys, name)
    numbers = [*NUMBERS, *(name for name, row in OWN_METRICS.items() if row.kind == "float")]
    wanted = [name for name in (numbers if figures is None else figures) if name in one and name in other]
    judged = [name for name in one.columns if _is_verdict(name) and name in other]
    kept = list(dict.fromkeys([*wanted, *judged]))  # `collision` among them, where the runs tell
    sides = [
        rows[[*keys, *kept, *_error(rows)]].rename(columns={name: f"{side}_{name}" for name in (*kept, "error")})
        for side, rows in (("one", one), ("other", other))
    ]
    pairs = sides[0].merge(sides[1], on=keys, how="inner", validate="one_to_one")
    if pairs.empty:
        raise ConfigError(f"{one_name} and {other_name} have no pair: no run of both has the same {', '.join(keys)}")
    told = [_figure(pairs, name) for name in wanted]
    table = described(pd.DataFrame(told, pd.Index(wanted, name="figure"), list(FIGURES)), FIGURES)
    verdicts = described(pd.DataFrame([_verdict(pairs, name) for name in judged], judged, list(VERDICTS)), VERDICTS)
    pairs = pairs.drop(columns=[f"{side}_error" for side in ("one", "other")], errors="ignore")
    pairs = described(pairs, _meanings(one, other, keys, kept))
    unpaired = (len(one) - len(pairs), len(other) - len(pairs))
    return PairedComparison(one_name, other_name, tuple(keys), pairs, table, verdicts, unpaired)


def _error(rows: pd.DataFrame) -> list[str]:
    """Return the column that tells a run with an error from one without a conflict, where the rows have it."""
    return [name for name in ("error",) if name in rows]


def _meanings(one: pd.DataFrame, other: pd.DataFrame, keys: Sequence[str], figures: Sequence[str]) -> dict[str, str]:
    """Return what the columns of the pairs mean, by what those of the two tables do."""

    def of(rows: pd.DataFrame, name: str) -> str:
        return rows.attrs.get("meanings", {}).get(name) or meaning_of(name) or label_of(name)

    sides = {"one": one, "other": other}
    own = {f"{side}_{name}": f"{side}: {of(rows, name)}" for side, rows in sides.items() for name in figures}
    return {key: of(one, key) for key in keys} | own


def _once(rows: pd.DataFrame, keys: Sequence[str], name: str) -> None:
    missing = next((key for key in keys if key not in rows), None)
    if missing is not None:
        raise ConfigError(f"{name}: no column {missing!r} to pair by; {hint(missing, map(str, rows.columns))}")
    twice = rows[rows.duplicated(list(keys))]
    if len(twice):
        values = ", ".join(f"{key} = {twice[key].iloc[0]}" for key in keys)
        raise ConfigError(
            f"{name}: several runs have {values}: pick one of each by its other parameters before pairing"
        )


def _is_verdict(name: str) -> bool:
    return name in ("passed", "collision") or name.startswith("meets_")


def _side(pairs: pd.DataFrame, side: str) -> pd.DataFrame:
    """Return the columns of one side of the pairs, under their own names."""
    begin = f"{side}_"
    names = [name for name in map(str, pairs) if name.startswith(begin)]
    return pairs[names].rename(columns={name: name.removeprefix(begin) for name in names})


def _figure(pairs: pd.DataFrame, name: str) -> dict[str, Any]:
    sides = [_side(pairs, side) for side in ("one", "other")]
    one, other = (without_contacts(rows, name) for rows in sides)
    first, second = (ordered(rows, name) for rows in sides)
    has, has_other = np.isfinite(one), np.isfinite(other)
    both = has & has_other
    difference = (other - one)[both]
    spread = (np.median, np.min, np.max)
    medians = [float(np.median(values)) if both.any() else np.nan for values in (one[both], other[both])]
    middle, least, greatest = (float(of(difference)) if both.any() else np.nan for of in spread)
    found = (middle, *bootstrap_median(difference), least, greatest)
    signs = [int((second < first).sum()), int((second == first).sum()), int((second > first).sum())]
    alone = [int((has & ~has_other).sum()), int((has_other & ~has).sum())]
    worse = (METRICS[name].worse if name in METRICS else None) or "neither"
    return dict(
        zip(
            FIGURES,
            (int(both.sum()), *alone, *medians, *found, *signs, sign_test(signs[0], signs[2]), worse),
            strict=True,
        )
    )


def _verdict(pairs: pd.DataFrame, name: str) -> dict[str, float]:
    """Return the two-by-two table of a truth value, of the pairs of which both runs were judged."""
    one, other = (pairs[f"{side}_{name}"].to_numpy(np.float64, na_value=np.nan) for side in ("one", "other"))

    def count(first: float, second: float) -> int:
        which: NDArray[np.bool_] = (one == first) & (other == second)
        return int(which.sum())

    counts = (count(1, 1), count(1, 0), count(0, 1), count(0, 0))
    return dict(zip(VERDICTS, (*counts, sign_test(counts[1], counts[2])), strict=True))
