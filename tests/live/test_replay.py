"""Live records replayed: bit for bit the same, whatever went wrong in the drive; what was altered is found and named.

The drives are real and the machine may be busy, so none is judged by how it ended: whatever happened, the record must
replay.
"""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.conftest import REPOSITORY
from tests.drive.forge import change_json, seal_again
from tests.exhaustive import with_slow
from tests.live.records import PATIENCE, Drive, begin
from tests.live.witness import stalls, witness
from tests.record.declared import LIVE_TABLES
from vve_sumo import cli
from vve_sumo.bus import read_log
from vve_sumo.drive import run as drives
from vve_sumo.drive.lockstep import DriveEnd
from vve_sumo.drive.summary import summarise
from vve_sumo.drive.termination import Outcome
from vve_sumo.drive.verify import altered_parts
from vve_sumo.errors import ConfigError
from vve_sumo.live.assembly import from_dict
from vve_sumo.live.replay import read_live_inputs, replay_drive, replay_gateway
from vve_sumo.plotting.drive_record import draw_drive
from vve_sumo.record.hashes import hash_parts, whole
from vve_sumo.record.reader import read_pose_chunks, read_table
from vve_sumo.record.summary import write_summary
from vve_sumo.values import Setpoint
from vve_sumo.vehicle import link

pytestmark = pytest.mark.live

PARTS = (
    "scenario.json",
    "pose.bin",
    "can.log",
    "ticks",
    "actors",
    "readings",
    "sensor_radar",
    "gateway",
    "provenance.json",
)
#: that a kill may lose [s]
MOST_LOST = 0.2
#: drives until one shows its fault; on a machine that is busy one may stop before
TRIES = 4


def reasons(folder: Path) -> set[str]:
    """Return every reason that the gateway gave."""
    return {code for said in read_table(folder, "gateway")["reasons"].to_pylist() for code in said.split("+")}


def drove(folder: Path) -> bool:
    """Whether the car drove."""
    return float(np.nanmax(read_table(folder, "gateway")["wheel_speed_mps"].to_numpy())) > 2.0


def came_in_bursts(folder: Path) -> bool:
    """Whether fixes came together, and long after those before."""
    apart = np.diff([time for time, _data in read_pose_chunks(folder / "pose.bin")])
    return int(np.sum(apart > 0.03)) > 20 and int(np.sum(apart < 0.002)) > 60


def went_blind(folder: Path) -> bool:
    """Whether the newest fix grew old."""
    return float(np.nanmax(read_table(folder, "ticks")["pose_age_s"].to_numpy())) > 0.5


#: what is put on, and what the record shows of it
FAULTS: dict[str, tuple[tuple[str, ...], Callable[[Path], bool]]] = {
    "nominal": ((), drove),
    "pose_bursts": (('kind = "pose_bursts"\nat_s = 1.0',), came_in_bursts),
    "pose_lost": (('kind = "pose_lost"\nat_s = 3.0',), went_blind),
    "brake_override": (('kind = "brake_override"\nat_s = 3.0',), lambda folder: "driver_override" in reasons(folder)),
    "another_writer": (('kind = "another_writer"\nat_s = 3.0',), lambda folder: "another_writer" in reasons(folder)),
}


#: what is driven each time; the others go through the same tables, and `./check slow` drives them
USUAL = {"nominal", "pose_lost"}


@contextmanager
def driving(folder: Path, *faults: str) -> Iterator[Drive]:
    """Have a live drive going on, and nothing of it left."""
    drive = begin(folder, *faults)
    try:
        yield drive
    finally:
        drive.clear()


