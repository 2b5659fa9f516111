"""Fixes for every test that needs one; a test changes with `replace` what it is about."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Final

from hypothesis import strategies as st

from vve_sumo.values import Fix, FixQuality

#: of a car that stands level, heading east; a car may drive on it
GOOD: Final = Fix(
    time=0.0,
    time_received=0.0,
    latitude=0.0,
    longitude=0.0,
    altitude=250.0,
    heading=0.0,
    pitch=0.0,
    roll=0.0,
    velocity_north=0.0,
    velocity_east=0.0,
    velocity_down=0.0,
    yaw_rate=0.0,
    acceleration=0.0,
    locked=True,
    quality=FixQuality.RTK_FIXED,
    position_sigma=0.012,
    velocity_sigma=0.02,
    heading_sigma=0.002,
    differential_age=1.0,
)

#: what a receiver may say of its accuracies, for hypothesis
ACCURACIES: Final = {
    "position_sigma": st.floats(0, 60),
    "velocity_sigma": st.floats(0, 60),
    "heading_sigma": st.floats(0, 0.6),
    "differential_age": st.floats(0, 300),
    "quality": st.sampled_from(FixQuality),
}


def elsewhere() -> Fix:
    """What a receiver could say now, of a place far away."""
    now = time.time() - 315_964_800.0 + 18.0
    return replace(GOOD, time=now, latitude=0.7, longitude=-1.4, velocity_east=9.0)
