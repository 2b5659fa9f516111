"""CAN logs as python-can and asammdf read them, against the frames that the record was written from."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import NamedTuple

import asammdf
import can
import pytest

from tests.analysis.made import put
from tests.export.made import EPOCH, FRAMES, PERIOD, UNIX_EPOCH, record
from vve_sumo.analysis import Run
from vve_sumo.cli import main
from vve_sumo.export.write import export


class Read(NamedTuple):
    """A frame as a log has it."""

    microseconds: int  #: since drive time 0
    channel: int
    id: int
    data: bytes
    sent: bool


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("can") / "mine", {"outcome": "timeout"})


def by_python_can(file: Path) -> list[Read]:
    # ASC files count from the first frame unless the reader is told otherwise.
    options = {"relative_timestamp": False} if file.suffix == ".asc" else {}
    with can.LogReader(file, **options) as reader:
        found = list(reader)
    assert all(not (one.is_extended_id or one.is_remote_frame or one.is_error_frame or one.is_fd) for one in found)
    assert all(one.dlc == len(one.data) for one in found)
    return [
        Read(round(1e6 * (one.timestamp - UNIX_EPOCH)), one.channel, one.arbitration_id, bytes(one.data), not one.is_rx)
        for one in found
    ]


def by_asammdf(file: Path) -> list[Read]:
    with asammdf.MDF(file) as mdf:
        assert mdf.version == "4.10"
        late = mdf.header.start_time.timestamp() - UNIX_EPOCH
        found = mdf.get("CAN_DataFrame")
    rows = {name.partition(".")[2]: found.samples[name].tolist() for name in found.samples.dtype.names}
    assert rows["DLC"] == rows["DataLength"]
    assert not any(rows["IDE"] + rows["EDL"] + rows["BRS"] + rows["ESI"])
    columns = (rows[name] for name in ("BusChannel", "ID", "DataBytes", "DataLength", "Dir"))
    return [
        Read(round(1e6 * (late + at)), bus - 1, name, bytes(data[:length]), bool(sent))
        for at, bus, name, data, length, sent in zip(found.timestamps.tolist(), *columns, strict=True)
    ]


#: formats with what reads them. python-can cannot read MF4 here: the bus imports it as if there were no asammdf.
READERS = {"asc": by_python_can, "blf": by_python_can, "mf4": by_asammdf}


def as_written() -> list[Read]:
    channels = {"can0": 0, "can1": 1}
    return [Read(round(1e6 * time), channels[bus], name, data, sent) for time, bus, name, data, sent in FRAMES]


@pytest.mark.parametrize("form", READERS)
def test_every_frame_comes_back(folder: Path, form: str, tmp_path: Path) -> None:
    (file,) = export(Run(folder), form, tmp_path)
    assert file.name == f"mine.{form}"
    assert READERS[form](file) == as_written()


@pytest.mark.parametrize("form", READERS)
def test_a_drive_may_begin_within_a_millisecond(form: str, tmp_path: Path) -> None:
    """As live drives do: milliseconds below 100, and microseconds beside them."""
    late = 0.065304
    (file,) = export(Run(record(tmp_path / "live", {"outcome": "timeout"}, epoch_gnss_s=EPOCH + late)), form, tmp_path)
    shifted = [one._replace(microseconds=one.microseconds + round(1e6 * late)) for one in as_written()]
    assert READERS[form](file) == shifted


def test_asammdf_knows_the_frames_as_those_of_buses(folder: Path, tmp_path: Path) -> None:
    with asammdf.MDF(export(Run(folder), "mf4", tmp_path)[0]) as mdf:
        events = mdf.bus_logging_map["CAN"]
    assert {int(bus): set(names) for bus, names in events.items()} == {1: {0x60, 0x7FF}, 2: {0x61, 0x64}}


@pytest.mark.thorough
@pytest.mark.parametrize("form", READERS)
def test_the_same_record_has_the_same_bytes_at_another_moment(folder: Path, form: str, tmp_path: Path) -> None:
    first = export(Run(folder), form, tmp_path / f"a.{form}")[0].read_bytes()
    time.sleep(1.1)  # the formats date files to the second
    assert export(Run(folder), form, tmp_path / f"b.{form}")[0].read_bytes() == first


def test_the_head_of_an_asc_file_dates_the_drive(folder: Path, tmp_path: Path) -> None:
    (file,) = export(Run(folder), "asc", tmp_path)
    (head,) = re.findall(r"^date (.*)$", file.read_text(), re.MULTILINE)
    said = time.mktime(time.strptime(head, "%a %b %d %H:%M:%S.0 %Y"))
    assert said == UNIX_EPOCH


def test_a_live_drive_counted_what_it_heard_and_sent(tmp_path: Path) -> None:
    folder = record(tmp_path / "live", {"outcome": "timeout"})
    counts = [(3, 1), (0, 0), (0, 4), (2, 0)]
    put(folder, "gateway", (
        {"step": number, "time_s": number * PERIOD, "setpoint": b"", "operator_command": "", "process_faults": "",
         "frames_received": heard, "frames_sent": sent, "sequence": 0, "state": "engaged", "reasons": "",
         "limited": "", "steering_rad": 0.0, "granted_acceleration_mps2": 0.0, "brake_torque_nm": 0.0,
         "throttle_percent": 0.0, "measured_steering_rad": 0.0, "wheel_speed_mps": 0.0, "gear": "drive"}
        for number, (heard, sent) in enumerate(counts)
    ))  # fmt: skip
    (file,) = export(Run(folder), "blf", tmp_path)
    read = by_python_can(file)
    # What came after the last step belongs to none.
    assert [one.sent for one in read] == [False] * 3 + [True] * 5 + [False] * 2
    assert [one._replace(sent=False) for one in read] == [one._replace(sent=False) for one in as_written()[:10]]


def test_a_killed_drive_has_the_frames_up_to_its_last_whole_tick(tmp_path: Path) -> None:
    (file,) = export(Run(record(tmp_path / "killed", None, ticks=100)), "asc", tmp_path)
    expected = [one for one in as_written() if one.microseconds <= round(1e6 * 99 * PERIOD)]
    assert 0 < len(expected) < len(FRAMES)
    assert by_python_can(file) == expected


@pytest.mark.parametrize("form", READERS)
def test_a_log_without_frames_is_empty(form: str, tmp_path: Path) -> None:
    folder = record(tmp_path / "mine", {"outcome": "timeout"})
    (folder / "can.log").write_text("")
    (file,) = export(Run(folder), form, tmp_path)
    assert READERS[form](file) == []


@pytest.mark.parametrize(
    ("content", "complaint"),
    [(None, "can.log: No such file or directory"), ("(1.0) can0 nonsense\n", "can.log: not a candump log after 0")],
)
def test_a_log_that_cannot_be_read_is_one_line(
    content: str | None, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = record(tmp_path / "mine", {"outcome": "timeout"})
    (folder / "can.log").unlink()
    if content is not None:
        (folder / "can.log").write_text(content)
    assert main(["export", str(folder), "blf", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vve-sumo: {folder / complaint}")
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


def test_times_are_those_of_utc() -> None:
    """GNSS time began on 1980-01-06 and is 18 s ahead of UTC since 2017."""
    assert time.gmtime(UNIX_EPOCH)[:6] == (2026, 1, 1, 0, 0, 0)
    assert time.gmtime(315_964_800 + EPOCH - 18.0)[:6] == (2026, 1, 1, 0, 0, 0)
