"""Spoilt, forged and random packets of a real on-board unit against what reads, judges and places its stations.

A run is 1000 datagrams to one drive. Genuine cars and people are among them; the others are of other times and places
and at other speeds than a road has, of ever new stations, cut, changed in some bytes or bits, or random. Invariants:

 1. No exception; a datagram gives a report or a known reason, and the same when it is read again.
 2. A report is believed, or refused for a known reason; one that is refused changes no body.
 3. Bodies are finite, no faster than a vehicle, of different stations, and no more than the rig takes.
"""

from __future__ import annotations

import math
import random
from typing import Final

from tests.fuzz.decoders import _spoilt
from tests.fuzz.invariant import Violation, hold
from tests.stations.messages import EPOCH, FRAME, car, walker
from vve_sumo.frames import Alignment
from vve_sumo.stations import reports, station_gate
from vve_sumo.stations.received_stations import ReceivedStations, StationsSetup
from vve_sumo.stations.station_gate import GateLimits

INPUTS: Final = 1000  # of a run
STATIONS: Final = 6
SETUP: Final = StationsSetup(
    FRAME.projection, FRAME.offset, Alignment(), (0.0, 0.0), EPOCH, GateLimits(stations=STATIONS)
)


def _genuine(chance: random.Random, now: float) -> bytes:
    """A packet of somebody who is there, or says so."""
    if chance.random() < 0.4:
        return car(now, 4.0 * now % 60.0, 3.0, 0.0, 4.0, station=chance.choice((7, 8)))
    x, y = chance.uniform(-40.0, 40.0), chance.uniform(-5.0, 5.0)
    speed, turned = chance.choice((0.0, 1.4, chance.uniform(0.0, 160.0))), chance.uniform(-4.0, 4.0)
    then = now + chance.choice((0.0, -0.05, chance.uniform(-40.0, 40.0)))
    if chance.random() < 0.5:
        return walker(then, x, y, turned, speed, chance.randrange(4))
    return car(then, x, y, turned, speed, chance.choice((7, 8, chance.getrandbits(32))))


def run(seed: int) -> int:
    """Try one drive; how many datagrams that were. Raises Violation, which says where."""
    chance, stations, now = random.Random(f"stations {seed}"), ReceivedStations(SETUP), 100.0
    for number in range(INPUTS):
        now += chance.choice((0.01, 0.05, 0.1))
        genuine = _genuine(chance, now)
        data = _spoilt(chance, genuine, genuine)
        try:
            _judge(stations, now, data)
        except Violation as violation:
            raise Violation(f"invariant {violation}\n  seed {seed}, datagram {number}: {data!r}") from violation
        except Exception as error:
            raise Violation(f"invariant 1: {error!r}\n  seed {seed}, datagram {number}: {data!r}") from error
    return INPUTS


def _judge(stations: ReceivedStations, now: float, data: bytes) -> None:
    said = reports.read(data, now, EPOCH)
    hold(1, repr(said) == repr(reports.read(data, now, EPOCH)), said)
    before = stations.step(now)
    reason = said if isinstance(said, str) else stations.receive(now, said)
    hold(2, reason in {"", *station_gate.REASONS}, reason)
    after = stations.step(now)
    hold(2, not reason or before == after, (reason, before, after))
    hold(3, len({state.station for state in after}) == len(after) <= STATIONS, after)
    for state in after:
        body = state.body
        hold(3, math.isfinite(body.x + body.y + body.heading + state.age) and 0.0 <= body.speed <= 70.0, state)
