"""One episode of odd driving on Linden's streets: says what touched the ego, and who waited for whom."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tests.odd.ego import Manoeuvre, OddEgo, plan
from tests.odd.judge import Memory, judge
from tests.vehicles import FUSION
from vve_sumo.drive.path_in_network import read_path
from vve_sumo.geometry import Box
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO
from vve_sumo.world.ego_sync import Ego
from vve_sumo.world.network import read_network
from vve_sumo.world.world import World

REPOSITORY: Final = Path(__file__).parent.parent.parent
PATHS: Final = ("linden_loop", "linden_17th", "linden_leap", "linden_cleveland")
WARM_UP: Final = 120.0  #: [s]
NEAR: Final = 60.0  #: who is farther off is not remembered [m]
APART: Final = 2.0  #: an overlap is a new one where there was none for so long [s]
STANDS: Final = 0.1  #: slower is standing [m/s]
JUMP: Final = 0.2  #: sideways in one step [m]


@dataclass(slots=True)
class Told:
    """What became of an episode."""

    seed: int
    seconds: float = 0.0
    driven: float = 0.0  #: by the ego [m]
    overlaps: list[str] = field(default_factory=list)  #: a line each
    avoidable: int = 0
    longest_wait: float = 0.0  #: for somebody who stands in the way of an ego that means to move [s]
    waits: list[str] = field(default_factory=list)  #: a line for each beyond a minute
    jumps: list[str] = field(default_factory=list)  #: a line for each actor's step sideways
    removed_at_entry: tuple[str, ...] = ()
    most_standing: int = 0  #: actors that stood near the ego at one time


def odd(seed: int, seconds: float, level: str) -> Told:
    """Drive oddly for so long, from a place of chance."""
    chance = random.Random(seed)
    path = PATHS[seed % len(PATHS)]
    return drive(seed, seconds, level, path, chance.random(), plan(chance), WARM_UP)


def drive(
    seed: int, seconds: float, level: str, along: str, start: float, means: Iterator[Manoeuvre], warm_up: float
) -> Told:
    """Drive as a driver means to for so long, from a share of the path on."""
    network = read_network(REPOSITORY / "networks" / "linden.net.xml")
    path, route, _lanes = read_path(REPOSITORY / "routes" / f"{along}.csv", network.frame(), network)
    ego = OddEgo(path, FUSION.vehicle, start * (path.length - 200.0), means)
    demand = [REPOSITORY / "routes" / f"linden_{level}.rou.xml"]
    reported, memory, touched = Told(seed), Memory(PERIOD), dict[str, float]()
    egos = [Ego(EGO, FUSION.vehicle, route)]
    with World(network.path, demand=demand, seed=seed, period=PERIOD, egos=egos, warm_up=warm_up) as world:
        report = world.step({EGO: ego.pose()})[EGO]
        before: dict[str, Box] = {}
        waited, lane = 0.0, ""
        for k in range(round(seconds / PERIOD)):
            now, actors = k * PERIOD, world.actors(EGO)
            pose = ego.step(PERIOD, actors, report.lane.startswith(":"))
            report = world.step({EGO: pose})[EGO]
            if report.faults:
                reported.overlaps.append(f"seed {seed} at {now:.2f} s: {report.faults}")
            reported.driven += abs(pose.speed) * PERIOD
            others = _near(world, pose.x, pose.y)
            memory.keep(now, ego.body(), others)
            _look_for_jumps(reported, now, before, others)
            reported.most_standing = max(reported.most_standing, sum(speed < STANDS for _, _, speed in others))
            for name in world.contacts(EGO):
                if now - touched.get(name, -math.inf) > APART and (moments := memory.of(name)):
                    verdict = judge(moments)
                    reported.avoidable += verdict.avoidable
                    reported.overlaps.append(
                        f"seed {seed} at {now:.2f} s: {name} at {verdict.impact:.1f} m/s, {ego.manoeuvre.name} at "
                        f"{pose.speed:.1f} m/s on {report.lane or 'no lane'}, which lay across its way for "
                        f"{verdict.lay:.1f} s, from when it drove {verdict.speed:.1f} m/s: "
                        f"{'AVOIDABLE' if verdict.avoidable else 'not avoidable'}"
                    )
                touched[name] = now
            waiting = now - ego.blocked_since
            if waiting > 0.0:
                waited, lane = waiting, f"{ego.blocked_by} on {report.lane or 'no lane'}, {ego.manoeuvre.name}"
                reported.longest_wait = max(reported.longest_wait, waited)
            elif waited > 0.0:
                if waited > 60.0:
                    reported.waits.append(f"seed {seed} until {now:.0f} s: {waited:.0f} s for {lane}")
                waited = 0.0
        if waited > 60.0:
            reported.waits.append(f"seed {seed} until the end: {waited:.0f} s for {lane}")
        reported.seconds, reported.removed_at_entry = seconds, world.removed_at_entry
    return reported


def _near(world: World, x: float, y: float) -> list[tuple[str, Box, float]]:
    actors = world.actors(EGO)
    columns = (actors.x, actors.y, actors.heading, actors.length, actors.width, actors.speed)
    return [
        (name, Box(at_x, at_y, heading, length, width), speed)
        for name, at_x, at_y, heading, length, width, speed in zip(
            actors.ids, *(column.tolist() for column in columns), strict=True
        )
        if abs(at_x - x) < NEAR and abs(at_y - y) < NEAR
    ]


def _look_for_jumps(reported: Told, now: float, before: dict[str, Box], others: list[tuple[str, Box, float]]) -> None:
    for name, box, _ in others:
        last = before.get(name)
        if last is not None:
            middle = last.heading + 0.5 * math.remainder(box.heading - last.heading, math.tau)
            aside = (box.y - last.y) * math.cos(middle) - (box.x - last.x) * math.sin(middle)
            if abs(aside) > JUMP:
                reported.jumps.append(f"seed {reported.seed} at {now:.2f} s: {name} by {aside:.2f} m")
    before.clear()
    before.update({name: box for name, box, _ in others})
