"""The decode table: a genuine packet, a made drive, and files that are not NCOM."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import pytest

from tests.pose.ncom_packets import NOTHING, START, fix_at, minute_channel, stream, with_status
from tests.pose.test_trust import drive
from vve_sumo.errors import ConfigError
from vve_sumo.pose.ncom import Encoder, Outcome, pack
from vve_sumo.pose.table import COLUMNS, rows, write_csv


@pytest.mark.parametrize("as_text", [False, True])
def test_the_genuine_packet_gives_one_row(as_text, shared_data, tmp_path):
    source = shared_data / "ncom" / "real_packet.hex"
    path = tmp_path / "packet.ncom"
    path.write_bytes(source.read_bytes() if as_text else bytes.fromhex(source.read_text()))
    (row,) = rows(path)
    assert tuple(row) == COLUMNS
    assert row["time_gps_s"] == "1192418182.913"  # 2017-10-19 03:16:22.913 GPS
    assert row["nav_status"] == "2"
    assert float(row["latitude_deg"]) == pytest.approx(37.4866782058, abs=1e-9)
    assert float(row["longitude_deg"]) == pytest.approx(-122.2181240191, abs=1e-9)
    assert float(row["altitude_m"]) == pytest.approx(1.155)
    assert row["heading_deg"] == ""
    assert (row["velocity_north_mps"], row["velocity_east_mps"]) == ("0.0091", "0.0103")
    assert row["velocity_down_mps"] == "-0.0255"
    assert row["position_mode"] == "3"
    assert row["trusted"] == "false"
    assert "status_not_locked" in row["reason"].split()


def test_a_good_drive_is_trusted_once_every_channel_was_heard(tmp_path):
    encoder = Encoder()
    path = tmp_path / "drive.ncom"
    path.write_bytes(b"".join(encoder.encode(fix) for fix in drive(120)))
    table = list(rows(path))
    assert len(table) == 120
    assert [row["trusted"] for row in table] == ["false"] * 4 + ["true"] * 116
    assert table[3]["reason"] == "corrections_old"
    assert {row["reason"] for row in table[4:]} == {""}
    assert float(table[-1]["heading_deg"]) == pytest.approx(90.0 - math.degrees(0.4), abs=1e-4)


@pytest.mark.parametrize(("heading_deg", "compass"), [(90.0, 0.0), (90.0000001, 0.0), (100.0, 350.0), (-170.0, 260.0)])
def test_heading_runs_from_0_to_360(heading_deg, compass, tmp_path):
    path = tmp_path / "one.ncom"
    path.write_bytes(pack(fix_at(START, heading=math.radians(heading_deg)), 0, minute_channel(START)))
    (row,) = rows(path)
    assert float(row["heading_deg"]) == pytest.approx(compass, abs=1e-4)
    assert 0.0 <= float(row["heading_deg"]) < 360.0


def test_only_packets_with_navigation_give_rows(tmp_path):
    packets = [pack(fix_at(START - 0.01), 16, NOTHING)]  # before the minute is known
    packets += [pack(fix_at(START), 0, minute_channel(START))]
    packets += [
        with_status(k, pack(fix_at(START + 0.01 * k), 16, NOTHING))
        for k in (0, 1, 2, 3, 4, 5, 6, 7, 10, 11, 20, 21, 22)
    ]
    packets += [pack(fix_at(START + 0.5, latitude=math.nan), 16, NOTHING)]
    path, out = tmp_path / "mixed.ncom", tmp_path / "table.csv"
    path.write_bytes(b"junk\xe7junk".join(packets))
    decoder = write_csv(path, out).decoder
    with out.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["nav_status"] for row in table] == ["4", "2", "3", "4"]
    assert decoder.counts[Outcome.TRIGGER] == 3
    assert decoder.counts[Outcome.STRUCTURE_B] == 1
    assert decoder.counts[Outcome.NO_POSITION] == 1
    assert decoder.counts[Outcome.MINUTE_UNKNOWN] == 1
    assert decoder.discarded == 9 * (len(packets) - 1)


def test_a_jump_shows_in_the_table(tmp_path):
    fixes = drive(100)
    fixes[60] = replace(fixes[60], latitude=fixes[60].latitude + 1e-6)
    encoder = Encoder()
    path = tmp_path / "jump.ncom"
    path.write_bytes(b"".join(encoder.encode(fix) for fix in fixes))
    table = list(rows(path))
    assert table[60]["reason"] == "pose_jump"
    assert table[70]["reason"] == "settling"


@pytest.mark.parametrize("data", [b"", b"hello", b"e7 but not hexadecimal", b"e7" * 80, stream(1)[0][:71]])
def test_a_file_without_a_packet_is_named_with_its_size(data, tmp_path):
    path, out = tmp_path / "nothing.ncom", tmp_path / "table.csv"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=rf"nothing\.ncom: .* in {len(data)} bytes"):
        write_csv(path, out)
    assert not out.exists()
