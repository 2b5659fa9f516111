"""The process of the outgoing wires, fed by a drive that is late, stalls and comes back; by its own timer else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest

from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.outputs import LATE, Outputs, Wire
from vve_sumo.wire.sample import TICK, Sample, sequence_of
from vve_sumo.wire.sample_codec import pack

pytestmark = pytest.mark.live


class Echo:
    """An output whose messages are the samples themselves, and the outlet that keeps them."""

    lost = 0

    def __init__(self) -> None:
        self.sent: list[Sample] = []

    def step(self, sample: Sample) -> Sequence[Any]:
        return (sample,)

    def send(self, portions: Sequence[Any]) -> None:
        self.sent.extend(portions)

    def close(self) -> None:
        pass


@contextmanager
def running(echo: Echo) -> Iterator[tuple[Channel, float, Outputs]]:
    """A running process body; gives the drive's end of its channel and the second of drive time 0."""
    drive, theirs = pair()
    t0 = time.monotonic()
    outputs = Outputs([Wire("echo", echo, echo)], theirs, t0, 0.0)
    thread = threading.Thread(target=outputs.run)
    thread.start()
    try:
        yield drive, t0, outputs
    finally:
        drive.close()
        thread.join()


def ticks(drive: Channel, t0: float, numbers: Sequence[int], late: Callable[[int], float]) -> None:
    """Hand over the samples of these ticks, each so much after its time [s]."""
    for number in numbers:
        time.sleep(max(t0 + number * TICK + late(number) - time.monotonic(), 0.0))
        now = number * TICK
        drive.send(pack(Sample(sequence_of(now), now, now, None), actors=False))


def test_a_drive_that_is_always_late_is_spoken_for() -> None:
    """Each sample is too late to be sent, and comes before the timer would have run out after the one before it."""
    echo = Echo()
    with running(echo) as (drive, t0, outputs):
        ticks(drive, t0, range(60), lambda _: LATE + 0.01)
        assert outputs.sent == 0
        assert len(echo.sent) > 20
        assert not any(sample.valid for sample in echo.sent)


def test_sequences_rise_through_a_stall_and_the_first_sample_after_it_is_newer() -> None:
    echo = Echo()
    with running(echo) as (drive, t0, outputs):
        ticks(drive, t0, [*range(10), *range(17, 30)], lambda _: 0.0)
        assert outputs.silent >= 2
    sequences = [sample.sequence for sample in echo.sent]
    assert all(later > earlier for earlier, later in pairwise(sequences)), sequences


def test_a_tick_has_the_sequence_of_its_number() -> None:
    assert [sequence_of(number * TICK) for number in range(10_000)] == list(range(1, 10_001))
    assert [sequence_of(time) for time in (-1.0, 0.0, 0.019, 0.0201)] == [1, 1, 1, 2]
