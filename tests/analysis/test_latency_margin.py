"""The latency margin of rows made by hand: margins, crossing and closed form against arithmetic done here."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
import pytest

from vve_sumo.analysis.latency_margin import (
    DELAY,
    EDGES,
    NOISE,
    STEPS,
    LatencyMargin,
    edges_of,
    margins,
    steps_of,
    zero_of,
)

SPEED = 10.0
ROW: dict[str, Any] = {
    NOISE: 0.0, DELAY: 0.0, "error": "", "passed": True, "collision": False, "outcome": "stopped", "reasons": "",
    "stop_gap_m": math.nan, "min_gap_m": math.nan, "max_lateral_deviation_m": 0.1, "meets_outcome": True,
    "meets_stop_gap_m": True,
}  # fmt: skip
NO_ROW: dict[str, Any] = dict.fromkeys(
    ["passed", "collision", "outcome", "reasons", "meets_outcome", "meets_stop_gap_m"]
)


def rows(*said: dict[str, Any]) -> pd.DataFrame:
    truths = {"passed": "boolean", "collision": "boolean", "meets_outcome": "boolean", "meets_stop_gap_m": "boolean"}
    return pd.DataFrame([ROW | one for one in said]).astype(truths)


def ended(delay: float, gap: float, **other: Any) -> dict[str, Any]:
    return {DELAY: delay, "stop_gap_m": gap, "min_gap_m": gap, **other}


def hit(delay: float, gap: float, **other: Any) -> dict[str, Any]:
    failed = {"passed": False, "collision": True, "outcome": "contact", "meets_outcome": False}
    return ended(delay, gap, **failed, **other)


def found(frame: pd.DataFrame, design: float = math.nan) -> LatencyMargin:
    steps = steps_of(frame, SPEED)
    return LatencyMargin("by hand", "by_hand", SPEED, steps, edges_of(steps, SPEED), design)


def test_the_margin_of_a_run_is_its_gap_and_a_contact_leaves_none() -> None:
    frame = rows(
        ended(0.0, 4.0),
        {"outcome": "arrived", "min_gap_m": 2.5},
        {"outcome": "arrived"},
        hit(0.0, -0.7),
        {"collision": True, "outcome": "contact", "stop_gap_m": 30.0, "min_gap_m": 0.1},
        {"collision": True, "outcome": "fault", "stop_gap_m": math.nan, "min_gap_m": -0.2},
        {"outcome": "fault", "stop_gap_m": 55.0, "min_gap_m": 55.0},
        {"outcome": "fault", "stop_gap_m": 3.5, "min_gap_m": 3.5},
        {"outcome": "broken", "stop_gap_m": 3.5, "min_gap_m": 3.5},
        {"error": "broken: it", **NO_ROW},
    )
    np.testing.assert_array_equal(
        margins(frame), [4.0, 2.5, math.nan, -0.7, 0.0, -0.2, math.nan, math.nan, math.nan, math.nan]
    )
    for row in range(len(frame)):  # it depends on no other run
        np.testing.assert_array_equal(margins(frame.iloc[[row]]), margins(frame)[[row]])


def test_steps_and_edges_are_the_closed_form_where_speed_times_delay_is_all_that_is_lost() -> None:
    delays = (0.3, 0.0, 0.1, 0.4, 0.2)  # as a dataset may have them, in no order
    lost = [(delay, 2.5 + spread - SPEED * delay) for delay in delays for spread in (-0.25, 0.25)]
    study = found(rows(*(hit(*one) if one[1] <= 0.0 else ended(*one) for one in lost)))
    assert list(study.steps) == list(STEPS)
    assert list(study.edges) == list(EDGES)
    np.testing.assert_allclose(study.steps["delay_s"], sorted(delays))
    np.testing.assert_allclose(study.steps["mean_margin_m"], 2.5 - SPEED * np.sort(delays), atol=1e-12)
    np.testing.assert_allclose(study.steps["least_margin_m"], 2.25 - SPEED * np.sort(delays), atol=1e-12)
    np.testing.assert_allclose(study.steps["closed_form_m"], study.steps["mean_margin_m"], atol=1e-12)
    assert study.steps["margins"].tolist() == study.steps["runs"].tolist() == [2] * 5
    assert study.steps["contacts"].tolist() == [0, 0, 0, 2, 2]
    assert study.steps["passed_share"].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]
    (edge,) = study.edges.to_dict("records")
    assert edge["zero_s"] == edge["closed_form_zero_s"] == pytest.approx(0.25, abs=1e-12)
    assert (edge["zero_from_s"], edge["zero_to_s"], edge["known_to_s"]) == (0.2, 0.3, 0.4)
    assert (edge["passed_to_s"], edge["failed_from_s"], edge["missed"]) == (0.2, 0.3, "outcome")
    (said,) = study.verdicts()
    assert "goes to zero at 250 ms, between 200 ms and 300 ms (speed times delay says 250 ms)" in said
    assert study.steps.attrs["units"]["mean_margin_m"] == "m"


def test_a_run_that_has_nothing_left_is_named_before_the_mean_has_not() -> None:
    study = found(rows(ended(0.0, 2.0), ended(0.0, 2.2), ended(0.1, 1.0), hit(0.1, -0.5), ended(0.2, 0.4)))
    (edge,) = study.edges.to_dict("records")
    assert (edge["touched_from_s"], math.isnan(edge["zero_s"])) == (0.1, True)
    (said,) = study.verdicts()
    assert "the mean margin does not go to zero up to 200 ms" in said
    assert "; from 100 ms on a run has nothing left; " in said
    both = found(rows(ended(0.0, 2.0), hit(0.1, -1.0)))
    assert "nothing left" not in next(both.verdicts())


def test_a_margin_that_ends_because_the_gateway_stops_the_car_is_no_zero() -> None:
    stop = {"outcome": "fault", "reasons": "off_path; pose_stale", "passed": False, "meets_outcome": False}
    study = found(rows(ended(0.0, 5.0), ended(0.1, 4.9), ended(0.2, 80.0, **stop), ended(0.3, math.nan, **stop)), 0.4)
    assert study.steps[["margins", "contacts", "stopped_by_gateway"]].to_numpy().tolist() == [
        [1, 0, 0],
        [1, 0, 0],
        [0, 0, 1],
        [0, 0, 1],
    ]
    (edge,) = study.edges.to_dict("records")
    assert math.isnan(edge["zero_s"])
    assert (edge["known_to_s"], edge["failed_from_s"], edge["stopped_for"]) == (0.1, 0.2, "off_path+pose_stale")
    margin, design = study.verdicts()
    assert "does not go to zero up to 100 ms, beyond which no run has one" in margin
    assert "from 200 ms on not every run passes (outcome), the gateway stops for off_path, pose_stale" in margin
    assert "bears 400 ms at 10.0 m/s" in design


def test_each_noise_factor_has_its_own_edge_and_a_run_with_a_fault_does_not_pass() -> None:
    clean = [ended(delay, 1.0 - SPEED * delay) for delay in (0.0, 0.05)]
    noisy = [hit(0.0, -0.1, **{NOISE: 4.0}), {NOISE: 4.0, DELAY: 0.05, "error": "timed_out", **NO_ROW}]
    study = found(rows(*noisy, *clean))
    assert study.edges["noise_factor"].tolist() == [0.0, 4.0]
    assert study.edges["zero_s"].isna().tolist() == [True, False]
    quiet, loud = study.verdicts()
    assert quiet.endswith("every run passed")
    assert "the mean margin is zero from the first step on, 0 ms" in loud
    assert study.steps["judged"].tolist() == [1, 1, 1, 0]
    all_errors = found(rows({DELAY: 0.0, "error": "timed_out", **NO_ROW}))
    assert "no run has a margin" in next(all_errors.verdicts())
    assert all_errors.edges["failed_from_s"].tolist() == [0.0]
    one_error = found(rows(ended(0.0, 1.0), {DELAY: 0.0, "error": "timed_out", **NO_ROW}))
    assert one_error.edges["failed_from_s"].tolist() == [0.0]


@pytest.mark.parametrize(
    ("margin", "zero"),
    [
        ([3.0, 1.0, -1.0], (1.5, 1.0, 2.0)),
        ([3.0, 1.0, 0.0], (2.0, 1.0, 2.0)),
        ([3.0, -1.0, 2.0], (0.75, 0.0, 1.0)),
        ([0.0, 1.0, 1.0], (0.0, 0.0, 0.0)),
        ([3.0, 2.0, 1.0], (math.nan,) * 3),
        ([], (math.nan,) * 3),
    ],
)
def test_where_a_margin_first_goes_to_zero(margin: list[float], zero: tuple[float, float, float]) -> None:
    assert zero_of([0.0, 1.0, 2.0][: len(margin)], margin) == pytest.approx(zero, nan_ok=True)
