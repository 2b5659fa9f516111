"""How SUMO's drivers discharge at a signal and pass a disturbance on: what a sweep with traffic may claim.

Two measurements in bare SUMO, with the vehicle types that `vve-sumo network demand` writes:

* saturation headway: mean time between fronts over the stop line, from the fifth vehicle of a standing queue on, as in
  the Highway Capacity Manual (2010, chapter 18: base 1,900 passenger cars an hour and lane, a heavy vehicle as two);
* string behaviour: the leader of eight followers dips by 5 m/s; how deep the last one's dip is against the leader's.

Usage: python benchmarks/strings.py [--smoke]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import statistics
import tempfile
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")

from vve_sumo.network_tools.build import netconvert
from vve_sumo.network_tools.demand import DRIVER, TYPES
from vve_sumo.world.simulation import OPTIONS

STEP = 0.02  #: [s]
GREEN, RED, CYCLES = 40.0, 60.0, 6  #: [s]
SETTLED = 4  #: vehicles of a queue that discharge before its headways count
COUNTED = 10  #: headways of each queue that count
CRUISE, DIP, BRAKING = 20.0, 5.0, 2.0  #: of the string's leader [m/s], [m/s], [m/s2]
FOLLOWERS = 8
#: base saturation flow of the Highway Capacity Manual [passenger cars / h / lane], and what a heavy vehicle counts as
SATURATION_FLOW, HEAVY_AS = 1900.0, 2.0
HEAVY = ("truck", "bus")

NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="800" y="0" type="traffic_light"/>
<node id="c" x="6000" y="0"/><node id="d" x="800" y="-300"/><node id="e" x="800" y="300"/></nodes>"""
EDGES = """<edges><edge id="ab" from="a" to="b" numLanes="{lanes}" speed="{limit}"/>
<edge id="bc" from="b" to="c" numLanes="{lanes}" speed="{limit}"/>
<edge id="db" from="d" to="b" speed="13.9"/><edge id="be" from="b" to="e" speed="13.9"/></edges>"""

STRINGS: dict[str, dict[str, str]] = {
    "our demand's drivers (Krauss, sigma 0.5)": dict(DRIVER),
    "Krauss, sigma 0": {"sigma": "0"},
    "IDM": {"carFollowModel": "IDM"},
    "EIDM": {"carFollowModel": "EIDM"},
    "ACC": {"carFollowModel": "ACC"},
    "CACC": {"carFollowModel": "CACC"},
}


def street(folder: Path, limit: float, lanes: int = 1) -> Path:
    """Build two streets that cross at a signal, one of them with so many lanes a way."""
    (folder / "a.nod.xml").write_text(NODES)
    (folder / "a.edg.xml").write_text(EDGES.format(limit=limit, lanes=lanes))
    files = ["--node-files", str(folder / "a.nod.xml"), "--edge-files", str(folder / "a.edg.xml"), "--no-turnarounds"]
    netconvert(files, folder / "a.nod.xml", folder / "a.net.xml")
    return folder / "a.net.xml"


def start(network: Path, routes: str, seed: int) -> None:
    """Start SUMO as our drives do."""
    import libsumo

    file = network.with_suffix(".rou.xml")
    file.write_text(routes)
    options = [word for option in OPTIONS for word in option]
    files = ["-n", str(network), "-r", str(file), "--no-warnings", "true"]
    libsumo.start(["sumo", *files, "--seed", str(seed), "--step-length", f"{STEP}", *options])


def saturation(tau: float, seed: int, lanes: int = 1, cycles: int = CYCLES) -> float:
    """Return the mean saturation headway of a lane [s] with a driver's headway wish `tau` [s]."""
    import libsumo

    drawn = random.Random(seed)
    shares = [kind.share for kind in TYPES.values()]
    names = drawn.choices(list(TYPES), shares, k=250 * lanes)
    driver = " ".join(f'{key}="{value}"' for key, value in (DRIVER | {"tau": f"{tau}"}).items())
    types = "".join(
        f'<vType id="{name}" accel="{kind.accel}" decel="{kind.decel}" length="{kind.length}" '
        f'vClass="{kind.vehicle_class}" {driver}/>'
        for name, kind in TYPES.items()
    )
    cars = "".join(
        f'<vehicle id="{i}" type="{name}" depart="{i / lanes}" departLane="best" departSpeed="max">'
        '<route edges="ab bc"/></vehicle>'
        for i, name in enumerate(names)
    )
    with tempfile.TemporaryDirectory() as folder:
        start(street(Path(folder), 15.6, lanes), f"<routes>{types}{cars}</routes>", seed)
        (signal,) = libsumo.trafficlight.getIDList()
        links = libsumo.trafficlight.getControlledLinks(signal)
        found: list[float] = []
        for _ in range(cycles):
            for colour, duration in (("r", RED), ("G", GREEN)):
                state = "".join(colour if link[0][0].startswith("ab") else "r" for link in links)
                libsumo.trafficlight.setRedYellowGreenState(signal, state)
                crossed = crossings(duration, lanes)
            for times in crossed:
                settled = times[SETTLED - 1 : SETTLED + COUNTED]
                found += [later - sooner for sooner, later in pairwise(settled)]
        libsumo.close()
    return statistics.fmean(found)


