"""What steering around brings: drives with the elastic band and the sampling planner, and tables of them.

`passes`: the parked car of `parked_car_passed` with up to three cars that come the other way and give way to nobody;
place of the parked car, speeds and seeds are drawn. `faults`: the same without them, in SUMO's traffic, and at a random
moment the setpoints end, or the controller raises. `library`: the pedestrians and bicyclists of the scenario library at
10 to 60 km/h, braking alone, steering alone, both. `late`: a runner who sets out when the car is 1.0 to 2.2 s away,
with what physics allows beside it. `picture`: that of docs/steering_avoidance.md.

Usage: python -m benchmarks.steering_avoidance passes|faults|library|late|picture [--runs N] [--first SEED]
[--planner NAME] [--gap M] [--smoke]
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

REPOSITORY = Path(__file__).parent.parent
PLANNERS = ("elastic_band", "frenet_sampling")
KMH: Final = 1.0 / 3.6
PICTURE: Final = REPOSITORY / "docs" / "steering_avoidance.png"
WORKERS: Final = 2
#: the drives past the parked car begin where the path has turned into its street
ROLLS: Final = {"ego.initial_speed_mps": 4.0, "ego.initial_s_m": 556.0}
PRELOADED: Final = [
    "scipy.optimize", "vve_sumo.drive.lockstep", "vve_sumo.record.writer", "vve_sumo.drive.resolved_scenario",
]  # fmt: skip
#: what the controller may do: its tuning
MEANS: Final[dict[str, dict[str, Any]]] = {
    "braking": {},
    "steering": {"left_m": 3.4, "right_m": 2.0, "emergency": False, "comfort": False},
    "both": {"left_m": 3.4, "right_m": 2.0},
}
LIBRARY: Final = (
    "bicyclist_230_overtaking", "bicyclist_310_midblock", "occluded_pedestrian", "pedestrian_400_walking_along",
    "pedestrian_740_dash", "pedestrian_750_crossing", "pedestrian_910_expressway",
)  # fmt: skip
SPEEDS: Final = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)  #: [km/h]
ROAD_AFTER: Final = 40.0  #: of road beyond the one who is met, within which the car is back on its path [m]
LATE: Final = (1.0, 1.3, 1.6, 1.9, 2.2)  #: how far away the car is when the runner sets out [s]
RUNS: Final = 3.0  #: speed of the runner [m/s]
RUNNER: Final = 0.5, 0.6  #: length and width of the runner [m]
#: until a sensor knows of one who sets out, and how fast: three turns of the lidar and half of another one [s]
KNOWN_AFTER: Final = 0.35
LATERAL, LATERAL_JERK = 3.0, 5.0  #: of the gateway [m/s2], [m/s3]


class Case(NamedTuple):
    """A drive: a scenario of the library with values in place of its own."""

    scenario: str
    changes: dict[str, Any]
    seed: int = 1
    fault: str = ""  #: "silent" or "raises"; empty for none
    fault_at: float = math.inf  #: drive time of the fault [s]
    until: float = 60.0  #: the drive ends then at the latest [s]


class Instant(NamedTuple):
    """What is known of a moment of a drive, for the picture."""

    time: float  #: [s]
    s: float  #: of the rear axle [m]
    d: float  #: [m]
    speed: float  #: [m/s]
    clearance: float  #: [m]
    others: tuple[tuple[float, float], ...]  #: s and d of the bodies [m]


class Outcome(NamedTuple):
    """What came of a drive."""

    contact: bool
    clearance: float  #: least distance between the bodies of the car and of whoever the scenario has [m]
    beside: float  #: the same while the car was faster than 0.5 m/s and beside somebody [m]
    aside: float  #: the car's greatest distance from its path [m]
    last: float  #: its distance from its path at the end [m]
    s: float  #: at the end [m]
    slowest: float  #: least speed [m/s]
    speed: float  #: at the end [m/s]
    state: str  #: of the gateway at the end
    time: float  #: [s]
    impact: float  #: speed at the first contact [m/s]
    reasons: str
    track: tuple[Instant, ...] = ()


def resolved(case: Case) -> Any:
    """Return the resolved scenario of a case."""
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse

    file = REPOSITORY / "scenarios" / f"{case.scenario}.toml"
    table: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8")) | {"seed": case.seed}
    for key in ("parameters", "criteria"):
        table.pop(key, None)
    for key, value in case.changes.items():
        *parents, last = key.split(".")
        inner: Any = table
        for parent in parents:
            inner = inner[int(parent)] if isinstance(inner, list) else inner.setdefault(parent, {})
        inner[last] = value
    return resolve_scenario(case.scenario, parse(table, file), file, REPOSITORY)


def drive(case: Case) -> Outcome:
    """Drive a case; in a process of its own."""
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
    from vve_sumo.geometry import Boxes, distance, vehicle_boxes
    from vve_sumo.record.writer import MemoryRecorder
    from vve_sumo.values import EGO

    scenario = resolved(case)
    shell, vehicle = Lockstep(scenario, REPOSITORY), scenario.vehicle
    ego = shell.egos[0]
    fault = _Fault(case, ego) if case.fault else None
    record = MemoryRecorder(scenario.to_dict(REPOSITORY), DEFAULT_EPOCH)
    least, beside, aside, slowest, impact, rested = math.inf, math.inf, 0.0, math.inf, 0.0, 0.0
    place, nearest = None, math.inf
    track: list[Instant] = []
    end = scenario.scenario.end_trigger.ego_at_m or math.inf
    for number, ticks in enumerate(shell.ticks(record)):
        now, tick = number * 0.02, ticks[EGO]
        truth, actors = tick.truth, tick.actors
        if fault is not None:
            fault.step(now)
        place = scenario.path.project(truth.x, truth.y, None if place is None else place.s)
        if len(actors.ids):
            x, y, heading, speed = (np.array([value]) for value in (truth.x, truth.y, truth.heading, truth.speed))
            own = vehicle_boxes(x, y, heading, speed, vehicle)
            others = Boxes(actors.x, actors.y, actors.heading, actors.length, actors.width, actors.speed)
            nearest = float(distance(own, others).min())
            impact = truth.speed if nearest == 0.0 < least else impact
            least = min(least, nearest)
            along = (actors.x - truth.x) * math.cos(truth.heading) + (actors.y - truth.y) * math.sin(truth.heading)
            near = np.abs(along - 0.5 * vehicle.length) < 0.5 * vehicle.length
            if truth.speed > 0.5 and near.any():
                beside = min(beside, float(distance(own, others.select(near)).min()))
        aside, slowest = max(aside, abs(place.d)), min(slowest, truth.speed)
        if number % 5 == 0:
            found = scenario.path.locate(actors.x, actors.y, place.s - 60.0, place.s + 190.0)
            bodies = tuple((s, d) for s, d in zip(*(column.tolist() for column in found), strict=True) if abs(d) < 8.0)
            track.append(Instant(now, place.s, place.d, truth.speed, nearest if bodies else math.inf, bodies))
        rested = rested + 0.02 if truth.speed < 0.01 else 0.0
        state = tick.output.status.state.value
        if least == 0.0 or now >= case.until or place.s + vehicle.rear_axle_to_bumper >= end:
            break
        if (state in ("stopping", "stopped", "fault") and rested > 2.0) or rested > 25.0:
            break
    reasons = ",".join(tick.output.status.reasons)
    shell.close()
    assert place is not None
    return Outcome(
        least == 0.0, least, beside, aside, abs(place.d), place.s, slowest, truth.speed, state, now, impact,
        reasons, tuple(track),
    )  # fmt: skip


class _Fault:
    """Breaks something of an ego at a drive time."""

    def __init__(self, case: Case, ego: Any) -> None:
        self._case, self._ego, self._done = case, ego, False

    def step(self, now: float) -> None:
        if self._done or now < self._case.fault_at:
            return
        self._done = True
        if self._case.fault == "silent":
            gateway = self._ego.gateway
            step = gateway.step
            gateway_step: Callable[..., Any] = lambda at, _setpoint, *others: step(at, None, *others)  # noqa: E731
            object.__setattr__(gateway, "step", gateway_step)
        else:
            self._ego.pipeline._controller._controller.step = _raises


def _raises(_observation: object) -> None:
    raise RuntimeError("a fault that was put there")


# What is driven.


def controlled(planner: str, means: str, **tuning: Any) -> dict[str, Any]:
    """Return the changes that put a controller with its lidar on the car."""
    return {
        "controller": {"name": planner, "tuning": MEANS[means] | tuning},
        "sensors": [{"name": "roof", "kind": "lidar"}],
        "ego.deviation_limit_m": 6.0,
    }


def oncoming(draw: np.random.Generator) -> list[dict[str, Any]]:
    """Draw cars that come the other way and give way to nobody."""
    actors, at = [], float(draw.uniform(660.0, 740.0))
    speed = float(draw.uniform(5.0, 11.0))
    for number in range(int(draw.integers(0, 4))):
        actors.append(
            {
                "id": f"oncoming_{number}", "at_m": min(at, 742.0), "offset_m": float(draw.uniform(3.0, 3.4)),
                "turned_deg": 180.0, "speed_mps": speed, "enters": {"drive_s": float(number) * 3.0 + 0.02},
            }
        )  # fmt: skip
        at = 742.0
        speed = max(speed - float(draw.uniform(0.0, 1.0)), 4.0)
    return actors


def passes(seeds: range, planner: str, gap: float | None = None) -> list[Case]:
    """Return drives past the parked car with cars that come the other way; `gap` [m] as the tuning's `gap_m`."""
    cases, tuning = [], {} if gap is None else {"gap_m": gap}
    for seed in seeds:
        draw = np.random.default_rng(seed)
        changes = controlled(planner, "both", right_m=0.0, **tuning) | {
            "ego.speed_mps": float(draw.uniform(5.0, 11.176)),
            **ROLLS,
            "obstacles.0.offset_m": float(draw.uniform(-0.8, 0.2)),
            "obstacles.0.turned_deg": float(draw.uniform(-5.0, 5.0)),
            "actors": oncoming(draw),
        }
        cases.append(Case("parked_car_passed", changes, seed))
    return cases


