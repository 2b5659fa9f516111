"""Injected faults as values: through JSON and back, and those that cannot be."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.errors import ConfigError
from vve_sumo.plant.injected_faults import KINDS, NEUTRAL, VALUES, FaultClock, InjectedFault, Shape


@given(st.sampled_from(sorted(KINDS)), st.sampled_from(list(Shape)), st.sampled_from(list(FaultClock)))
def test_a_fault_goes_through_json_and_comes_back(kind, shape, clock):
    if shape is Shape.RAMP and kind not in NEUTRAL:
        return
    period = 0.5 if shape is Shape.FLAPPING else math.nan
    fault = InjectedFault(kind, 1.0, 2.0, VALUES[kind][0] if kind in VALUES else math.nan, shape, period, clock)
    again = InjectedFault.from_dict(json.loads(json.dumps(fault.to_dict(), allow_nan=False)))
    assert repr(again) == repr(fault)
    assert again.shape is shape
    assert again.clock is clock


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("earthquake", 1.0, 1.0), r"fault: kind must be one of another_writer, .*; got 'earthquake'"),
        (("pose_lost", -1.0, 1.0), r"fault pose_lost: at must be 0 s or more"),
        (("pose_lost", math.nan, 1.0), r"fault pose_lost: at must be"),
        (("pose_lost", 1.0, 0.0), r"fault pose_lost: .* duration positive"),
        (("pose_lost", 1.0, math.nan), r"fault pose_lost: .* duration positive"),
        (("pose_lost", 1.0, 1.0, 3.0), r"fault pose_lost: takes no value, got 3"),
        (("brakes_weak", 1.0, 1.0, 1.5), r"fault brakes_weak: value must be 0 to 1, got 1.5"),
        (("brake_override", 1.0, 1.0, 7.0), r"fault brake_override: value must be 0\.15 to 0\.5, got 7"),
        (("dbw_dropout", 1.0, 1.0, 1.5), r"fault dbw_dropout: value must be a whole number, got 1.5"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.RAMP), r"fault pose_lost: its strength does not grow: no ramp"),
        (("brakes_weak", 1.0, math.inf, 0.5, Shape.RAMP), r"fault brakes_weak: shape ramp needs a duration"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.FLAPPING), r"flapping needs a positive period, got nan"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.STEP, 1.0), r"only shape flapping takes a period, got 1"),
    ],
)
def test_a_fault_that_cannot_be_is_one_line(arguments: tuple, text: str):
    with pytest.raises(ConfigError, match=text) as caught:
        InjectedFault(*arguments)
    assert "\n" not in str(caught.value)
