"""The metrics of two egos of one drive: each has its own tables, in which the other one is an actor."""

from __future__ import annotations

import numpy as np
import pytest

from tests.metrics.tables import CAR, PERIOD, actors_of, straight, ticks_of
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.per_drive import PER_DRIVE

#: `behind` closes in on `front` from this gap [m] at these speeds [m/s]
GAP, SPEED = 30.0, {"behind": 12.0, "front": 9.0}
TICKS = 100


def driven(ego: str, other: str) -> DriveData:
    """The tables of one of the two: its rear axle's track, and the box of the other one."""
    time = PERIOD * np.arange(TICKS)
    axle = {"behind": 20.0 + 12.0 * time, "front": 20.0 + CAR.length + GAP + 9.0 * time}
    ticks = [
        {"time_s": t, "true_x_m": x, "true_speed_mps": SPEED[ego], "x_m": x, "s_m": x}
        for t, x in zip(time.tolist(), axle[ego].tolist(), strict=True)
    ]
    middle = axle[other] + CAR.rear_axle_to_bumper - 0.5 * CAR.length
    box = {"actor": other, "speed_mps": SPEED[other], "length_m": CAR.length, "width_m": CAR.width}
    boxes = [box | {"tick": tick, "x_m": x} for tick, x in enumerate(middle.tolist())]
    return DriveData(ticks_of(ticks), actors_of(boxes), straight(), CAR, PERIOD, ego=ego)


def test_each_ego_has_its_own_lead_and_gap() -> None:
    behind, front = driven("behind", "front"), driven("front", "behind")
    assert (behind.ego, front.ego) == ("behind", "front")
    assert set(behind.lead.actor) == {"front"}
    assert set(front.lead.actor) == {""}
    gap = GAP - 3.0 * PERIOD * (TICKS - 1)
    figures = PER_DRIVE.measure(behind)
    assert figures["min_gap_m"] == pytest.approx(gap, abs=1e-6)
    assert figures["min_ttc_s"] == pytest.approx(gap / 3.0, abs=1e-3)
    assert np.isnan(PER_DRIVE.measure(front)["min_gap_m"])


def test_both_egos_boxes_are_where_the_other_one_has_them() -> None:
    behind, front = driven("behind", "front"), driven("front", "behind")
    for one, other in ((behind, front), (front, behind)):
        boxes, rows = one.ego_boxes, other.actor_rows
        assert rows.names == [one.ego]
        np.testing.assert_allclose(boxes.x, rows.boxes.x, atol=1e-9)
        np.testing.assert_array_equal(boxes.speed, rows.boxes.speed)
