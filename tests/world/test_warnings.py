"""What SUMO warns of is true: a car that stands on a route that is a loop has not moved by the length of the loop."""

from __future__ import annotations

import pytest

from tests.drive.street import drive_once
from tests.isolated import isolated
from vve_sumo.world.world import is_true

MOVED = "Warning: Vehicle 'ego' moved by TraCI from {} to {} (dist {}) with implied speed of {} (exceeding maximum)."


@pytest.mark.parametrize(
    ("warning", "true"),
    [
        (MOVED.format("463.92,348.64", "463.92,348.64", "4288.29", "214414.50"), False),
        (MOVED.format("463.92,348.64", "463.92,348.65", "4288.29", "214414.45"), False),
        (MOVED.format("0.00,0.00", "30.00,40.00", "50.00", "2500.00"), True),  # 3, 4, 5
        (MOVED.format("-30.00,0.00", "0.00,40.00", "52.50", "2625.00"), True),
        ("Warning: Vehicle 'truck.56' performs emergency braking on lane ':229685459_4_0' with decel=7.00.", True),
        ("Warning: Vehicle 'sedan.7' has no valid route from edge 'a' to edge 'b'.", True),
    ],
)
def test_a_move_is_true_if_it_is_as_long_as_it_is_far(warning: str, true: bool) -> None:
    assert is_true(warning) is true


def _waits_on_the_loop() -> list[str]:
    changes = {"ego.path": "linden_loop", "road.demand": [], "obstacles": [], "duration_s": 1.0}
    return list(drive_once(changes)["sumo_warnings"])


@pytest.mark.thorough
def test_a_car_that_waits_on_a_loop_is_warned_of_by_nobody() -> None:
    assert isolated(_waits_on_the_loop) == []
