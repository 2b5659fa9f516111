"""Draws false alarms: noise that passes the radar's detection threshold, anywhere in its field of view.

Must not know actors, cycles, or the antenna's pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from vve_sumo.sensors.visibility import Sector

#: False alarms have range rates up to this, either way [m/s]: the span of the ESR's track messages (opendbc ESR.dbc).
RANGE_RATE_SPAN = 81.92


class FalseAlarm(NamedTuple):
    """A detection without a target."""

    range: float  #: from the antenna [m]
    azimuth: float  #: from the boresight [rad], left positive
    range_rate: float  #: [m/s], opening positive
    mode: int  #: index of the first sector that covers the point


def false_alarms(source: np.random.Generator, rate: float, sectors: Sequence[Sector]) -> Iterator[FalseAlarm]:
    """Draw one scan's false alarms: Poisson, `rate` of them on average.

    Noise is as strong in one cell as in the next, so range, azimuth and range rate are uniform over what a sector
    spans, and every sector has its equal share.
    """
    for _ in range(int(source.poisson(rate))):
        drawn, share, side, pace = source.random(4).tolist()
        sector = sectors[int(drawn * len(sectors))]
        range_, azimuth = share * sector.range_max, (2.0 * side - 1.0) * math.atan(sector.slope_max)
        mode = next(i for i, other in enumerate(sectors) if _covers(other, range_, azimuth))
        yield FalseAlarm(range_, azimuth, (2.0 * pace - 1.0) * RANGE_RATE_SPAN, mode)


def _covers(sector: Sector, range_: float, azimuth: float) -> bool:
    return range_ <= sector.range_max and abs(azimuth) <= math.atan(sector.slope_max)
