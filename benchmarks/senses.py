"""What lidar, camera and V2X receiver cost among fifty bodies, beside the radar: before the command, and in the slack.

python benchmarks/senses.py [--seconds N] [--smoke]
They take turns at every tick, so that a noisy machine disturbs all of them alike. Times are of this process' CPU.
The slack holds the sensor's work, its rows for the record, and their way to a live drive's recorder.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.live.channel import pair
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import configured
from vve_sumo.timing import PERIOD

BODIES = 50
SPEED = 10.0  #: of the ego [m/s]
#: readings a second; that of the V2X receiver has the messages of a tick, fifty a second in all
RATES = {"radar": 20.0, "lidar": 10.0, "camera": 15.0, "v2x": 50.0, "warned": 50.0, "some": 50.0, "all": 50.0}
#: receivers that hear more: of warnings, and of what three in ten, or all, perceive
RECEIVERS = {"v2x": {}, "warned": {"warnings": True}, "some": {"perceiving": 0.3}, "all": {"perceiving": 1.0}}


def main() -> None:
    """Print what a tick's step costs, and what a reading costs in all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of driving [s]")
    parser.add_argument("--smoke", action="store_true", help="a tiny amount of work, whose figures say nothing")
    arguments = parser.parse_args()
    ticks = round((1.0 if arguments.smoke else arguments.seconds) / PERIOD)
    chance = np.random.default_rng(1)
    street = [
        car(
            chance.uniform(-80, 120),
            chance.choice((-1, 1)) * chance.uniform(2.5, 30),
            chance.uniform(-math.pi, math.pi),
            8.0,
        )
        for _ in range(BODIES)
    ]
    sensors = {}
    for name in RATES:
        settings = configured("v2x" if name in RECEIVERS else name, RECEIVERS.get(name, {}))
        sensors[name] = GuardedSensor(name, settings, FUSION, np.random.default_rng(2))
    before: dict[str, list[float]] = {kind: [] for kind in RATES}
    after: dict[str, list[float]] = {kind: [] for kind in RATES}
    sent: dict[str, list[float]] = {kind: [] for kind in RATES}
    ours, theirs = pair()
    recorder = RecorderClient(ours)
    scene = actors(street)
    for tick in range(ticks):
        now = tick * PERIOD
        pose = rear_axle(SPEED * (now % 4.0), 0.0, 0.0, SPEED)
        for kind, sensor in sensors.items():
            begun = time.process_time()
            columns = sensor.step(now, pose, scene)
            stepped = time.process_time()
            if columns is not None:
                recorder.sensed(tick, kind, sensor.output.time, columns)
                recorder.flush()
            flushed = time.process_time()
            sensor.prepare()
            before[kind].append(stepped - begun)
            sent[kind].append(flushed - stepped)
            after[kind].append(time.process_time() - stepped)
            while theirs.receive():
                recorder.flush()
    if recorder.failure:
        raise SystemExit(f"the recorder's channel: {recorder.failure}")
    seconds = ticks * PERIOD
    print(f"{BODIES} bodies, {seconds:.0f} s")
    for kind, rate in RATES.items():
        step = 1000.0 * statistics.mean(before[kind])
        reading = 1000.0 * (sum(before[kind]) + sum(after[kind])) / (rate * seconds)
        record = 1000.0 * sum(sent[kind]) / (rate * seconds)
        slack = 1000.0 * max(after[kind])
        print(
            f"  {kind:8} a step {step:.3f} ms, a reading {reading:.2f} ms in all, of it {record:.2f} ms "
            f"to the recorder, most in one slack {slack:.1f} ms"
        )


if __name__ == "__main__":
    main()
