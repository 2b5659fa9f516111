"""The rate of change of a signal that was sampled every tick.

Knows arrays alone.
"""

from __future__ import annotations

import numpy as np

from vve_sumo.values import Floats

#: a rate of change is the slope of the straight line that fits best from this long before to this long after [s]
SLOPE_REACH = 0.1


def slope(time: Floats, values: Floats, period: float) -> Floats:
    """Return the rate of change of values [1/s]: slope of the least-squares line over SLOPE_REACH to either side.

    The window is counted in ticks of `period` [s], the slope is of the times as they are. Exact of a parabola on even
    times. NaN where the window reaches beyond the ends or holds a NaN.
    """
    reach = max(1, round(SLOPE_REACH / period))
    answer = np.full(len(values), np.nan)
    if len(values) > 2 * reach:
        times = np.lib.stride_tricks.sliding_window_view(time, 2 * reach + 1)
        windows = np.lib.stride_tricks.sliding_window_view(values, 2 * reach + 1)
        lever = times - times.mean(axis=1, keepdims=True)
        answer[reach:-reach] = (lever * windows).sum(axis=1) / (lever * lever).sum(axis=1)
    return answer
