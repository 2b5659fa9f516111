"""Logs of every receiver: which format a file has, its table, and its playback."""

from __future__ import annotations

import csv
import math
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.pose import nmea_sentences
from tests.pose.test_recording_source import played
from tests.pose.test_trust import EPOCH, drive
from vve_sumo.errors import ConfigError
from vve_sumo.pose import ncom, nmea_encoder, novatel_encoder, sbf_encoder, ubx_encoder
from vve_sumo.pose.log_formats import FORMATS, format_of
from vve_sumo.pose.receivers.port import FixEncoder, configured
from vve_sumo.pose.recording import fixes
from vve_sumo.pose.sources import open_file
from vve_sumo.pose.table import COLUMNS, rows, write_csv
from vve_sumo.pose.trust import TrustGate

ENCODERS: dict[str, Callable[[], FixEncoder]] = {
    "OXTS NCOM": ncom.Encoder,
    "u-blox UBX": ubx_encoder.Encoder,
    "Septentrio SBF": sbf_encoder.Encoder,
    "NovAtel OEM7": novatel_encoder.Encoder,
    "NMEA 0183": nmea_encoder.Encoder,
}
NAMES = list(ENCODERS)


def log(name: str, count: int = 120) -> bytes:
    encoder = ENCODERS[name]()
    return b"".join(encoder.encode(fix) for fix in drive(count))


def test_every_format_is_tried_here() -> None:
    assert {one.name for one in FORMATS} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("before", [b"", b"\x00" * 700, random.Random(1).randbytes(3000)])
def test_a_format_is_recognised_by_the_content(name: str, before: bytes) -> None:
    found = format_of(before + log(name, 20))
    assert found is not None
    assert found.name == name


def test_of_several_formats_the_one_that_gives_fixes_is_taken() -> None:
    """A u-blox receiver sends NMEA beside UBX as it leaves the factory, without a heading."""
    sentences = b"".join(data for _at, data in nmea_sentences.drive(20) if b"HDT" not in data)
    found = format_of(sentences + log("u-blox UBX", 5))
    assert found is not None
    assert found.name == "u-blox UBX"


@pytest.mark.parametrize("data", [b"", b"hello", random.Random(2).randbytes(20_000)])
def test_what_is_no_log_has_no_format(data: bytes) -> None:
    assert format_of(data) is None


@pytest.mark.parametrize("name", NAMES)
def test_the_table_of_a_log(name: str, tmp_path: Path) -> None:
    path, out = tmp_path / "drive.log", tmp_path / "fixes.csv"
    path.write_bytes(b"noise" + log(name) + b"noise")
    found = write_csv(path, out)
    assert found.format.name == name
    assert found.decoder.discarded == len(b"noise" * 2)
    with out.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == COLUMNS
    wanted = drive(120)[-len(table) :]
    assert len(table) >= 118
    for row, fix in zip(table, wanted, strict=True):
        assert float(row["time_gps_s"]) == pytest.approx(fix.time, abs=6e-4)
        assert float(row["latitude_deg"]) == pytest.approx(math.degrees(fix.latitude), abs=1e-7)
        assert float(row["heading_deg"]) == pytest.approx(90.0 - math.degrees(fix.heading), abs=1e-3)
    assert {row["quality"] for row in table[5:]} == {"RTK fixed"}
    assert {row["nav_status"] for row in table} == ({"4"} if name == "OXTS NCOM" else {""})
    against = {code for row in table[10:] for code in row["reason"].split()}
    # The accuracies that a rig declares of NMEA are in no file.
    assert against == ({"velocity_sigma", "heading_sigma"} if name == "NMEA 0183" else set())


CAR: dict[str, Any] = {"minimum_delay_ms": 10.0}
RECEIVERS: dict[str, dict[str, Any]] = {
    "OXTS NCOM": {"kind": "ncom_udp"},
    "u-blox UBX": {"kind": "ubx_udp"},
    "Septentrio SBF": {"kind": "sbf_tcp"},
    "NovAtel OEM7": {"kind": "novatel_serial", "device": "/dev/ttyS0"},
    "NMEA 0183": {"kind": "nmea_tcp", "velocity_sigma_mps": 0.04, "heading_sigma_deg": 0.2},
}


