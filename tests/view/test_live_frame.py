"""What a live drive's frame says of values that are no longer those of the present."""

from __future__ import annotations

import json
from dataclasses import replace

from tests.view.feed import sample
from tests.view.made import Made
from vve_sumo.pose.trust import REASONS
from vve_sumo.view.live_frame import LiveFrames


def test_a_position_without_new_fixes_is_not_called_good(made: Made) -> None:
    resolved = json.loads((made.drive / "scenario.json").read_text(encoding="utf-8"))
    frames = LiveFrames(resolved, lambda status: str(status["state"]))
    said = []
    for tick, faults in enumerate(((), ("pose_stale",), ())):
        frames.take(replace(sample(tick), faults=faults))
        frame = frames.frame()
        assert frame is not None
        said.append(frame["quality"])
    assert said[0] == said[2]
    assert "cm" in said[0]
    assert said[1] == f"refused: {REASONS['pose_stale']}"