def faults(seeds: range, planner: str) -> list[Case]:
    """Return drives past the parked car in SUMO's traffic, with a fault while the car steers around."""
    cases = []
    for seed in seeds:
        draw = np.random.default_rng(1000 + seed)
        speed = float(draw.uniform(5.0, 11.176))
        changes = controlled(planner, "both", right_m=0.0) | {
            "ego.speed_mps": speed,
            **ROLLS,
            "obstacles.0.offset_m": float(draw.uniform(-0.8, 0.2)),
            "actors": [],
            "road.demand": ["linden_17th_light"],
            "road.warm_up_s": float(draw.uniform(20.0, 200.0)),
        }
        # From some 40 m before the parked car to 25 m beyond it.
        at = float(draw.uniform(40.0, 115.0)) / (0.5 * (4.0 + speed))
        cases.append(Case("parked_car_passed", changes, seed, ("silent", "raises")[seed % 2], at))
    return cases


def library(planner: str) -> list[tuple[str, float, str, Case]]:
    """Return scenario, speed [km/h], means and case of each drive of the library's pedestrians and bicyclists."""
    cases = []
    for name in LIBRARY:
        file = REPOSITORY / "scenarios" / f"{name}.toml"
        end = tomllib.loads(file.read_text(encoding="utf-8"))["end_trigger"]["ego_at_m"]
        for speed in SPEEDS:
            for means in MEANS:
                changes = controlled(planner, means) | {
                    "ego.speed_mps": speed * KMH, "duration_s": 170.0, "end_trigger.ego_at_m": end + ROAD_AFTER,
                }  # fmt: skip
                cases.append((name, speed, means, Case(name, changes, until=160.0)))
    return cases