def crossings(duration: float, lanes: int) -> list[list[float]]:
    """Step for `duration` [s] and return, for each lane, when vehicles left the virtual road before the stop line."""
    import libsumo

    times: list[list[float]] = [[] for _ in range(lanes)]
    before: dict[str, int] = {}
    for _ in range(round(duration / STEP)):
        libsumo.simulationStep()
        now = {name: lane for lane in range(lanes) for name in libsumo.lane.getLastStepVehicleIDs(f"ab_{lane}")}
        for name in before.keys() - now.keys():
            times[before[name]].append(libsumo.simulation.getTime())
        before = now
    return times


def amplification(driver: dict[str, str], seed: int) -> float:
    """Return the depth of the last follower's dip over the leader's."""
    import libsumo

    attributes = " ".join(f'{key}="{value}"' for key, value in driver.items() if key != "lcOpposite")
    cars = "".join(
        f'<vehicle id="{i}" type="t" depart="0" departPos="{700 - 30 * i}" departSpeed="{CRUISE}">'
        '<route edges="bc"/></vehicle>'
        for i in range(FOLLOWERS + 1)
    )
    with tempfile.TemporaryDirectory() as folder:
        start(street(Path(folder), 33.0), f'<routes><vType id="t" {attributes}/>{cars}</routes>', seed)
        libsumo.simulationStep()
        libsumo.vehicle.setSpeedMode("0", 0)
        last: list[float] = []
        for tick in range(round(160.0 / STEP)):
            since = max(0.0, tick * STEP - 60.0)
            lost = min(DIP, BRAKING * since) if since < 8.0 else max(0.0, DIP - BRAKING * (since - 8.0))
            libsumo.vehicle.setSpeed("0", CRUISE - lost)
            libsumo.simulationStep()
            if tick * STEP > 50.0:
                last.append(libsumo.vehicle.getSpeed(str(FOLLOWERS)))
        libsumo.close()
    return (statistics.median(last) - min(last)) / DIP


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="one value of each kind, only to see that it runs")
    taus, seeds, cycles, strings = (0.9, 1.0, 1.1, 1.2, 1.3), (1, 2, 3, 4), CYCLES, list(STRINGS)
    if parser.parse_args().smoke:
        taus, seeds, cycles, strings = (1.1,), (1,), 1, strings[:1]
    heavy = sum(TYPES[name].share for name in HEAVY)
    goal = 3600.0 / SATURATION_FLOW * (1.0 + heavy * (HEAVY_AS - 1.0))
    print(f"saturation headway with {100 * heavy:.0f} % heavy vehicles: {goal:.2f} s by the Highway Capacity Manual")
    with multiprocessing.get_context("spawn").Pool(2, maxtasksperchild=1) as pool:
        for tau in taus:
            values = pool.starmap(saturation, [(tau, seed, 1, cycles) for seed in seeds], chunksize=1)
            print(f"  tau {tau:.1f} s: {statistics.fmean(values):.3f} s ({min(values):.3f} to {max(values):.3f})")
        values = pool.starmap(saturation, [(1.1, seed, 2, cycles) for seed in seeds], chunksize=1)
        print(f"  tau 1.1 s, two lanes: {statistics.fmean(values):.3f} s ({min(values):.3f} to {max(values):.3f})")
        print(f"a dip of {DIP:g} m/s behind {FOLLOWERS} followers at {CRUISE:g} m/s, the last one's over the leader's")
        for name in strings:
            values = pool.starmap(amplification, [(STRINGS[name], seed) for seed in seeds[:3]], chunksize=1)
            print(f"  {name}: {statistics.fmean(values):.2f} ({min(values):.2f} to {max(values):.2f})")


if __name__ == "__main__":
    main()
