"""Starting processes: configuration and channels arrive, from any folder, with nothing left open on our side."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.live.patience import until
from tests.record.declared import RESOLVED
from vve_sumo.live.channel import pair
from vve_sumo.live.spawn import start

SCENARIO = RESOLVED | {"a": 1}


def config(folder: Path, **changes: object) -> dict[str, object]:
    """The recorder's configuration: the process that needs least."""
    return {"folder": str(folder), "resolved": SCENARIO, "epoch": 0.0, "provenance": "{}", "log": None, **changes}


@pytest.mark.thorough
def test_a_process_gets_its_configuration_and_channels_and_ends_with_them(tmp_path):
    ours, theirs = pair()
    process = start("recorder", config(tmp_path / "r"), {"drive": theirs})
    written = tmp_path / "r" / "scenario.json"
    until(lambda: written.exists() and '"a": 1' in written.read_text())
    assert theirs.closed, "the end was given away"
    ours.close()
    assert process.wait(30.0) == 0


@pytest.mark.thorough
def test_a_process_that_dies_is_seen_on_its_channel(tmp_path):
    ours, theirs = pair()
    process = start("recorder", config(tmp_path / "r"), {"drive": theirs})
    until(lambda: (tmp_path / "r" / "scenario.json").exists())
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert ours.receive() == []
    assert ours.closed


@pytest.mark.thorough
def test_what_a_process_says_goes_to_its_log(tmp_path):
    ours, theirs = pair()
    log = tmp_path / "recorder.txt"
    process = start("recorder", config(Path("/proc/nowhere"), log=str(log)), {"drive": theirs})
    assert process.wait(30.0) != 0
    assert "/proc/nowhere" in log.read_text()
    assert ours.receive() == []
    assert ours.closed


@pytest.mark.thorough
def test_a_descriptor_that_is_to_be_inherited_stays_open_until_the_process_ends(tmp_path):
    ours, theirs = pair()
    reading, writing = os.pipe()
    process = start("recorder", config(tmp_path / "r"), {"drive": theirs}, inherited=(writing,))
    os.close(writing)
    os.set_blocking(reading, False)
    with pytest.raises(BlockingIOError):
        os.read(reading, 1)  # which the other process still could write
    ours.close()
    assert process.wait(30.0) == 0
    assert os.read(reading, 1) == b"", "nobody has it open any more"
    os.close(reading)


@pytest.mark.thorough
@pytest.mark.parametrize("own", [False, True])
def test_a_session_of_its_own_where_asked(tmp_path, own):
    ours, theirs = pair()
    process = start("recorder", config(tmp_path / "r"), {"drive": theirs}, own_session=own)
    assert (os.getsid(process.pid) == process.pid) is own
    ours.close()
    assert process.wait(30.0) == 0


@pytest.mark.thorough
def test_a_file_in_the_working_folder_does_not_pass_for_a_module(tmp_path):
    (tmp_path / "pickle.py").write_text("raise SystemExit('a stranger')\n")
    code = (
        "from vve_sumo.live.channel import pair; from vve_sumo.live.spawn import start\n"
        f"ours, theirs = pair(); process = start('recorder', {config(tmp_path / 'r')!r}, {{'drive': theirs}})\n"
        "ours.close(); raise SystemExit(process.wait(60))"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "r" / "summary.json").exists()