class Records(dict[str, list[Path]]):
    """Records of live drives by what went wrong in them, the last of each showing it; each is driven on first use."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def __missing__(self, name: str) -> list[Path]:
        faults, shows = FAULTS[name]
        made: list[Path] = []
        for number in range(TRIES):
            with driving(self._folder / f"{name}_{number}", *faults) as drive:
                drive.console.wait(PATIENCE)
            said = (drive.folder.parent / "said.txt").read_text(encoding="utf-8")
            if not (drive.folder / "gateway.parquet").exists():
                continue  # refused, such as by a machine that is too busy
            made.append(drive.folder)
            if shows(drive.folder):
                self[name] = made
                return made
        raise AssertionError(f"{name} never showed: {said}")


@pytest.fixture(scope="session")
def records(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """Records of live drives."""
    return Records(tmp_path_factory.mktemp("live"))


def replayed(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Return exit code, output and notes of the command."""
    code = cli.main(["replay", str(folder)])
    said = capsys.readouterr()
    return code, said.out, said.err


@pytest.mark.parametrize("name", with_slow(FAULTS, lambda name: name in USUAL, "nominal".__eq__))
def test_a_live_record_replays_bit_for_bit(records: Records, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in records[name]:
        code, said, notes = replayed(folder, capsys)
        ticks, steps = (read_table(folder, table).num_rows for table in ("ticks", "gateway"))
        assert f"{ticks} ticks and {steps} steps of the gateway" in said
        assert "every setpoint and every frame is the same" in said
        assert notes == ""
        assert code == 0


def test_the_gateway_was_handed_what_the_drive_computed(records: Records) -> None:
    """Else the replay would compare nothing: setpoints arrive, and carry the ticks' own numbers."""
    folder = records["nominal"][-1]
    asked = {row["acceleration_setpoint_mps2"] for row in read_table(folder, "ticks").to_pylist()}
    rows = [row for row in read_table(folder, "gateway").to_pylist() if row["setpoint"]]
    came = [link.decode_setpoint(row["setpoint"]) for row in rows]
    assert len(came) > 100
    assert all(isinstance(one, Setpoint) and one.acceleration in asked for one in came)


# What was altered.


@pytest.fixture
def copy(records: Records, tmp_path: Path) -> Path:
    """A copy of a record to be altered."""
    return Path(shutil.copytree(records["nominal"][-1], tmp_path / "r"))


def file_of(folder: Path, part: str) -> Path:
    """Return the file of a part."""
    return folder / part if "." in part else folder / f"{part}.parquet"


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize("part", PARTS)
def test_a_flipped_byte_is_found_and_its_part_named(copy: Path, part: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = file_of(copy, part)
    whole = file.read_bytes()
    random = np.random.default_rng(len(whole))
    for at in (0, len(whole) - 1, *random.integers(len(whole), size=25).tolist()):
        altered = bytearray(whole)
        altered[at] ^= 1 << int(random.integers(8))
        file.write_bytes(altered)
        assert altered_parts(copy) == [part], f"byte {at}"
    for at in (len(whole) // 3, len(whole) - 9):
        altered = bytearray(whole)
        altered[at] ^= 0x04
        file.write_bytes(altered)
        code, said, _notes = replayed(copy, capsys)
        assert code == 1
        assert said.startswith(f"{part} is not as the drive left it")
    file.write_bytes(whole)
    assert replayed(copy, capsys)[0] == 0


def test_a_latency_is_no_part_of_what_was_driven(copy: Path) -> None:
    """Its file is guarded, the record's hash is without it."""
    table = pq.read_table(copy / "latency.parquet")
    before = hash_parts(copy)
    pq.write_table(table.slice(1), copy / "latency.parquet")
    assert hash_parts(copy) == before
    assert altered_parts(copy) == ["latency"]


def test_a_changed_packet_is_found_at_its_tick(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chunks = read_pose_chunks(copy / "pose.bin")
    ticks = read_table(copy, "ticks").to_pylist()
    middle = next(row for row in ticks if row["datagrams"] > len(chunks) // 2)
    tick, number = middle["tick"], middle["datagrams"] - 1  # of those that come together, the last one counts
    raw = bytearray((copy / "pose.bin").read_bytes())
    raw[sum(12 + len(data) for _time, data in chunks[:number]) + 12 + 45] ^= 0x10
    (copy / "pose.bin").write_bytes(raw)
    seal_again(copy)
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    assert said.startswith(f"tick {tick} ")


def lines_of_steps(folder: Path) -> list[int]:
    """Return how many lines of can.log there are up to the end of each step."""
    rows = read_table(folder, "gateway").to_pylist()
    return list(accumulate(row["frames_received"] + row["frames_sent"] for row in rows))


def flip_line(folder: Path, number: int, digit: int) -> None:
    """Flip a bit of a digit of the data in a line of can.log."""
    lines = (folder / "can.log").read_text(encoding="ascii").splitlines(keepends=True)
    head, _, data = lines[number].partition("#")
    lines[number] = f"{head}#{data[:digit]}{int(data[digit], 16) ^ 1:X}{data[digit + 1 :]}"
    (folder / "can.log").write_text("".join(lines), encoding="ascii")


def test_a_changed_command_is_found_at_its_step(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ends, rows = lines_of_steps(copy), read_table(copy, "gateway").to_pylist()
    step = next(n for n, row in enumerate(rows) if row["frames_sent"] and row["wheel_speed_mps"] > 1.0)
    flip_line(copy, ends[step] - rows[step]["frames_sent"], 3)
    seal_again(copy)
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    assert said.splitlines()[0] == f"step {step} ({rows[step]['time_s']:.2f} s) of the gateway differs in frames:"


def test_a_changed_report_is_found_where_the_gateway_sees_it(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The wheels' speeds, of which a step that moves shows the newest."""
    ends, rows = lines_of_steps(copy), read_table(copy, "gateway").to_pylist()
    frames = list(read_log(copy / "can.log"))
    for step, row in enumerate(rows):
        heard = range(ends[step] - row["frames_received"] - row["frames_sent"], ends[step] - row["frames_sent"])
        wheels = [line for line in heard if frames[line][2].id == 0x06A]
        if wheels and row["wheel_speed_mps"] > 1.0:
            break
    flip_line(copy, wheels[-1], 8)  # the rear left wheel's lower byte: 0.16 rad/s
    seal_again(copy)
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    assert said.startswith(f"step {step} ")


CHANGES: dict[str, tuple[str, str]] = {
    "ticks": ("steering_setpoint_rad", "tick"),
    "readings": ("measured_s", "tick"),
    "sensor_radar": ("range_m", "tick"),
    "gateway": ("brake_torque_nm", "step"),
}


@pytest.mark.parametrize("part", CHANGES)
def test_a_changed_number_is_found_in_its_row(copy: Path, part: str, capsys: pytest.CaptureFixture[str]) -> None:
    """As whoever rewrites a table with care would do it: the file is sound, the number is another."""
    name, kind = CHANGES[part]
    table = read_table(copy, part)
    values, where = table[name].to_pylist(), table.num_rows * 2 // 3
    values[where] = np.nextafter(values[where], 1e9)
    altered = table.set_column(table.schema.get_field_index(name), table.schema.field(name), pa.array([*values]))
    pq.write_table(altered, copy / f"{part}.parquet")
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    assert said.startswith(f"{part} is not")
    seal_again(copy)
    code, found, _notes = replayed(copy, capsys)
    assert code == 1
    assert found.startswith(f"{kind} {table[kind][where].as_py()} ")


def test_a_changed_setpoint_is_found_at_its_step(copy: Path) -> None:
    inputs = read_live_inputs(copy)
    step = next(n for n, row in enumerate(inputs.steps) if row["setpoint"] and n > 300)
    setpoint = link.decode_setpoint(inputs.steps[step]["setpoint"])
    assert isinstance(setpoint, Setpoint)
    torn = bytearray(inputs.steps[step]["setpoint"])
    torn[12] ^= 1
    inputs.steps[step]["setpoint"] = bytes(torn)
    difference = replay_gateway(inputs)
    assert difference is not None
    assert (difference.number, difference.item) == (step, "setpoint")
    # Sound bytes that no pipeline computed: whoever sent them to the gateway was not this drive.
    inputs.steps[step]["setpoint"] = link.encode_setpoint(replace(setpoint, yaw_rate=setpoint.yaw_rate + 1e-12))
    difference = replay_drive(inputs, REPOSITORY)
    assert difference is not None
    assert difference.item == "setpoint"


def test_setpoints_of_another_encoding_are_told_as_that(copy: Path) -> None:
    inputs = read_live_inputs(copy)
    step = next(number for number, row in enumerate(inputs.steps) if row["setpoint"])
    older = b"VV\x02\x01and what version 2 has there"
    inputs.steps[step]["setpoint"] = older + zlib.crc32(older).to_bytes(4, "little")
    with pytest.raises(ConfigError, match=r"its setpoints are encoded as another version of vve-sumo did it"):
        replay_gateway(inputs)


def test_another_seed_is_another_drive(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The radar's noise hangs on it, so the first scan that sees something differs."""
    file = copy / "scenario.json"
    text = file.read_text(encoding="utf-8")
    assert text.count('"seed": 1,') == 1
    file.write_text(text.replace('"seed": 1,', '"seed": 3,'), encoding="utf-8")
    first = read_table(copy, "sensor_radar")["tick"][0].as_py()
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    assert said.splitlines()[0].startswith("scenario.json is not")
    seal_again(copy, seed=3)
    code, said, _notes = replayed(copy, capsys)
    assert code == 1
    tick = int(said.split()[1])
    assert first <= tick < first + 50


def test_what_has_changed_since_is_told(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = copy / "scenario.json"
    text = file.read_text(encoding="utf-8")
    libsumo = text.partition('"libsumo": "')[2].partition('"')[0]
    text = text.replace(f'"libsumo": "{libsumo}"', '"libsumo": "0.1"')
    digest = text.partition('"path": "')[2].partition('"')[0]
    file.write_text(text.replace(f'"path": "{digest}"', f'"path": "{"0" * 64}"'), encoding="utf-8")
    versions = json.loads(file.read_text(encoding="utf-8"))["versions"]
    seal_again(copy, versions=versions)
    _code, _said, notes = replayed(copy, capsys)
    assert notes.splitlines() == ["note: path has changed since", f"note: libsumo was 0.1, is {libsumo}"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("outcome", "contact"),
        ("outcome", "driver_has_control"),
        ("reasons", ["driver_override"]),
        ("gateway_steps", 7),
        ("latency", {}),
        ("shadow", True),
        ("rig", "another"),
        ("max_speed_mps", 1.0),
    ],
)
def test_a_summary_that_its_tables_contradict_is_altered(copy: Path, key: str, value: object) -> None:
    assert json.loads((copy / "summary.json").read_text(encoding="utf-8"))[key] != value
    seal_again(copy, **{key: value})
    assert altered_parts(copy) == ["summary.json"]


def test_a_gateway_that_is_gone_is_named(copy: Path) -> None:
    """Also where whoever took it away left no hash of it, and no summary's key that tells of it."""
    reported = json.loads((copy / "summary.json").read_text(encoding="utf-8"))
    (copy / "gateway.parquet").unlink()
    parts = {name: digest for name, digest in reported["record_parts_sha256"].items() if name != "gateway"}
    files = {name: digest for name, digest in reported["record_files_sha256"].items() if name != "gateway.parquet"}
    del reported["gateway_steps"]
    write_summary(
        copy, reported | {"record_sha256": whole(parts), "record_parts_sha256": parts, "record_files_sha256": files}
    )
    assert "gateway" in (altered_parts(copy) or [])


def test_where_a_live_drive_comes_from(copy: Path) -> None:
    reported = json.loads((copy / "provenance.json").read_text(encoding="utf-8"))
    assert len(reported["rig_file_sha256"]) == len(reported["scenario_file_sha256"]) == 64
    assert reported["doctor"] == {"verdict": "none", "caveats": []}
    assert (reported["operator"], reported["driver"]) == (None, None), "nobody asks where a simulated vehicle drives"
    change_json(copy / "provenance.json", "operator", value="somebody")
    assert altered_parts(copy) == ["provenance.json"]


# Kills.


def lost(folder: Path, at: float) -> dict[str, float]:
    """Return how much before drive time `at` each part of a record ends [s]."""
    ends = {name: read_table(folder, name)["time_s"].to_pylist()[-1] for name in ("ticks", "gateway")}
    ends["pose"] = read_pose_chunks(folder / "pose.bin")[-1][0]
    epoch = read_live_inputs(folder).scenario_content["epoch_gnss_s"]
    ends["can"] = list(read_log(folder / "can.log"))[-1][0] - epoch
    return {part: at - end for part, end in ends.items()}


def open_with_every_tool(folder: Path) -> None:
    """Read every table, summarise and draw a record, whatever became of its drive."""
    for name in LIVE_TABLES:
        read_table(folder, name)
    resolved, _rig = from_dict(read_live_inputs(folder).scenario_content, REPOSITORY)
    summary = summarise(resolved, DriveEnd(Outcome.BROKEN, ()), folder, hash_parts(folder))
    assert summary["ticks"] > 100
    (folder / "drive.png").unlink(missing_ok=True)
    draw_drive(drives.Drive(folder, summary))
    assert (folder / "drive.png").stat().st_size > 10_000
    assert cli.main(["redrive", str(folder), "--controller", "follow_and_stop"]) == 0


KILLED = {
    "drive": ("drive",),
    "recorder": ("recorder",),
    "all": ("console", "gateway", "drive", "recorder", "car"),
}


def killed(folder: Path, names: tuple[str, ...]) -> tuple[Path, float, float]:
    """Return the record of a drive whose processes were killed under way, when that was, and how long all stood then.

    Drive time at which it happened [s], and for how long the machine let nobody run just before it [s].
    """
    for number in range(TRIES):
        with witness(folder / "stalls"), driving(folder / f"{number}") as drive:
            if not drive.moves():
                continue
            at = drive.kill(*names)
            drive.console.wait(PATIENCE)
        stood = stalls(folder / "stalls", at - 2.0 * MOST_LOST, at)
        return drive.folder, at - drive.t0, sum(last - first for first, last in stood)
    raise AssertionError(f"no drive began: {(folder / '0' / 'said.txt').read_text(encoding='utf-8')}")


@pytest.mark.thorough
@pytest.mark.parametrize("who", with_slow(KILLED, lambda who: who != "all"))
def test_a_kill_loses_next_to_nothing(who: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, at, stood = killed(tmp_path, KILLED[who])
    gone = lost(folder, at)
    if who == "drive":
        assert gone["gateway"] < -0.5, "the gateway brakes to rest, and the recorder looks on"
    assert {part: took for part, took in gone.items() if took > MOST_LOST + stood} == {}
    open_with_every_tool(folder)
    code, said, notes = replayed(folder, capsys)
    assert "every setpoint and every frame is the same" in said
    assert code == 0
    assert ("never finished" in notes) == (not (folder / "summary.json").exists())
    if who == "all":
        assert "never finished" in notes


@pytest.mark.parametrize("name", with_slow(sorted(USUAL), USUAL.__contains__, "nominal".__eq__))
def test_the_same_controller_redriven_answers_the_same(
    records: Records, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = records[name][-1]
    assert cli.main(["redrive", str(folder), "--controller", "follow_and_stop"]) == 0
    said = capsys.readouterr().out
    asked = read_table(folder, "ticks")["steering_setpoint_rad"].to_numpy()
    assert f"{np.isfinite(asked).sum()} ticks compared; first tick that differs: none" in said
    assert (folder / "redrive.png").exists()
