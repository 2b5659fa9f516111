"""What a wire says of signals during a drive is what the drive's record says that they showed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from vve_sumo.drive.brain import external_controller
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.drive.run import resolve_by_name, run
from vve_sumo.frames import Mounting
from vve_sumo.record.signals import read_signals
from vve_sumo.wire.sample import Sample


class Kept:
    """The way to a brain that keeps what it is sent and never answers."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []

    def send(self, sample: Sample) -> None:
        self.samples.append(sample)

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        return ()


@pytest.mark.parametrize("tells", [True, False])
def test_a_sample_has_what_the_signals_show_at_its_tick(repository: Path, tmp_path: Path, tells: bool) -> None:
    values = {"duration_s": 12.0}
    resolved, link = resolve_by_name("crossing_at_signal", repository, values=values), Kept()
    brain = external_controller("own", link, resolved.map_frame, Mounting(0.0, 0.0), DEFAULT_EPOCH, needs_signals=tells)
    run(resolved, tmp_path / "drive", repository, brain=brain)
    recorded = read_signals(tmp_path / "drive")
    valid = [sample for sample in link.samples if sample.measured is not None]
    assert len(valid) > 500
    changes = 0
    for sample in valid:
        assert sample.measured is not None
        if not tells:
            assert not sample.measured.signals
            continue
        for name, (times, states) in recorded.items():
            if sample.drive_time < times[0] - 1e-9:
                assert name not in sample.measured.signals
                continue
            now = max(number for number, time in enumerate(times) if time <= sample.drive_time + 1e-9)
            shown = sample.measured.signals[name]
            assert shown.state == states[now]
            if now + 1 < len(times):
                assert sample.drive_time + shown.remaining == pytest.approx(times[now + 1], abs=1e-6)
                changes += 1
    assert bool(changes) is tells
