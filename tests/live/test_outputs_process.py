"""The process of the outgoing wires, fed by a drive that is late, stalls and comes back; by its own timer else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.drive.brain import Publisher, virtual_placement
from vve_sumo.frames import Mounting, local_frame
from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.outputs import SAMPLE_TIMEOUT, Outputs, OutputWire
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, Point, Pose
from vve_sumo.wire.sample import NO_SCAN, Sample, SampleContent, no_fix, sequence_of
from vve_sumo.wire.sample_codec import encode_sample

pytestmark = pytest.mark.live
NOBODY = Actors.none(0.0)
POSE = Pose(0.0, Point.REAR_AXLE, *(0.0 for _ in range(8)))
VALID = Sample(1, 0.0, 0.0, SampleContent(no_fix(0.0, 0.0), POSE, NO_SCAN, 0.0, NOBODY))
PLACEMENT = virtual_placement(local_frame(0.7, -1.4), Mounting(0.0, 0.0), 0.0)


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
    outputs = Outputs([OutputWire("echo", echo, echo)], theirs, t0, 0.0)
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
        time.sleep(max(t0 + number * PERIOD + late(number) - time.monotonic(), 0.0))
        now = number * PERIOD
        drive.send(encode_sample(Sample(sequence_of(now), now, now, None), actors=False))


def test_a_drive_that_is_always_late_is_spoken_for() -> None:
    """Each sample is too late to be sent, and comes before the timer would have run out after the one before it."""
    echo = Echo()
    with running(echo) as (drive, t0, outputs):
        ticks(drive, t0, range(60), lambda _: SAMPLE_TIMEOUT + 0.01)
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


class Failing(Echo):
    """An output that cannot say anything but invalid."""

    def step(self, sample: Sample) -> Sequence[Any]:
        if sample.valid:
            raise ZeroDivisionError
        return super().step(sample)


def test_an_encoder_that_fails_says_invalid_and_the_other_wires_go_on(capfd: pytest.CaptureFixture[str]) -> None:
    drive, theirs = pair()
    failing, echo = Failing(), Echo()
    wires = [OutputWire("failing", failing, failing), OutputWire("echo", echo, echo)]
    outputs = Outputs(wires, theirs, time.monotonic(), 0.0)
    drive.send(encode_sample(VALID, actors=False))
    drive.close()
    outputs.run()
    assert [sample.valid for sample in echo.sent][:1] == [True]
    assert failing.sent
    assert failing.sent[0].sequence == VALID.sequence
    assert not any(sample.valid for sample in failing.sent)
    assert capfd.readouterr().err.count("ZeroDivisionError") == 1


@given(st.floats(-0.02, 0.02), st.lists(st.floats(-0.004, 0.004), min_size=2, max_size=50))
def test_sequences_rise_whatever_the_phase_of_the_receiver(phase: float, jitter: list[float]) -> None:
    """Ticks that keep to a receiver's clock, which is off from ours and estimated with jitter."""
    sent: list[int] = []
    publisher = Publisher(lambda sample: sent.append(sample.sequence), PLACEMENT, 0.0)
    times = [5.0 + phase + number * PERIOD + early for number, early in enumerate(jitter)]
    for now in times:
        publisher.publish(now, None, ())
    assert all(later > earlier for earlier, later in pairwise(sent))
    assert all(0 <= given_ - sequence_of(now) <= 1 for given_, now in zip(sent, times, strict=True))


def test_a_tick_has_the_sequence_of_its_number() -> None:
    assert [sequence_of(number * PERIOD) for number in range(10_000)] == list(range(1, 10_001))
    assert [sequence_of(time) for time in (-1.0, 0.0, 0.019, 0.0201)] == [1, 1, 1, 2]