def runner(arrives: float, speed: float, planner: str, means: str) -> Case:
    """Return a drive on the test track in which a runner sets out when the car is so far away [s], at a speed [m/s]."""
    begin, at = 60.0, 60.0 + 4.0 * speed
    actor = {
        "id": "runner", "kind": "pedestrian", "at_m": at, "offset_m": -RUNS * arrives, "turned_deg": 90.0,
        "events": [{"when": {"ego_arrives_in_s": arrives}, "speed_mps": RUNS, "acceleration_mps2": 50.0}],
    }  # fmt: skip
    changes = controlled(planner, means) | {
        "road.network": "test_track", "ego.path": "test_track", "ego.speed_mps": speed, "actors": [actor],
        "ego.initial_speed_mps": speed, "ego.initial_s_m": begin, "end_trigger": {"ego_at_m": at + ROAD_AFTER + speed},
        "ego.car": {},
    }  # fmt: skip
    return Case("pedestrian_740_dash", changes, until=20.0)


# What physics allows.


def avoidable(arrives: float, speed: float, means: str, vehicle: Any, known: float = KNOWN_AFTER) -> bool:
    """Tell whether a car can avoid a runner at all: full braking, the hardest swerve to either side, or both at once.

    By steps of 5 ms of a point that brakes after the brakes' delay and that comes aside as `laws.sideways_reach` says
    after the steering's; the car keeps its heading, which takes nothing from it.
    """
    from vve_sumo.laws import sideways_reach

    choices = {"braking": [(1, 0)], "steering": [(0, 1), (0, -1)]}
    for brakes, side in choices.get(means, [(1, 0), (1, 1), (1, -1), (0, 1), (0, -1)]):
        if not _meets(arrives, speed, brakes, side, vehicle, known, sideways_reach):
            return True
    return False


