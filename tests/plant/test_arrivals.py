"""Arrivals in bursts against the quantiles that they were made from, spells of float positions against their means."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.plant.arrivals import Bursts, FloatSpells
from vve_sumo.plant.receiver import PERIOD
from vve_sumo.vehicle.model import IDEAL

MEASURED = vehicles.FUSION.measured
#: Of an RTK/INS stream of another car, 100 Hz over a network (../shared/data/README.md, "Facts already checked"); the
#: recording itself is not there.
SHORT, P95, LONGEST = 0.70, 0.0455, 0.0481


def arrivals(seconds: float, seed: int = 1, of=MEASURED) -> list[float]:
    bursts = Bursts(of, np.random.SeedSequence(seed))
    return [bursts.arrival(number * PERIOD) for number in range(round(seconds / PERIOD))]


def test_gaps_have_the_quantiles_of_the_recorded_stream() -> None:
    gaps = np.diff(arrivals(1000.0))
    assert np.mean(gaps < 1e-3) == pytest.approx(SHORT, abs=0.01)
    assert np.quantile(gaps, 0.95) == pytest.approx(P95, abs=5e-4)
    assert gaps.max() == pytest.approx(LONGEST, abs=1e-4)
    assert gaps.mean() == pytest.approx(PERIOD, rel=2e-3), "as many arrive as are sent"


@given(seed=st.integers(0, 10_000), share=st.floats(0.68, 0.78))
def test_nothing_arrives_early_out_of_order_or_later_than_the_longest_gap(seed: int, share: float) -> None:
    late = arrivals(3.0, seed, replace(MEASURED, receiver_short_gaps=share))
    assert all(sooner <= later for sooner, later in pairwise(late))
    waits = [arrival - number * PERIOD for number, arrival in enumerate(late)]
    assert all(0.0 <= wait <= LONGEST for wait in waits)


@pytest.mark.parametrize("share", [0.68, 0.7, 0.78])
def test_the_shortest_time_between_bursts_makes_the_mean_one_fix_a_period(share: float) -> None:
    of = replace(MEASURED, receiver_short_gaps=share)
    between = 0.95 - share
    mean = between * 0.5 * (of.receiver_gap_min + P95) + 0.05 * 0.5 * (P95 + LONGEST)
    assert mean == pytest.approx(PERIOD)


def test_spells_come_and_last_as_stated() -> None:
    of = replace(IDEAL, receiver_float_every=20.0, receiver_float_time=5.0, receiver_float_sigma=0.3)
    spells = FloatSpells(of, np.random.SeedSequence(4))
    offsets = [spells.offset(0.1 * number) for number in range(400_000)]
    floating = np.array([offset is not None for offset in offsets])
    begun = [after for before, after in pairwise(offsets) if before is None and after is not None]
    assert floating.mean() == pytest.approx(5.0 / 25.0, abs=0.02)
    assert len(begun) == pytest.approx(40_000.0 / 25.0, rel=0.08)
    assert np.std(begun, axis=0) == pytest.approx([0.3, 0.3], rel=0.1)
    assert not floating[0]


def test_a_stream_may_begin_before_time_0_and_is_the_same_then() -> None:
    of = replace(MEASURED, receiver_float_every=20.0, receiver_float_time=5.0, receiver_float_sigma=0.3)
    early, usual = (Bursts(of, np.random.SeedSequence(3), begin) for begin in (-100.0, 0.0))
    for number in range(2000):
        assert early.arrival(number * PERIOD - 100.0) == pytest.approx(usual.arrival(number * PERIOD) - 100.0)
    soon, later = (FloatSpells(of, np.random.SeedSequence(3), begin) for begin in (-100.0, 0.0))
    assert [soon.offset(time - 100.0) for time in range(500)] == [later.offset(float(time)) for time in range(500)]
