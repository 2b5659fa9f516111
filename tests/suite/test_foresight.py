"""How long a radar must watch who comes in sight, against straight lines fitted to noise."""

from __future__ import annotations

import numpy as np
import pytest

from vve_sumo.sensors.radar import RadarConfig
from vve_sumo.suite.physics import foresight


@pytest.mark.parametrize(("distance", "speed", "within"), [(60.0, 10.0, 1.0), (80.0, 15.0, 0.9), (40.0, 4.0, 0.5)])
def test_after_so_long_a_fitted_line_tells_the_place_at_the_arrival(distance, speed, within):
    radar, long = RadarConfig(), foresight(distance, speed, within)
    times = np.arange(0.0, long, radar.period)
    noise = np.random.default_rng(3).normal(0.0, radar.azimuth_sigma * distance, (times.size, 4000))
    rates = np.polyfit(times, noise, 1)[0]
    assert np.std(rates) * distance / speed == pytest.approx(within, rel=0.1)


def test_nearer_it_is_told_sooner():
    assert foresight(10.0, 10.0, 0.9) < foresight(20.0, 10.0, 0.9) < foresight(20.0, 5.0, 0.9)
