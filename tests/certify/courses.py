"""Drives in closed form: a car that brakes evenly from a known speed at a known time, straight on or on a circle."""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.certify.cases import CASES
from vve_sumo.certify.link import Answer
from vve_sumo.certify.results import CaseDrive

TICK, SPEED, BRAKING, ONSET = 0.02, 10.0, 2.0, 8.0
CASE = {case.name: case for case in CASES}


def course(
    onset: float = ONSET, silent: float = math.inf, gap: float = 5.0, braking: float = BRAKING, curvature: float = 0.0
) -> CaseDrive:
    """A car at SPEED that brakes from `onset` on to rest, by a brain that says nothing from `silent` on.

    It drives a circle of a `curvature` [1/m], left positive.
    """
    time = TICK * np.arange(round((onset + SPEED / braking + 3.0) / TICK))
    speed = np.clip(SPEED - braking * (time - onset), 0.0, SPEED)
    answers = [
        Answer(t, n, n, 0.0, -braking if t >= onset - 1e-9 else 0.0)
        for n, t in enumerate(time.tolist())
        if t < silent - 1e-9
    ]
    left = np.cumsum(speed[::-1])[::-1] * TICK + gap
    driven = np.concatenate([[0.0], np.cumsum(speed[:-1]) * TICK])
    heading = curvature * driven
    x = np.sin(heading) / curvature if curvature else driven
    y = (1.0 - np.cos(heading)) / curvature if curvature else 0.0 * driven
    return CaseDrive(
        time, speed, left, answers, "stopped", (), False, math.nan, gap, x, y, heading, np.zeros(len(time))
    )  # fmt: skip