@pytest.mark.parametrize("name", NAMES)
def test_a_log_with_its_receiver_is_what_the_live_receiver_took(name: str, tmp_path: Path) -> None:
    """The same bytes in datagrams with their arrivals, by decoder and gate of a live drive, and as a file."""
    receiver, encoder = configured(RECEIVERS[name] | CAR), ENCODERS[name]()
    path = tmp_path / "drive.log"
    sent = [(fix.time - EPOCH + 0.01, encoder.encode(fix)) for fix in drive(250)]
    path.write_bytes(b"".join(data for _at, data in sent))
    decoder, gate = receiver.decoder(), TrustGate(receiver.profile, EPOCH)
    live = [fix for at, data in sent for fix in decoder.feed(data, at)]
    judged = [gate.step(fix.time_received, fix) for fix in live]
    table = list(rows(path, receiver))
    assert len(table) == len(live) >= 240
    for row, fix, trust in zip(table, live, judged, strict=True):
        assert row["time_gps_s"] == f"{fix.time:.3f}"
        assert row["latitude_deg"] == f"{math.degrees(fix.latitude):.10f}"
        assert row["longitude_deg"] == f"{math.degrees(fix.longitude):.10f}"
        assert row["velocity_north_mps"] == f"{fix.velocity_north:.4f}"
        for column, value in (
            ("position_sigma_m", fix.position_sigma),
            ("velocity_sigma_mps", fix.velocity_sigma),
            ("heading_sigma_deg", math.degrees(fix.heading_sigma)),
        ):
            assert row[column] == ("" if math.isnan(value) else f"{value:.4f}")
        assert row["trusted"] == ("true" if trust.trusted else "false")
        assert row["reason"] == " ".join(trust.reasons)
    assert table[-1]["trusted"] == "true"
    if name == "NMEA 0183":
        assert (table[-1]["velocity_sigma_mps"], table[-1]["heading_sigma_deg"]) == ("0.0400", "0.2000")


def test_every_receiver_of_a_log_has_a_row_above() -> None:
    assert {*RECEIVERS} == {*NAMES}


def test_a_log_of_another_receiver_than_the_rigs_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_bytes(log("NMEA 0183"))
    with pytest.raises(ConfigError, match=r"drive\.log: it is NMEA 0183, expected u-blox UBX by the rig's pose\.kind$"):
        write_csv(path, tmp_path / "fixes.csv", configured(RECEIVERS["u-blox UBX"] | CAR))
    assert not (tmp_path / "fixes.csv").exists()


@pytest.mark.parametrize("table", [{"kind": "file", "file": "a.ncom"}, {"kind": "oxts_can", "interface": "socketcan"}])
def test_a_receiver_without_logs_is_one_line(table: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_bytes(log("OXTS NCOM"))
    more = {} if table["kind"] == "file" else {"channel": "can1", **CAR}
    with pytest.raises(ConfigError, match=r"pose\.kind sends no log that is read, expected a receiver with OXTS NCOM"):
        list(rows(path, configured(table | more)))


@pytest.mark.parametrize("name", [name for name in NAMES if name != "OXTS NCOM"])
def test_a_log_is_played_as_ncom(name: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_bytes(log(name))
    original = list(fixes(path))
    assert original[0].time_received == pytest.approx(original[0].time % 1.0)
    arrivals, moments = zip(*played(path), strict=True)
    assert len(moments) == len(original)
    assert arrivals == pytest.approx(moments, abs=1e-3)
    assert moments == pytest.approx([fix.time - original[0].time for fix in original], abs=2e-3)


def test_a_file_that_is_no_log_names_every_format(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ConfigError) as refused:
        list(rows(path))
    messages = "NCOM packet, UBX message, SBF block, NovAtel log or NMEA sentence"
    assert str(refused.value) == f"{path}: no {messages} with a right checksum in 19 bytes"


@pytest.mark.parametrize("name", NAMES)
def test_a_log_without_a_position_plays_nothing(name: str, tmp_path: Path) -> None:
    encoder, path = ENCODERS[name](), tmp_path / "drive.log"
    path.write_bytes(b"".join(encoder.encode(replace(fix, latitude=math.nan)) for fix in drive(20)))
    with pytest.raises(ConfigError, match="no fix with a time and a position"):
        open_file(path)
    assert list(rows(path)) == []
