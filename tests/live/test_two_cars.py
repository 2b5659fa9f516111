"""Two real cars on one street: whatever part of one is lost, the other is told, and both come to rest.

The truth of both simulated vehicles says where they came to rest, each against the closed form of the layer that has
to stop it. A run that fails while the machine itself stood still says nothing and is repeated.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.exhaustive import with_slow
from tests.live.two_cars import PARTS, Outcome, TwoCars

ATTEMPTS = 4
#: how often each part is lost in `./check slow`: 20 losses
TIMES = 4


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
