"""Chooses the next points of a unit cube to evaluate, to minimize a cost in few evaluations.

Knows shares from 0 to 1 and costs; neither their meaning nor how a cost is found. Optuna's tree-structured
Parzen estimator chooses (`benchmarks/worst_case.py` says why); what it chooses depends on the costs alone.
"""

from __future__ import annotations

import importlib.util
import itertools
import math
import warnings
from collections.abc import Generator, Sequence

from vve_sumo.errors import ConfigError

#: digits of a share; rounding makes a search independent of the processor's last digits
DIGITS = 6

Shares = tuple[float, ...]


def require_optuna() -> None:
    """Raise ConfigError where Optuna is not installed."""
    if importlib.util.find_spec("optuna") is None:
        raise ConfigError("search: the search for the worst case needs Optuna: pip install 'vve-sumo[search]'")


def search(dimensions: int, points: int, batch: int, seed: int) -> Generator[list[Shares], Sequence[float], None]:
    """Yield batches of points and receive their costs; infinity or NaN means that there is no cost.

    The corners come first, if one batch holds them all.
    Raises ConfigError where Optuna is not installed.
    """
    require_optuna()
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)
    study = optuna.create_study(sampler=sampler)
    # The worst case is often in a corner, where points are rarely drawn.
    if 2**dimensions <= batch:
        for corner in itertools.product((0.0, 1.0), repeat=dimensions):
            study.enqueue_trial({str(axis): share for axis, share in enumerate(corner)})
    for first in range(0, points, batch):
        trials = [study.ask() for _ in range(min(batch, points - first))]
        suggested = [tuple(trial.suggest_float(str(axis), 0.0, 1.0) for axis in range(dimensions)) for trial in trials]
        costs = yield [tuple(round(share, DIGITS) for share in shares) for shares in suggested]
        for trial, cost in zip(trials, costs, strict=True):
            if math.isfinite(cost):
                study.tell(trial, cost)
            else:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
