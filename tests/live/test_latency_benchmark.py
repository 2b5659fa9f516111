"""The latency benchmark runs from end to end, and finds a datagram's latency where it is known."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.latency import Receivers
from tests.conftest import REPOSITORY
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
    late = receivers.latencies(table, 500.0, 9000.0)
    assert late["radar"] == pytest.approx(1.0 + np.arange(49), abs=1e-3)
    assert len(late["ncom"]) == 0


@pytest.mark.live
def test_the_benchmark_hears_both_wires() -> None:
    command = [sys.executable, "benchmarks/latency.py", "--smoke"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    for kind in ("ncom", "radar"):
        found = re.search(rf"fix to {kind}: median ([\d.]+) ms, p99 [\d.]+ ms, (\d+) datagrams", done.stdout)
        assert found is not None, done.stdout
        assert 0.0 < float(found[1]) < 100.0
        assert int(found[2]) > 50
    assert "0 vehicles, outputs over 0 vehicles, p50 of the total: " in done.stdout