def _meets(
    arrives: float, speed: float, brakes: int, side: int, vehicle: Any, known: float, reach: Callable[..., float]
) -> bool:
    step, time, way, v = 0.005, 0.0, -speed * arrives, speed
    length, width = RUNNER
    jerk = 30.0
    while time < arrives + 6.0:
        braked = time - known - vehicle.brake_delay - 2.0 * vehicle.brake_lag
        v = max(v - brakes * min(jerk * max(braked, 0.0), vehicle.deceleration_limit) * step, 0.0)
        way, time = way + v * step, time + step
        aside = side * reach(time - known - vehicle.steering_delay - vehicle.steering_lag, LATERAL, LATERAL_JERK)
        lies = RUNS * (time - arrives)
        beside = -0.5 * width < way < vehicle.length + 0.5 * width
        if beside and abs(lies - aside) < 0.5 * (vehicle.width + length):
            return True
        if v == 0.0:
            return False
    return False


# Tables.


def driven(cases: Sequence[Case]) -> Iterator[Outcome]:
    """Drive cases in processes of their own, in their order."""
    # One drive a process: a process holds one simulation. Forked from one that has imported all, it begins at once.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    with ProcessPoolExecutor(min(WORKERS, os.cpu_count() or 1), context, max_tasks_per_child=1) as pool:
        for number, (case, done) in enumerate(zip(cases, pool.map(drive, cases), strict=True), start=1):
            said = f"{case.scenario}, seed {case.seed}: {done._replace(track=())}"
            print(f"{number} of {len(cases)}: {said}", file=sys.stderr, flush=True)
            yield done


def spread(values: Iterable[float]) -> str:
    """Return least, median and greatest."""
    found = sorted(value for value in values if math.isfinite(value))
    return f"{found[0]:.2f}, {found[len(found) // 2]:.2f}, {found[-1]:.2f}" if found else "none"


