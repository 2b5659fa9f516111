"""Recordings played as a pose receiver: when what is due, and files that are refused."""

from __future__ import annotations

import math
import select
import time
from pathlib import Path

import pytest

from tests.pose.ncom_packets import stream
from tests.pose.source_reading import ready
from vve_sumo.errors import ConfigError
from vve_sumo.pose import ncom
from vve_sumo.pose.recording import fixes
from vve_sumo.pose.sources import open_file
from vve_sumo.values import FixQuality


class Hand:
    """A clock that is moved by hand."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def played(path: Path) -> list[tuple[float, float]]:
    """Rows of arrival and fix time of a recording, played in steps of 20 ms, less where it and the clock began."""
    clock = Hand()
    source, decoder, rows = open_file(path, clock), ncom.Decoder(), []
    assert not ready(source, 0.0)
    for k in range(100_000):
        clock.now = 100.0 + k * 0.02
        for received, data in source.receive():
            assert received <= clock.now
            rows += [(received - 100.0, fix.time) for fix in decoder.feed(data, received)]
        if source.lost:
            break
        assert source.next_due() > clock.now
    assert source.next_due() == math.inf
    assert source.receive() == []
    source.close()
    return [(received, moment - rows[0][1]) for received, moment in rows]


@pytest.mark.parametrize("before", [b"", b"garbage", b"\xe7" * 100])
def test_ncom_bytes_are_released_when_their_fixes_are_due(tmp_path, before):
    path = tmp_path / "drive.ncom"
    path.write_bytes(before + b"".join(stream(300)))
    rows = played(path)
    assert len(rows) == 300
    assert all(received == pytest.approx(0.01 * k, abs=1e-6) for k, (received, _) in enumerate(rows))
    assert all(received == pytest.approx(moment, abs=1e-6) for received, moment in rows)


@pytest.mark.parametrize("begin", [0.0, -3.0, 1.3e9, 1.7e15])
def test_a_csv_is_played_as_ncom_whatever_its_seconds_count_from(tmp_path, begin):
    path = tmp_path / "drive.csv"
    rows = "".join(f"{begin + k * 0.25},{40 + k * 1e-5},-83,0,4.5\n" for k in range(40))
    path.write_text("time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n" + rows)
    arrivals, moments = zip(*played(path), strict=True)
    assert arrivals == moments == pytest.approx([0.25 * k for k in range(40)], abs=1e-6)
    clock = Hand()
    source = open_file(path, clock)
    ((_, data),) = source.receive()
    source.close()
    (fix,) = ncom.Decoder().feed(data, 0.0)
    original = next(fixes(path))
    assert (fix.latitude, fix.longitude) == (original.latitude, original.longitude)
    assert fix.velocity_north == pytest.approx(4.5)
    assert (fix.locked, fix.quality) == (True, FixQuality.UNKNOWN)
    assert math.isnan(fix.pitch)


def test_a_recording_plays_in_real_time(tmp_path):
    path = tmp_path / "drive.ncom"
    path.write_bytes(b"".join(stream(30)))
    source, begin, count = open_file(path), time.monotonic(), 0
    while not source.lost:
        select.select([source.fileno()], [], [], max(0.0, source.next_due() - time.monotonic()))
        count += len(source.receive())
    assert count == 30
    assert time.monotonic() - begin > 0.28
    source.close()


def test_a_file_that_is_no_recording_is_refused_before_anything_plays(tmp_path):
    path = tmp_path / "drive.ncom"
    path.write_bytes(b"nothing of the kind" * 100)
    with pytest.raises(ConfigError, match="no NCOM packet"):
        open_file(path)
    with pytest.raises(ConfigError, match="cannot be read"):
        open_file(tmp_path / "absent.ncom")
    late = tmp_path / "late.csv"
    late.write_text("time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n0,40,-83,0,1\n1,40,x,0,1\n")
    with pytest.raises(ConfigError, match="line 3, column longitude_deg"):
        open_file(late)
