"""Where a car may be engaged: near the start of its path, facing along it."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.live import start_pose
from vve_sumo.path import ReferencePath

#: a bend to the left that begins at (100, -20) and runs north-west
PATH = ReferencePath.from_points([100.0, 80.0, 58.0, 35.0], [-20.0, -1.0, 14.0, 22.0])


def placed(along: float, left: float, turned: float) -> start_pose.StartPose:
    """What is found of a car that stands so to the start, by complex numbers."""
    begin = PATH.at(0.0)
    at = complex(begin.x, begin.y) + complex(along, left) * cmath.exp(1j * begin.heading)
    return start_pose.start_pose_of(pose_at_rest(at.real, at.imag, begin.heading + turned), PATH)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.1, 3.1))
def test_place_and_turn_are_found_and_judged(along: float, left: float, turned: float) -> None:
    found = placed(along, left, turned)
    assert found == pytest.approx((along, left, turned), abs=1e-9)
    away, off = abs(complex(along, left)), abs(math.degrees(turned))
    if abs(away - 1.0) > 1e-6 and abs(off - 5.0) > 1e-6:
        assert ("start_position" in found.faults()) is (away > 1.0)
        assert ("start_heading" in found.faults()) is (off > 5.0)


def test_the_wrong_way_round_is_told_with_numbers() -> None:
    found = placed(-0.4, 3.2, math.radians(-178.0))
    assert found.faults() == ("start_position", "start_heading")
    assert found.place_text() == "3.2 m left of the path and 0.4 m before its start"
    assert found.turn_text() == "turned by 178 deg to the right"
    assert placed(0.0, 0.0, math.pi).faults() == ("start_heading",)


def test_what_is_no_number_holds_nowhere() -> None:
    begin = PATH.at(0.0)
    pose = pose_at_rest(begin.x, begin.y, begin.heading)
    assert start_pose.start_pose_of(pose, PATH).faults() == ()
    for name, codes in (("x", "start_position"), ("y", "start_position"), ("heading", "start_heading")):
        assert codes in start_pose.start_pose_of(replace(pose, **{name: math.nan}), PATH).faults()
