"""Metrics that a contact is the end of: on which side of every other value a run with a contact lies.

The nearer two bodies come, the smaller gap and time to collision are, and the harder the braking that still avoids a
contact. A contact is beyond all of that, whatever was measured afterwards: the car that drives through an obstacle has
no gap to it at rest, and the gap to what stands behind it is another one. Knows names of metrics and truth values.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.metrics.per_drive import PER_DRIVE

#: infinity with the side on which a contact lies, by metric; any other metric means the same after a contact as before
BEYOND: Final[dict[str, float]] = {
    "stop_gap_m": -math.inf,
    "min_gap_m": -math.inf,
    "min_ttc_s": -math.inf,
    "strip_min_gap_m": -math.inf,
    "strip_min_ttc_s": -math.inf,
    "max_drac_mps2": math.inf,
    "strip_max_drac_mps2": math.inf,
}


def at_contact(metric: str) -> float:
    """Return the value of a metric of BEYOND in the instant of a contact: no gap, no time, a deceleration's cap."""
    return 0.0 if BEYOND[metric] < 0.0 else PER_DRIVE[metric].cap
