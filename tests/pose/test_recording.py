"""Recorded drives: what is read, and that every mistake in a file is named with its line and column."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from vve_sumo.errors import ConfigError
from vve_sumo.pose.ncom import Encoder
from vve_sumo.pose.recording import fixes
from vve_sumo.values import FixQuality

HEADER = "time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n"


def written(tmp_path, text, name="drive.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_columns_are_turned_into_a_fix(tmp_path):
    path = written(tmp_path, HEADER + "100.25,40.0,-83.0,30.0,10.0\n100.5,40.1,-83.1,90.0,12.0\n")
    first, second = fixes(path)
    assert (first.time, first.time_received) == (100.25, 0.25)
    assert math.degrees(first.latitude) == pytest.approx(40.0)
    assert math.degrees(first.longitude) == pytest.approx(-83.0)
    assert math.degrees(first.heading) == pytest.approx(60.0)
    assert first.velocity_north == pytest.approx(10.0 * math.cos(math.radians(30.0)))
    assert first.velocity_east == pytest.approx(5.0)
    assert (first.acceleration, first.yaw_rate) == (0.0, 0.0)
    assert second.acceleration == pytest.approx(2.0 / 0.25)
    assert second.yaw_rate == pytest.approx(-math.radians(60.0) / 0.25)
    assert math.isnan(second.position_sigma)
    assert (second.locked, second.quality) == (False, FixQuality.UNKNOWN)


def test_column_order_extra_columns_and_a_byte_order_mark_do_not_matter(tmp_path):
    text = "\ufeffspeed_mps,heading_deg,note,longitude_deg,latitude_deg,time_s,altitude_m\n1,0,x,-83,40,5,230.5\n"
    (fix,) = fixes(written(tmp_path, text))
    assert (fix.time, fix.altitude, fix.velocity_north) == (5.0, 230.5, pytest.approx(1.0))


def test_rates_are_differenced_over_a_window_across_north(tmp_path):
    rows = [f"{k * 0.1},40,-83,{(350 + 5 * k) % 360},{5 + 0.2 * k}" for k in range(10)]
    read = list(fixes(written(tmp_path, HEADER + "\n".join(rows))))
    for fix in read[1:]:
        assert fix.acceleration == pytest.approx(2.0)
        assert fix.yaw_rate == pytest.approx(-math.radians(50.0))


def test_a_missing_heading_is_held_when_slow_and_unknown_otherwise(tmp_path):
    rows = "0,40,-83,,0\n1,40,-83,90,1\n2,40,-83,,0.5\n3,40,-83,,0\n4,40,-83,,6\n5,40,-83,90,6\n"
    headings = [fix.heading for fix in fixes(written(tmp_path, HEADER + rows))]
    assert headings[1:4] == pytest.approx([0.0] * 3, abs=1e-12)
    assert math.isnan(headings[0])
    assert math.isnan(headings[4])
    assert headings[5] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,latitude_deg,speed_mps\n", ["line 1", "longitude_deg, heading_deg"]),
        ("", ["line 1", "time_s"]),
        (HEADER, ["no row"]),
        (HEADER + "0,40,-83,0,1\n1,forty,-83,0,1\n", ["line 3", "latitude_deg", "'forty'"]),
        (HEADER + "0,nan,-83,0,1\n", ["line 2", "latitude_deg", "'nan'"]),
        (HEADER + "0,91,-83,0,1\n", ["line 2", "latitude_deg", "90"]),
        (HEADER + "0,40,-83,0,inf\n", ["line 2", "speed_mps"]),
        (HEADER + "0,40,-83,0\n", ["line 2", "speed_mps", "None"]),
        (HEADER + "0,40,-83,0,\n", ["line 2", "speed_mps", "''"]),
        (HEADER + "0,40,-83,nan,1\n", ["line 2", "heading_deg", "'nan'"]),
        (HEADER + "2,40,-83,0,1\n2,40,-83,0,1\n", ["line 3", "time_s", "does not come after"]),
        (HEADER + "2,40,-83,0,1\n1,40,-83,0,1\n", ["line 3", "time_s", "does not come after"]),
    ],
)
def test_every_mistake_is_named_in_one_line(text, words, tmp_path):
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        list(fixes(path))
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert all(word in message for word in words)


@pytest.mark.parametrize("name", ["gone.csv", "gone.ncom"])
def test_a_file_that_is_not_there_is_named(name, tmp_path):
    with pytest.raises(ConfigError, match=f"{name}: cannot be read"):
        list(fixes(tmp_path / name))


def test_raw_ncom_bytes_are_a_recording_too(tmp_path):
    rows = "".join(f"{1e9 + 0.01 * k:.2f},40,-83,10,8\n" for k in range(30))
    sent = list(fixes(written(tmp_path, HEADER + rows)))
    encoder = Encoder()
    raw = tmp_path / "drive.ncom"
    raw.write_bytes(b"".join(encoder.encode(replace(fix, locked=True)) for fix in sent))
    got = list(fixes(raw))
    assert [fix.time for fix in got] == pytest.approx([fix.time for fix in sent], abs=1e-6)
    assert [fix.time_received for fix in got] == pytest.approx([0.01 * k for k in range(30)], abs=1e-6)
    assert got[7].velocity_north == pytest.approx(sent[7].velocity_north, abs=1e-4)


def test_the_table_of_pose_decode_can_be_played(tmp_path):
    """Other names for the same columns; the speed along the heading out of two velocities, reversing negative."""
    header = (
        "time_gps_s,nav_status,latitude_deg,longitude_deg,altitude_m,heading_deg,velocity_north_mps,velocity_east_mps"
    )
    rows = [
        "100.0,4,40.0,-83.0,250.0,90.0,0.0,3.0",
        "100.1,4,40.0,-83.0,250.0,90.0,0.0,-3.0",
        "100.2,4,40,-83,250,,3,4",
    ]
    (tmp_path / "decoded.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    ahead, back, unknown = fixes(tmp_path / "decoded.csv")
    assert ahead.velocity_east == pytest.approx(3.0)
    assert back.velocity_east == pytest.approx(-3.0)
    assert ahead.time == 100.0
    assert math.isnan(unknown.heading)


def test_plain_names_are_understood(tmp_path):
    (tmp_path / "plain.csv").write_text(
        "time,latitude,longitude,heading,speed\n1.0,40.0,-83.0,0.0,2.0\n", encoding="utf-8"
    )
    (fix,) = fixes(tmp_path / "plain.csv")
    assert fix.velocity_north == pytest.approx(2.0)
