"""Receiver and car compared: each disagreement alone, with numbers worked out by hand."""

from __future__ import annotations

from tests.vehicle.car import Rig


def test_headings_that_are_finite_and_infinitely_far_apart_are_a_mismatch():
    """1.7e308 less -1.7e308 is infinite, and an infinite angle has no remainder."""
    rig = Rig()
    rig.cruise(5.0)
    for tick in range(60):
        verdict = rig.step(0.0, heading=1.7e308 if tick < 20 else -1.7e308)
    assert verdict.reasons[0] == "heading_mismatch"
