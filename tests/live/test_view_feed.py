"""Whatever goes wrong with a tick's sample for the page, the drive hears nothing of it, and sends no more."""

from __future__ import annotations

from typing import Any, cast

from vve_sumo.drive.tick import CompletedTick
from vve_sumo.live.channel import pair
from vve_sumo.live.view_feed import SampleContext, ViewFeed


def test_a_sample_that_cannot_be_made_ends_the_feed_and_nothing_else() -> None:
    ours, theirs = pair()
    feed = ViewFeed(ours)
    asked = []

    def beside() -> SampleContext:
        asked.append(True)
        raise ZeroDivisionError

    for _ in range(3):
        feed.send(cast(CompletedTick, cast(Any, None)), beside)
    assert asked == [True]
    assert theirs.receive() == []
    assert theirs.closed