def print_passes(planner: str, seeds: range, gap: float | None) -> None:
    """Print what came of the drives past the parked car."""
    cases = passes(seeds, planner, gap)
    done = list(driven(cases))
    passed = [one for one in done if one.s > 660.0]
    rows = {
        "contacts": f"{sum(one.contact for one in done)} of {len(done)}",
        "passed": f"{len(passed)} of {len(done)}",
        "waited (slower than 0.5 m/s)": f"{sum(one.slowest < 0.5 for one in done)}",
        "least clearance [m]": spread(one.beside for one in passed),
        "distance from the path at the end [m]": spread(one.last for one in passed),
        "drive time [s]": spread(one.time for one in passed),
    }
    print(f"| {planner} | least, median, greatest |\n|---|---|")
    for name, value in rows.items():
        print(f"| {name} | {value} |")
    for case, one in zip(cases, done, strict=True):
        if one.contact or one.s < 660.0 or one.last > 0.15 or one.beside < 0.8:
            print(f"seed {case.seed}: {one._replace(track=())}")


def print_faults(planner: str, seeds: range) -> None:
    """Print what came of the faults."""
    cases = faults(seeds, planner)
    done = list(driven(cases))
    struck = [one for one in done if one.reasons]
    rows = {
        "contacts": f"{sum(one.contact for one in done)} of {len(done)}",
        "stopped by the gateway": f"{len(struck)}",
        "of these away from the path by more than 0.3 m": f"{sum(one.last > 0.3 for one in struck)}",
        "least clearance [m]": spread(one.clearance for one in struck),
    }
    print(f"| {planner}, faults | least, median, greatest |\n|---|---|")
    for name, value in rows.items():
        print(f"| {name} | {value} |")
    for case, one in zip(cases, done, strict=True):
        if one.contact:
            print(f"seed {case.seed} {case.fault} {case.fault_at:.2f}: {one._replace(track=())}")


def print_library(planner: str, smoke: bool) -> None:
    """Print contacts of the library's pedestrians and bicyclists."""
    plan = library(planner)
    plan = [row for row in plan if row[0] == LIBRARY[2] and row[1] == 30.0 and row[2] == "both"] if smoke else plan
    found = dict(zip([row[:3] for row in plan], driven([row[3] for row in plan]), strict=True))
    speeds = sorted({row[1] for row in plan})
    print(f"| {planner} | means | " + " | ".join(f"{speed:g} km/h" for speed in speeds) + " |")
    print("|---|---|" + "---:|" * len(speeds))
    for name, means in dict.fromkeys((row[0], row[2]) for row in plan):
        cells = []
        for speed in speeds:
            one = found[name, speed, means]
            back = "" if one.last <= 0.15 else f", {one.last:.2f} m off"
            cells.append(f"contact at {one.impact / KMH:.0f}" if one.contact else f"{one.clearance:.1f} m{back}")
        print(f"| `{name}` | {means} | " + " | ".join(cells) + " |")


def print_late(planner: str, smoke: bool) -> None:
    """Print the runner who sets out late, beside what physics allows."""
    from vve_sumo.vehicle.load import load

    vehicle = load(REPOSITORY / "vehicles" / "ford_fusion.toml").vehicle
    arrivals, speeds = ((1.6,), (40.0,)) if smoke else (LATE, SPEEDS)
    plan = [(arrives, speed, means) for arrives in arrivals for means in MEANS for speed in speeds]
    found = dict(zip(plan, driven([runner(a, s * KMH, planner, m) for a, s, m in plan]), strict=True))
    print(
        f"| {planner}: sets out | means | "
        + " | ".join(f"{speed:g} km/h" for speed in speeds)
        + " | physics allows up to |"
    )
    print("|---|---|" + "---|" * (len(speeds) + 1))
    for arrives in arrivals:
        for means in MEANS:
            cells = []
            for speed in speeds:
                one = found[arrives, speed, means]
                may = "" if avoidable(arrives, speed * KMH, means, vehicle) else " (not avoidable)"
                cells.append((f"contact at {one.impact / KMH:.0f}" if one.contact else "clear") + may)
            fastest = [v for v in range(5, 81) if avoidable(arrives, v * KMH, means, vehicle)]
            print(f"| {arrives:g} s | {means} | " + " | ".join(cells) + f" | {max(fastest, default=0)} km/h |")


