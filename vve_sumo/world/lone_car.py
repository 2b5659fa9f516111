"""Drives a SUMO car alone along edges of a network, and returns the track of its front bumper."""

from __future__ import annotations

from pathlib import Path

import libsumo
import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.values import Floats

PERIOD = 0.1  #: between two samples of the track [s]
SPEED = 5.0  #: of the car [m/s]; half a metre a sample
MAX_DURATION = 7200.0  #: simulated time after which a car that has not arrived is given up [s]
LANE_CHANGE = 4.0  #: duration of a lane change [s]; SUMO's default is one step


def front_track(network: Path, edges: tuple[str, ...], start: float, stop: float) -> Floats:
    """Return the track of a car from `start` on the first edge to `stop` on the last [m], shape (n, 2), map [m].

    Starts libsumo in this process. Raises ConfigError where the car does not arrive.
    """
    options = ["--step-length", str(PERIOD), "--lanechange.duration", str(LANE_CHANGE), "--no-step-log", "true"]
    libsumo.start(["sumo", "-n", str(network), "--no-warnings", "true", *options])
    track: list[tuple[float, float]] = []
    try:
        libsumo.route.add("way", edges)
        libsumo.vehicle.add("surveyor", "way", departPos=str(start), arrivalPos=str(stop), departLane="best")
        libsumo.vehicle.setMaxSpeed("surveyor", SPEED)
        while libsumo.simulation.getMinExpectedNumber():
            libsumo.simulationStep()
            if "surveyor" in libsumo.vehicle.getIDList():
                track.append(libsumo.vehicle.getPosition("surveyor"))
            if libsumo.simulation.getTime() > MAX_DURATION:
                raise ConfigError(f"{network}: the recording car did not reach {edges[-1]!r} in {MAX_DURATION:.0f} s")
    finally:
        libsumo.close()
    return np.array(track).reshape(-1, 2)
