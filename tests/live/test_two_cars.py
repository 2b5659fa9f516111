"""Two real cars on one street: whatever part of one is lost, the other is told, and both come to rest.

The truth of both simulated vehicles says where they came to rest, each against the closed form of the layer that has
to stop it. A run that fails while the machine itself stood still says nothing and is repeated.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests import vehicles
from tests.exhaustive import with_slow
from tests.live.stage import read_truth, rows
from tests.live.two_cars import CARS, PARTS, Outcome, TwoCars

ATTEMPTS = 4
#: how often each part is lost in `./check slow`: 20 losses
TIMES = 4
#: how far the second car stands ahead of the first one where the first goes on [m]
NEAR = 35.0
#: from the go to the end of that drive [s]; the first car stands after 17 s
DURATION = 22.0
CAR = vehicles.FUSION.vehicle


def lost(part: str, folder: Path) -> tuple[Outcome, str]:
    """Return what is left of a drive in which a part was lost, and what was wrong with it."""
    for attempt in range(ATTEMPTS):
        outcome = TwoCars(part, folder / str(attempt)).run()
        if not (wrong := outcome.wrong()) or not outcome.stood:
            break
    return outcome, wrong


@pytest.mark.live
@pytest.mark.parametrize(
    ("part", "time"),
    with_slow(
        [(part, time) for time in range(TIMES) for part in PARTS],
        lambda case: case[1] == 0,
        lambda case: case[0] == "gateway",
    ),
)
def test_one_car_is_lost_and_the_other_is_told_and_comes_to_rest(part: str, time: int, tmp_path: Path) -> None:
    _, wrong = lost(part, tmp_path)
    assert not wrong


@pytest.mark.live
def test_a_car_whose_rig_says_so_goes_on_and_stops_behind_the_lost_one(tmp_path: Path) -> None:
    """Its own controller stops it for the other car's body, which stands where its receiver was last."""
    for attempt in range(ATTEMPTS):
        outcome = TwoCars("receiver:second", tmp_path / str(attempt), duration=DURATION, ahead=NEAR, goes_on=True).run()
        wrong = wrong_with_going_on(outcome)
        if not wrong or not outcome.stood:
            break
    assert not wrong


def wrong_with_going_on(outcome: Outcome) -> str:
    """Return what was not right where the first car goes on though the second one lost its receiver."""
    file = outcome.record / "summary.json"
    if math.isnan(outcome.moment) or outcome.alive or not file.exists():
        return f"{outcome.alive} {outcome.said[-1500:]}"
    summary = json.loads(file.read_text(encoding="utf-8"))
    way, rest = {}, {}
    for car in CARS:
        truth = read_truth(outcome.folder(car))
        after = truth["time_s"] >= outcome.moment
        way[car] = float(np.hypot(np.diff(truth["x_m"][after]), np.diff(truth["y_m"][after])).sum())
        rest[car] = float(np.hypot(truth["x_m"][-1] - truth["x_m"][0], truth["y_m"][-1] - truth["y_m"][0]))
    starts = [
        next(tick["x_m"] for tick in rows(outcome.folder(car), "ticks") if tick["x_m"] == tick["x_m"]) for car in CARS
    ]
    gap = starts[1] - starts[0] + rest["second"] - CAR.rear_overhang - rest["ego"] - CAR.rear_axle_to_bumper
    facts = {
        "the first car is told, and goes on": "it goes on, as its rig says" in outcome.said
        and summary["other_cars"]["second"]["code"] == "other_car_stopped",
        "it drove farther than a stop takes": way["ego"] > 2.0 * outcome.way("second")[1],
        "it stood behind the other car": 2.0 < gap < 9.0,
        "its gateway stopped it for nothing but the end": {"drive_over"} >= set(summary["reasons"]),
        "the other car stopped for its receiver": "pose_stale" in {
            code for step in rows(outcome.folder("second"), "gateway") for code in step["reasons"].split("+")
        },
    }  # fmt: skip
    failed = [name for name, holds in facts.items() if not holds]
    return f"not: {failed}; way {way}, gap {gap:.2f}, {summary['reasons']}" if failed else ""
