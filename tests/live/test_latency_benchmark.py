"""The latency benchmark finds a datagram's latency where it is known."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.latency import Receivers, latencies
from vve_sumo.wire.datagrams import RadarDatagram, encode_radar


def test_a_datagrams_latency_counts_from_the_fix_of_its_tick() -> None:
    due = 10.0 + 0.02 * np.arange(50)
    table = pa.table({"due_s": due, "received_s": due - 0.001, "woken_by": ["datagram"] * 49 + ["deadline"]})
    receivers = Receivers()
    receivers.heard["radar"] = [
        (500.0 + when + 0.001 * number, encode_radar(RadarDatagram(number, 9000.0 + when, 0.1, 0.0, 0.0, 0.0, ())))
        for number, when in enumerate(due)
    ]
    with receivers.listening():
        pass
    late = latencies(receivers.dated(), table, 500.0, 9000.0)
    assert late["radar"] == pytest.approx(1.0 + np.arange(49), abs=1e-3)
    assert len(late["ncom"]) == 0
