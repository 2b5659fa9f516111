"""Stamps of a wall clock that is set and slewed at any instant, in a made-up world whose true times are known."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.pose.stamps import WALL_STEP, Stamps, wall_ahead

LOOK = 2e-6  #: what a look at the clocks takes [s]


class World:
    """True time is the monotonic clock; the wall clock is ahead of it by steps and a slew."""

    def __init__(self, steps: list[tuple[float, float]], slew: float) -> None:
        self.now, self._steps, self._slew = 0.0, steps, slew

    def ahead_at(self, time: float) -> float:
        return 1.8e9 + self._slew * time + sum(size for at, size in self._steps if at <= time)

    def ahead(self) -> float:
        """Look at the wall clock, which takes a moment."""
        self.now += LOOK
        return self.ahead_at(self.now) + self.now - self.now

    def monotonic(self) -> float:
        return self.now


def read(
    steps: list[tuple[float, float]], slew: float, chance: random.Random, *, seconds: float = 8.0, most: int = 256
) -> list[tuple[float, float, float]]:
    """Rows of true arrival, dated arrival and the time it was dated at, of a queue read every 2 to 60 ms.

    Arrivals come at any instant, between two portions of one reading, too, and a reading takes `most` portions.
    """
    world = World(steps, slew)
    arrivals = sorted(chance.uniform(0.0, seconds) for _ in range(round(100 * seconds)))
    stamps = Stamps(world.ahead, world.monotonic)
    rows, taken = [], 0
    while world.now < seconds:
        world.now += chance.uniform(0.002, 0.06)
        stamps.begin()
        stamped, true, emptied = [], [], False
        for _ in range(most):
            world.now += chance.uniform(0.0, 1e-4)
            if taken == len(arrivals) or arrivals[taken] > world.now:
                emptied = True
                break
            arrival = arrivals[taken]
            true.append(arrival)
            stamped.append((arrival + world.ahead_at(arrival), b""))
            taken += 1
        world.now += chance.uniform(0.0, 1e-3)
        dated = stamps.dated(stamped, emptied)
        rows += [(arrival, moment, world.now) for arrival, (moment, _data) in zip(true, dated, strict=True)]
    return rows


SIZES = [-3600.0, -0.5, -0.03, -0.01, -0.004, 0.004, 0.01, 0.03, 0.5, 3600.0]


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    sizes=st.lists(st.sampled_from(SIZES), max_size=5),
    slew=st.sampled_from([-500e-6, 0.0, 500e-6]),
    most=st.sampled_from([3, 256]),
)
def test_nothing_is_dated_before_it_came_or_after_it_was_read_whenever_the_clock_is_set(seed, sizes, slew, most):
    chance = random.Random(seed)
    steps = [(1.0 + k + chance.random() * 0.7, size) for k, size in enumerate(sizes)]
    for arrival, dated, now in read(steps, slew, chance, most=most):
        assert arrival - 1e-4 - abs(slew) * (now - arrival) <= dated <= now


@pytest.mark.parametrize("size", SIZES)
def test_a_step_in_any_microsecond_about_a_reading_is_seen(size):
    """The clock is set between two looks, within one, or while a portion waits: tried one after the other."""
    for step in range(400):
        at = 0.02 + step * 1e-6
        world = World([(at, size)], 0.0)
        stamps = Stamps(world.ahead, world.monotonic)
        world.now = 0.02
        stamps.begin()
        world.now += 20e-6
        arrival = world.now + 1e-6  # just after the queue was found empty, before the clocks are looked at
        world.now += 20e-6
        stamps.dated([(0.01 + world.ahead_at(0.01), b"w")], True)
        stamped = [(arrival + world.ahead_at(arrival), b"x")]
        world.now = 0.02 + 300e-6
        stamps.begin()
        world.now += 20e-6
        ((moment, _),) = stamps.dated(stamped, True)
        assert arrival - 2 * LOOK <= moment <= world.now, at


def test_an_even_clock_leaves_every_arrival_where_it_was():
    for slew in (-500e-6, 0.0, 500e-6):
        rows = read([], slew, random.Random(1))
        assert all(dated == pytest.approx(arrival, abs=1e-4) for arrival, dated, _now in rows)


def test_a_silence_under_a_slewed_clock_costs_no_stamp():
    world = World([], 500e-6)
    stamps = Stamps(world.ahead, world.monotonic)
    for _ in range(600):
        world.now += 0.1
        stamps.begin()
        assert stamps.dated([], True) == []
    world.now = 70.0
    stamped = [(69.99 + world.ahead_at(69.99), b"x")]
    stamps.begin()
    ((moment, _),) = stamps.dated(stamped, True)
    assert moment == pytest.approx(69.99, abs=1e-4)


def test_no_stamp_at_all_is_now():
    world = World([], 0.0)
    stamps = Stamps(world.ahead, world.monotonic)
    world.now = 1.0
    stamps.begin()
    ((moment, _),) = stamps.dated([(math.nan, b"x")], True)
    assert moment == world.now


def test_the_looks_at_this_machine_s_clocks_agree():
    looks = [wall_ahead() for _ in range(50)]
    assert sorted(looks)[40] - sorted(looks)[10] < WALL_STEP
