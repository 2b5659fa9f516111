"""What a test engineer sees, hears and is answered on a real terminal, over real drives of all processes."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import pytest

from tests.live.command_line import own_rig
from tests.live.stage import SCENARIO
from tests.live.terminal import Desk, desk
from vve_sumo.live import signals
from vve_sumo.record.reader import read_table

#: linden_17th laid into the simulated rig's airfield from where its car stands, as `vve-sumo align` stores it
STORED = (
    'kind = "matched_start"',
    'kind = "stored"\nnetwork = "linden"\ndate = 2026-05-01\norigin = [40.004325, -83.024514]\n'
    "rotation_deg = 171.58558\nx_m = 1875.662\ny_m = 1078.239\nresidual_m = 0.03",
)
HAND = ("automatic = true", "automatic = false")


def arguments(folder: Path, *changes: tuple[str, str], duration: float = 1.5) -> list[str]:
    """The command of a short drive with somebody at the keys."""
    (folder / "short.toml").write_text(SCENARIO.replace("duration_s = 60.0", f"duration_s = {duration}"))
    return [str(folder / "short.toml"), "--rig", str(own_rig(folder, HAND, *changes))]


def engage(at: Desk) -> None:
    """Engage as soon as it is ready, and wait until the car waits for its go."""
    at.shows("READY: E ENGAGES")
    at.press("e")
    at.shows("ENGAGED AND HELD: G GOES")


@pytest.mark.live
def test_a_drive_that_passes_is_told_from_the_first_key_to_park_and_blames_nobody(tmp_path: Path) -> None:
    with desk(*arguments(tmp_path), record=tmp_path / "record") as at:
        at.shows("READY: E ENGAGES")
        at.press("g")
        at.until(lambda: "g does nothing yet: e engages first" in at.text)
        engage(at)
        for number in signals.TERMINATING:
            for name in ("gateway", "drive", "recorder"):
                at.kill(name, number)
        at.press("g")
        at.shows("DRIVING: ANY KEY STOPS")
        code = at.ends()
    text = at.text
    assert "STOPPING: the drive is over" in text
    assert "AT REST: BRAKE, SHIFT TO P" in text
    assert "PARKED, DRIVE OVER" in text.rpartition("\x1b[J")[2]
    assert "NOT READY" not in text[text.index("DRIVING") :]
    assert "operator asked" not in text
    assert code == 0
    summary = json.loads((tmp_path / "record" / "summary.json").read_text())
    assert (summary["outcome"], summary["reasons"]) == ("timeout", [])
    assert not any(
        "stop_asked" in reasons for reasons in read_table(tmp_path / "record", "gateway")["reasons"].to_pylist()
    )


@pytest.mark.live
def test_a_gateway_that_is_frozen_under_way_and_then_gone_is_cried_out(tmp_path: Path) -> None:
    with desk(*arguments(tmp_path, duration=60.0), record=tmp_path / "record") as at:
        engage(at)
        at.press("g")
        at.shows("DRIVING: ANY KEY STOPS")
        frozen = time.monotonic()
        at.kill("gateway", signal.SIGSTOP)
        at.shows("GATEWAY SILENT: BRAKE")
        seen = next(then for then, piece in at.pieces if "GATEWAY SILENT: BRAKE" in piece)
        assert seen - frozen < 0.3
        until = time.monotonic() + 1.0
        at.until(lambda: time.monotonic() > until)
        alarmed = "".join(piece for then, piece in at.pieces if then >= seen)
        assert alarmed.count("\a") >= 7, "the bell at every picture"
        assert "ANY KEY STOPS" not in alarmed
        at.kill("gateway", signal.SIGKILL)
        at.shows("GATEWAY GONE: BRAKE")
        at.ends()
    assert "drive over" not in at.text.lower()
    assert "gateway_gone" in json.loads((tmp_path / "record" / "summary.json").read_text())["reasons"]


@pytest.mark.thorough
@pytest.mark.live
def test_a_car_that_faces_the_wrong_way_beside_the_start_is_not_ready_and_told_its_numbers(tmp_path: Path) -> None:
    """The rig's own numbers: 0.00002 degrees of latitude are 2.2 m, to the left of a path that runs west."""
    turned = ("heading_deg = 85.0\nsteering", "heading_deg = 265.0\nsteering")
    moved = ("latitude_deg = 40.0041\n", "latitude_deg = 40.00412\n")
    with desk(*arguments(tmp_path, STORED, turned, moved), record=tmp_path / "record") as at:
        at.until(lambda: "2.2 m left of the path and 0.2 m past its start" in at.picture)
        assert "turned by 180 deg" in at.picture
        at.press("e")
        at.until(lambda: "e does nothing yet" in at.text)
        at.press("x")
        at.ends()
    assert "  READY" not in at.text
    posed = [row for row in read_table(tmp_path / "record", "ticks").to_pylist() if row["pose_trusted"]]
    assert posed
    assert all("start_position+start_heading" in row["shell_faults"] for row in posed), "from the first setpoint on"
    assert {row["state"] for row in read_table(tmp_path / "record", "gateway").to_pylist()} == {"disarmed"}


@pytest.mark.thorough
@pytest.mark.live
def test_a_simulated_vehicle_waits_for_a_calm_second_and_the_engineer_is_told(tmp_path: Path) -> None:
    def stall() -> None:
        at.kill("drive", signal.SIGSTOP)
        time.sleep(0.03)
        at.kill("drive", signal.SIGCONT)
        until = time.monotonic() + 0.2
        at.until(lambda: time.monotonic() > until)

    with desk(*arguments(tmp_path), record=tmp_path / "record") as at:
        at.until(lambda: "m to go" in at.text and (tmp_path / "record" / "processes.json").exists())
        while "waiting for a calm second: worst wake-up " not in at.text:
            stall()
        assert "ms in the last second; close other programs" in at.text
        for _ in range(15):
            stall()
            assert "READY: E ENGAGES" not in at.text.replace("NOT READY", "")
        engage(at)
        at.press("x")
        at.ends()
    assert not json.loads((tmp_path / "record" / "summary.json").read_text())["no_calm_second"]
