"""A SUMO car behind an external ego: how hard does it brake for what the ego is reported to do?"""

from __future__ import annotations

import os
import random
import tempfile
from pathlib import Path

from vve_sumo.pose.predict import Predictor
from vve_sumo.values import Point, Pose

STEP = 0.02
LATENCY = 0.02
ROAD = """<net version="1.20">
<location netOffset="0,0" convBoundary="0,0,2000,0" origBoundary="0,0,2000,0" projParameter="!"/>
<edge id="road" from="a" to="b" priority="1">
<lane id="road_0" index="0" speed="40" length="2000" shape="0,0 2000,0"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>
<junction id="b" type="dead_end" x="2000" y="0" incLanes="road_0" intLanes="" shape="2000,0"/>
</net>"""


def _pose(time: float, position: float, speed: float) -> Pose:
    return Pose(time, Point.REAR_AXLE, position, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0)


def hardest_braking(position_noise: float, speed_noise: float, filtered: bool, seconds: float = 60.0) -> float:
    """Most negative acceleration [m/s2] of a Krauss follower in equilibrium behind an ego at 15 m/s.

    The ego's fixes come at 50 Hz, 20 ms old, with white noise [m], [m/s]; it is placed ahead by the predictor or, not
    filtered, by carrying the newest fix along at its own speed. The first 10 s do not count.
    """
    os.environ["LIBSUMO_AS_TRACI"] = "quiet"
    import libsumo

    chance = random.Random(3)
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "road.net.xml"
        net.write_text(ROAD)
        options = ("--step-length", str(STEP), "--no-step-log", "true", "--time-to-teleport", "-1", "--seed", "1")
        libsumo.start(["sumo", "-n", str(net), *options])
    libsumo.route.add("r", ["road"])
    libsumo.vehicletype.copy("DEFAULT_VEHTYPE", "car")
    libsumo.vehicletype.setImperfection("car", 0.0)
    speed, start = 15.0, 200.0
    libsumo.vehicle.add("ego", "r", "car", depart="now", departPos=str(start), departSpeed=str(speed))
    gap = 2.5 + speed + 5.0  # minimum gap, one second, the ego's length
    libsumo.vehicle.add("follower", "r", "car", depart="now", departPos=str(start - gap), departSpeed=str(speed))
    libsumo.vehicle.setSpeedMode("ego", 32)
    libsumo.vehicle.setLaneChangeMode("ego", 0)
    predictor, hardest = Predictor(), 0.0
    for tick in range(round(seconds / STEP)):
        made = tick * STEP - LATENCY
        truth = start + speed * made
        fix = _pose(made, truth + chance.gauss(0.0, position_noise), speed + chance.gauss(0.0, speed_noise))
        predictor.update(fix)
        placed = predictor.at((tick + 1) * STEP) if filtered else _pose(0.0, fix.x + fix.speed * 2 * STEP, fix.speed)
        assert placed is not None
        libsumo.vehicle.moveToXY("ego", "", -1, placed.x, 0.0, 90.0, 2, 20)
        libsumo.vehicle.setSpeed("ego", placed.speed)
        libsumo.simulationStep()
        if tick * STEP > 10.0:
            hardest = min(hardest, libsumo.vehicle.getAcceleration("follower"))
    libsumo.simulationStep()
    libsumo.close()
    return hardest


def three_followers() -> tuple[float, float, float]:
    """Behind an ego without noise, with noise and the predictor, with noise and without it."""
    return hardest_braking(0.0, 0.0, True), hardest_braking(0.02, 0.03, True), hardest_braking(0.02, 0.03, False)