def draw(planner: str, file: Path) -> None:
    """Draw the drive of `parked_car_passed`: where the car is beside its path, how fast, how far from others."""
    from matplotlib.patches import Rectangle

    from vve_sumo.plotting.page import ACTOR, EGO, OBSTACLE, QUIET
    from vve_sumo.plotting.style import LIMIT, OVER, WIDTH, name, page, plain, save

    (done,) = driven([Case("parked_car_passed", {"controller.name": planner} | ROLLS)])
    s = np.array([one.s for one in done.track])
    with page(WIDTH, 6.0) as figure:
        way, speed, away = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
        name(figure, "The parked car passed: " + planner.replace("_", " "))
        for axes in (way, speed, away):
            plain(axes)
        for edge in (-1.6, 1.6, 4.8):
            way.axhline(edge, color=QUIET, linewidth=0.8, linestyle="-" if edge != 1.6 else (0, (8, 8)))
        shown: list[Instant] = []
        for one in done.track[::15]:
            if shown and one.s - shown[-1].s < 4.0:
                continue
            shown.append(one)
            for at, d in one.others:
                if d > 1.6 and s[0] < at < s[-1]:
                    way.plot(at, d, "<", color=ACTOR, markersize=4)
                    way.annotate(f"{one.time:.0f} s", (at, d), (0, 5), textcoords="offset points", fontsize=6)
            way.plot(one.s, one.d, "o", color=EGO, markersize=3)
            way.annotate(f"{one.time:.0f} s", (one.s, one.d), (0, -9), textcoords="offset points", fontsize=6)
        at, d = next(place for one in done.track for place in one.others if place[1] < 1.6)
        way.add_patch(Rectangle((at - 2.25, d - 0.9), 4.5, 1.8, color=OBSTACLE))
        way.plot(s, [one.d for one in done.track], color=EGO, linewidth=OVER)
        way.set_ylabel("left of the path [m]")
        speed.plot(s, [one.speed for one in done.track], color=EGO, linewidth=OVER)
        speed.set_ylabel("speed [m/s]")
        away.plot(s, [one.clearance for one in done.track], color=EGO, linewidth=OVER)
        away.axhline(0.8, **LIMIT)
        away.set_ylim(0.0, 12.0)
        away.set_ylabel("nearest body [m]")
        away.set_xlabel("rear axle along the path [m]")
        save(figure, file)


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", choices=["passes", "faults", "library", "late", "picture"], default="passes")
    parser.add_argument("--runs", type=int, default=200, help="drives of passes and of faults")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="of the first of these (default: 1)")
    parser.add_argument("--planner", choices=PLANNERS, default=PLANNERS[0])
    parser.add_argument(
        "--gap", type=float, metavar="M", help="of passes: how near it comes to what it waits behind [m]"
    )
    parser.add_argument("--smoke", action="store_true", help="a few drives, only to see that all of it runs")
    given = parser.parse_args()
    if given.smoke:
        print_late(given.planner, smoke=True)
        return
    seeds = range(given.first, given.first + given.runs)
    parts = {
        "passes": partial(print_passes, given.planner, seeds, given.gap),
        "faults": partial(print_faults, given.planner, seeds),
        "library": partial(print_library, given.planner, False),
        "late": partial(print_late, given.planner, False),
        "picture": partial(draw, given.planner, PICTURE),
    }
    parts[given.part]()


if __name__ == "__main__":
    main()
