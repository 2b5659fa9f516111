"""The lock of a rig, held by real processes: whatever is done to the file, one command at a time has a car's bus."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import own_rig
from vve_sumo.errors import RigError
from vve_sumo.rig import edit
from vve_sumo.rig.load import load
from vve_sumo.rig.lock import rig_lock

HOLD = """
import os, subprocess, sys
from pathlib import Path
from vve_sumo.errors import RigError
from vve_sumo.rig.load import load
from vve_sumo.rig.lock import rig_lock
file = Path(sys.argv[1])
try:
    with rig_lock(file, load(file)) as locks:
        if "heir" in sys.argv:
            heir = subprocess.Popen(["sleep", "60"], pass_fds=locks)
            print(heir.pid, flush=True)
        else:
            print("held", flush=True)
        sys.stdin.read()
except RigError as error:
    print(error, flush=True)
"""
ON_VCAN = (
    ('interface = "slcan"\nchannel = "pty"', 'interface = "socketcan"\nchannel = "vcan_lock0"'),
    ('title = "', 'title = "On a bus: '),
)


@contextlib.contextmanager
def holder(rig: Path, *arguments: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A process that locks a rig, or says why it cannot; its first line."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(rig), *arguments],
        cwd=rig.parent,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), process
        finally:
            process.kill()


def refusal(rig: Path) -> str:
    """What this process is told when it locks a rig; empty where it may."""
    try:
        with rig_lock(rig, load(rig)):
            return ""
    except RigError as error:
        return str(error)


def free_again(rig: Path) -> bool:
    """Whether a rig can be locked within the seconds that a dying process takes."""
    deadline = time.monotonic() + 10.0
    while refusal(rig):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def on_bus(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """A simulated vehicle's rig on a virtual SocketCAN bus; the bus need not exist to be locked."""
    return own_rig(folder, *ON_VCAN, *changes, name=name)


@pytest.mark.thorough
def test_a_rig_is_held_by_one_process_and_free_when_that_is_killed(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    with holder(rig) as (said, process):
        assert said == "held"
        assert refusal(rig).startswith(f"{rig}: this rig is in use by another drive, doctor or align (process ")
        assert f"(process {process.pid})" in refusal(rig)
        with holder(rig) as (other, _process):
            assert f"(process {process.pid})" in other
    assert free_again(rig)


def test_a_rig_stays_locked_when_its_file_is_written_anew_or_named_otherwise(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    link = tmp_path / "link.toml"
    link.symlink_to(rig)
    with holder(rig):
        before = rig.stat().st_ino
        edit.put(rig, {("calibration", "steering_wheel_bias_deg"): 1.0})
        assert rig.stat().st_ino != before
        assert "this rig is in use" in refusal(rig)
        assert "this rig is in use" in refusal(link)
        assert "this rig is in use" in refusal(tmp_path / "." / "mine.toml")
    assert free_again(rig)


def test_two_rig_files_of_one_bus_exclude_each_other(tmp_path: Path) -> None:
    one, two = on_bus(tmp_path, "one"), on_bus(tmp_path, "two")
    with holder(one) as (said, process):
        assert said == "held"
        reported = refusal(two)
        assert reported.startswith(
            f"{two}: bus socketcan:vcan_lock0 is in use by another drive, doctor or align (process "
        )
        edit.put(one, {("calibration", "steering_wheel_bias_deg"): 1.0})
        assert f"(process {process.pid})" in refusal(two)
    assert free_again(two)


@pytest.mark.thorough
def test_the_simulated_vehicle_s_end_of_a_bus_is_locked_too(tmp_path: Path) -> None:
    by_hand = ("automatic = true", "automatic = false")
    cards = (("vcan_lock0", "can_lock0"), ("[car_start] ", '[car_start]\nchannel = "can_lock1" '), by_hand)
    one = on_bus(tmp_path, "one", *cards)
    two = on_bus(
        tmp_path, "two", ("vcan_lock0", "can_lock1"), ("[car_start] ", '[car_start]\nchannel = "c2" '), by_hand
    )
    with holder(one) as (said, _process):
        assert said == "held"
        assert "bus socketcan:can_lock1 is in use" in refusal(two)


@pytest.mark.thorough
def test_rigs_on_pseudo_terminals_and_on_other_buses_run_side_by_side(tmp_path: Path) -> None:
    one, two = own_rig(tmp_path, name="one"), own_rig(tmp_path, name="two")
    other = on_bus(tmp_path, "other", ("vcan_lock0", "vcan_lock9"))
    with holder(one), holder(on_bus(tmp_path, "bus")) as (said, _process):
        assert said == "held"
        assert refusal(two) == refusal(other) == ""


@pytest.mark.thorough
def test_one_serial_line_is_the_same_by_every_link_to_it(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to("/dev/nobody_lock")
    real = (('car = "simulated"', 'car = "real"'), ("automatic = true", ""))
    files = []
    for name, channel in (("one", "/dev/nobody_lock@115200"), ("two", f"{tmp_path}/by-id")):
        text = own_rig(tmp_path, *real, ('"pty"', f'"{channel}"'), name=name).read_text(encoding="utf-8")
        (tmp_path / f"{name}.toml").write_text(text[: text.index("[car_start]")], encoding="utf-8")
        files.append(tmp_path / f"{name}.toml")
    with holder(files[0]) as (said, _process):
        assert said == "held"
        assert "device /dev/nobody_lock is in use" in refusal(files[1])


@pytest.mark.thorough
def test_whoever_inherits_the_lock_holds_it_until_it_ends(tmp_path: Path) -> None:
    rig = on_bus(tmp_path, "mine")
    with holder(rig, "heir") as (heir, process):
        process.kill()
        process.wait()
        try:
            time.sleep(0.1)
            assert "is in use" in refusal(rig)
        finally:
            os.kill(int(heir), 9)
        assert free_again(rig)


def test_of_many_that_begin_at_once_one_has_the_rig(tmp_path: Path) -> None:
    rig, gate, reported = on_bus(tmp_path, "mine"), threading.Barrier(8), []
    loaded = load(rig)

    def run() -> None:
        gate.wait()
        try:
            with rig_lock(rig, loaded):
                reported.append("held")
                gate.wait()
        except RigError:
            reported.append("refused")
            gate.wait()

    threads = [threading.Thread(target=run) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(reported) == ["held"] + ["refused"] * 7


@pytest.mark.thorough
def test_a_name_too_long_for_the_kernel_is_locked_as_well(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 40)
    folder.mkdir()
    rig = own_rig(folder)
    with holder(rig) as (said, _process):
        assert said == "held"
        assert "this rig is in use" in refusal(rig)


@pytest.mark.thorough
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else as well")
def test_another_user_is_locked_out_too(tmp_path: Path) -> None:
    with holder(on_bus(tmp_path, "one")) as (said, _process):
        assert said == "held"
        loaded, place = load(on_bus(tmp_path, "two")), tmp_path / "two.toml"
        child = os.fork()
        if child == 0:
            os.setuid(65534)
            try:
                with rig_lock(place, loaded):
                    os._exit(0)
            except RigError:
                os._exit(7)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
