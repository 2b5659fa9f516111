"""The reward of an agent: how far it drives, and at the end how well the drive meets its scenario's criteria.

Knows summaries and criteria; neither gymnasium nor how a drive is run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from vve_sumo.metrics.table import METRICS
from vve_sumo.scenario.schema import Criteria, CriterionBand

#: reward of a drive's end that meets every criterion
MET_ALL: Final = 10.0
#: what a contact costs beside its impact's speed: more than the last seconds of way before it gain
CONTACT: Final = 5.0


def reward_of_progress(distance: float, desired_speed: float) -> float:
    """Return the reward of a distance along the path [m]: the time that it takes at the desired speed [s]."""
    return distance / desired_speed


def reward_of_end(criteria: Criteria, figures: Mapping[str, Any]) -> float:
    """Return the reward of a drive's end by its figures: half of MET_ALL where it passed, half by the scores.

    The scores of the scenario's criteria are multiplied: a car that never sets out meets most of them. A criterion that
    is met scores 1. A number outside its band scores less the farther out it is: 1 / (1 + distance from the band / the
    band's bound there, but at least 1). What is not met otherwise scores 0. The end of a drive that touched something
    costs CONTACT and the speed of the impact [m/s] where that is known, whatever the criteria say.
    """
    if figures.get("collision"):
        impact = float(figures.get("impact_speed_mps") or 0.0)
        return -CONTACT - (impact if math.isfinite(impact) else 0.0)
    known = {name: figures.get(name) for name, wanted in criteria if wanted is not None}
    if not known:
        return 0.0
    scores = [_score(getattr(criteria, name), name, value) for name, value in known.items()]
    return 0.5 * MET_ALL * (bool(figures.get("passed")) + math.prod(scores))


def _score(wanted: object, name: str, value: object) -> float:
    if not isinstance(wanted, CriterionBand):
        return float(value == wanted)
    number = METRICS[name].absent if value is None else value
    if not isinstance(number, (int, float)) or math.isnan(number):
        return 0.0
    for bound, beyond in ((wanted.min, -1.0), (wanted.max, 1.0)):
        if bound is not None and (excess := beyond * (number - bound)) > 0.0:
            return 1.0 / (1.0 + excess / max(abs(bound), 1.0))
    return 1.0
