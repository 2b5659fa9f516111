"""What the fence and the way to rest cost a tick, over the whole of the paper's drive in the shipped lot.

python benchmarks/lot.py [--rounds N] [--smoke]
Median, 95th percentile and worst in microseconds of this machine; "near an edge" is without the open ground's shortcut.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))


def measured(name: str, calls: list[Callable[[], object]], rounds: int) -> None:
    """Time every call and print how long one takes."""
    taken = []
    for _ in range(rounds):
        for call in calls:
            begun = time.perf_counter()
            call()
            taken.append(1e6 * (time.perf_counter() - begun))
    high = statistics.quantiles(taken, n=20)[-1]
    print(f"{name:28} {statistics.median(taken):7.0f} {high:7.0f} {max(taken):7.0f}")


def main() -> None:
    """Lay the paper's path into the shipped lot and time each of its metres."""
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.drive.virtual_road import pose_at_rest
    from vve_sumo.frames import Alignment
    from vve_sumo.lot.fallback import fallback_path
    from vve_sumo.lot.geofence import DrivenPlace
    from vve_sumo.rig.load import load
    from vve_sumo.rig.resolve import frame_of, geofence_of
    from vve_sumo.scenario.load import load as load_scenario

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--smoke", action="store_true", help="few metres and once, only to see that it runs")
    asked = parser.parse_args()
    rounds, every = (1, 20) if asked.smoke else (asked.rounds, 1)
    file = REPOSITORY / "scenarios" / "parked_car.toml"
    resolved = resolve_scenario("parked_car", load_scenario(file), file, REPOSITORY)
    rig = load(REPOSITORY / "rigs" / "simulated.toml")
    start, begin, path = rig.car_start, resolved.path.at(0.0), resolved.path
    assert start is not None
    place = frame_of(rig).to_map(math.radians(start.latitude_deg), math.radians(start.longitude_deg))
    lot_pose = pose_at_rest(*place, math.radians(90.0 - start.heading_deg))
    alignment = Alignment.from_matched_start(lot_pose, pose_at_rest(begin.x, begin.y, begin.heading))
    geofence, vehicle = geofence_of(rig, alignment), resolved.vehicle
    drive = geofence.driven(path, resolved.scenario.ego.speed_mps)[::every]
    to_lot = alignment.inverse()

    def near_an_edge(at: DrivenPlace) -> bool:
        shapes = geofence.sweep(to_lot.apply(at.pose), at.steering, at.fallback_path)
        return shapes is not None and geofence.lot.holds(shapes)

    print(f"{'':28} {'median':>7} {'p95':>7} {'worst':>7}  us")
    measured("check", [lambda p=p: geofence.check(p.pose, p.steering, p.fallback_path) for p in drive], rounds)
    measured("check, near an edge", [lambda p=p: near_an_edge(p) for p in drive], rounds)
    ways = [lambda p=p: fallback_path(p.pose, p.steering, path, p.s, vehicle) for p in drive]
    measured("way to rest", ways, rounds)
    begun = time.perf_counter()
    geofence.along(path, resolved.scenario.ego.speed_mps)
    print(f"the whole path: {1e3 * (time.perf_counter() - begun):.0f} ms")


if __name__ == "__main__":
    main()
