"""A record replayed gives the same setpoints and frames bit for bit; a byte that was changed is found and named."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.drive.forge import cut_off
from tests.drive.street import REPOSITORY, recorded
from vve_sumo import cli
from vve_sumo.drive.replay import (
    Difference,
    changed_code,
    changed_since,
    read_car_frames,
    read_pipeline_inputs,
    recorded_scenario,
    replay,
)
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.drive.verify import altered_parts
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_parts
from vve_sumo.record.reader import read_pose_chunks, read_table

DRIVES: dict[str, dict[str, Any]] = {
    "traffic": {"road.demand": ["linden_heavy"], "duration_s": 30.0, "seed": 4},
    "emergency": {"obstacles": [{"id": "parked_car", "at_m": 120.0}], "radar.range_limit_m": 18.0, "seed": 5},
    "contact": {
        "obstacles": [{"id": "parked_car", "at_m": 90.0}],
        "radar.range_limit_m": 10.0,
        "controller.tuning": {"emergency": False},
    },
}


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Records of short drives, each made in a process of its own."""
    folder = tmp_path_factory.mktemp("records")
    return {name: recorded(tmp_path_factory, changes, folder / name) for name, changes in DRIVES.items()}


def replayed(folder: Path) -> Difference | None:
    resolved = recorded_scenario(folder, REPOSITORY)
    assert changed_since(folder, resolved) == changed_code(folder, REPOSITORY) == []
    return replay(resolved, read_pipeline_inputs(folder), read_car_frames(folder, DEFAULT_EPOCH), REPOSITORY)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("name", DRIVES)
def test_the_same_inputs_give_the_same_answers(records: dict[str, Path], name: str) -> None:
    assert replayed(records[name]) is None


def test_a_flipped_bit_of_a_pose_packet_is_found_at_its_tick(records: dict[str, Path], tmp_path: Path) -> None:
    """The packet's checksum no longer holds, so a fix is missing, and the pose of that tick differs."""
    folder = Path(shutil.copytree(records["traffic"], tmp_path / "r"))
    chunks = read_pose_chunks(folder / "pose.bin")
    number = next(n for n, (time, _data) in enumerate(chunks) if time > 20.0)
    raw = bytearray((folder / "pose.bin").read_bytes())
    raw[sum(12 + len(data) for _time, data in chunks[:number]) + 12 + 45] ^= 0x10
    (folder / "pose.bin").write_bytes(raw)
    difference = replayed(folder)
    assert difference is not None
    assert difference.number in (1000, 1001)
    assert difference.item == "x_m"


def change_line(folder: Path, identifier: str, after: float, mask: str) -> None:
    """Flip the mask's bits (hexadecimal) in the data of the first frame of an identifier after a drive time."""
    lines = (folder / "can.log").read_text(encoding="ascii").splitlines()
    number = next(
        n for n, line in enumerate(lines) if f" {identifier}#" in line and float(line[1:18]) > DEFAULT_EPOCH + after
    )
    head, _, data = lines[number].partition("#")
    flipped = bytes(a ^ b for a, b in zip(bytes.fromhex(data), bytes.fromhex(mask), strict=True))
    lines[number] = f"{head}#{flipped.hex().upper()}"
    (folder / "can.log").write_text("\n".join(lines) + "\n", encoding="ascii")


def test_a_changed_command_is_found_at_its_tick(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["traffic"], tmp_path / "r"))
    change_line(folder, "060", 12.0, "01" + 7 * "00")
    difference = replayed(folder)
    assert difference is not None
    assert (difference.number, difference.item) == (601, "frames")
    assert difference.recorded != difference.replayed


def test_a_changed_wheel_speed_changes_what_the_gateway_sends(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["traffic"], tmp_path / "r"))
    for after in (15.0, 15.011):  # two a tick, and the newer one counts
        change_line(folder, "06A", after, 4 * "2000")
    assert altered_parts(folder) == ["can.log"]
    difference = replayed(folder)
    assert difference is not None
    assert 750 <= difference.number <= 760


def test_a_byte_that_changes_no_answer_is_found_all_the_same(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    assert altered_parts(folder) == []
    raw = bytearray((folder / "pose.bin").read_bytes())
    raw[-1] ^= 1
    (folder / "pose.bin").write_bytes(raw)
    assert altered_parts(folder) == ["pose.bin"]


def test_a_byte_of_a_table_that_says_nothing_is_found_too(records: dict[str, Path], tmp_path: Path) -> None:
    """The name of the library that wrote the file: no row hangs on it."""
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    file = folder / "actors.parquet"
    before, whole = hash_parts(folder), file.read_bytes()
    at = whole.rindex(b"parquet-cpp-arrow")
    file.write_bytes(whole[:at] + b"P" + whole[at + 1 :])
    assert hash_parts(folder) == before
    assert altered_parts(folder) == ["actors"]


@pytest.mark.thorough
def test_what_was_never_finished_replays_as_far_as_its_inputs_reach(
    records: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(records["traffic"], tmp_path / "r"))
    cut_off(folder)
    assert altered_parts(folder) is None
    assert cli.main(["replay", str(folder)]) == 0
    assert "never finished" in capsys.readouterr().err
    chunks = read_pose_chunks(folder / "pose.bin")
    left = len(chunks) * 2 // 3
    raw = (folder / "pose.bin").read_bytes()
    (folder / "pose.bin").write_bytes(raw[: sum(12 + len(data) for _time, data in chunks[:left]) + 20])
    datagrams = read_table(folder, "ticks")["datagrams"].to_pylist()
    whole = sum(number <= left for number in datagrams)
    assert cli.main(["replay", str(folder)]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{whole} ticks of ")
    assert f"the last {len(datagrams) - whole} ticks come after a gap" in said.err


def test_what_is_no_record_is_one_line(records: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"scenario\.json: cannot be read"):
        recorded_scenario(tmp_path, REPOSITORY)
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    (folder / "can.log").unlink()
    with pytest.raises(ConfigError, match=r"can\.log"):
        read_car_frames(folder, DEFAULT_EPOCH)


@pytest.mark.parametrize("role", ["network", "path", "controller_speed"])
def test_a_changed_file_is_told(records: dict[str, Path], tmp_path: Path, role: str) -> None:
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    resolved = json.loads((folder / "scenario.json").read_text(encoding="utf-8"))
    resolved["files_sha256"][role] = "0" * 64
    (folder / "scenario.json").write_text(json.dumps(resolved), encoding="utf-8")
    resolved = recorded_scenario(folder, REPOSITORY)
    reported = changed_since(folder, resolved) + changed_code(folder, REPOSITORY)
    assert reported == [f"{role} has changed since"]
