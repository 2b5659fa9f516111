"""How a computer is set up for a live drive: what is found in trees of files like the kernel's, and what mends it."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from vve_sumo.cli.dispatch import main
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.laptop_checks import LaptopSetting, can_links, clock, laptop, script
from vve_sumo.live.priority import Rights

ALL = Rights(real_time=True, memory=True)
CPU = "sys/devices/system/cpu"
#: a laptop as it is delivered
DELIVERED = {
    "sys/class/power_supply/BAT0/type": "Battery",
    "sys/class/power_supply/BAT0/status": "Charging",
    "sys/class/power_supply/mouse/type": "Battery",
    "sys/class/power_supply/mouse/scope": "Device",
    "sys/class/power_supply/mouse/status": "Discharging",
    "run/systemd/system/x": "",
    "proc/acpi/button/lid/LID0/state": "state:      open",
    "etc/systemd/logind.conf": "[Login]\n#HandleLidSwitch=ignore",
    f"{CPU}/cpu0/cpufreq/scaling_governor": "powersave",
    f"{CPU}/cpu1/cpufreq/scaling_governor": "performance",
    f"{CPU}/cpufreq/boost": "1",
    f"{CPU}/isolated": "2-3",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
    "proc/loadavg": "0.12 0.10 0.05 1/300 4000",
}


def tree(root: Path, files: dict[str, str]) -> Path:
    for name, content in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(f"{content}\n", encoding="utf-8")
    return root


def masked(root: Path) -> None:
    folder = root / "etc/systemd/system"
    folder.mkdir(parents=True)
    for name in ("sleep", "suspend", "hibernate", "hybrid-sleep"):
        (folder / f"{name}.target").symlink_to("/dev/null")


def settings(root: Path, rights: Rights = ALL, links: Any = ()) -> dict[str, LaptopSetting]:
    return {one.check.name: one for one in laptop(root, rights, "bob", list(links))}


def findings(found: dict[str, LaptopSetting], result: CheckResult) -> set[str]:
    return {name for name, one in found.items() if one.check.finding is result}


def test_what_may_stop_a_drive_is_no_go_and_says_how_to_mend_it(tmp_path: Path) -> None:
    found = settings(tree(tmp_path, DELIVERED), Rights(real_time=False, memory=True))
    assert findings(found, CheckResult.NO_GO) == {"sleep", "lid"}
    assert findings(found, CheckResult.NOTE) == {"governor", "turbo", "isolated cores", "limits"}
    assert all(one.check.advice for one in found.values() if one.check.finding is not CheckResult.GO)
    assert "bob - rtprio 30" in found["limits"].command


def test_a_computer_that_is_set_up_is_go_throughout(tmp_path: Path) -> None:
    ready = DELIVERED | {
        f"{CPU}/cpu0/cpufreq/scaling_governor": "performance",
        f"{CPU}/cpufreq/boost": "0",
        f"{CPU}/isolated": "",
    }
    masked(tree(tmp_path, ready))
    found = settings(tmp_path)
    assert findings(found, CheckResult.GO) == set(found)
    assert script([*found.values()]).endswith("# There is nothing to mend.")


@pytest.mark.parametrize(
    ("change", "name", "result"),
    [
        ({"sys/class/power_supply/BAT0/status": "Discharging"}, "power", CheckResult.NO_GO),
        ({"proc/sys/kernel/sched_rt_runtime_us": "0"}, "real-time share", CheckResult.NO_GO),
        ({"proc/sys/kernel/sched_rt_runtime_us": "-1"}, "real-time share", CheckResult.GO),
        ({"sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet"}, "clock source", CheckResult.NOTE),
        ({"proc/loadavg": "0.6 0 0 1/1 1"}, "load", CheckResult.NOTE),
        ({"proc/loadavg": "0.5 0 0 1/1 1"}, "load", CheckResult.GO),
        ({f"{CPU}/intel_pstate/no_turbo": "1"}, "turbo", CheckResult.GO),
        ({"etc/systemd/logind.conf.d/a.conf": "[Login]\nHandleLidSwitch=ignore"}, "lid", CheckResult.GO),
        ({"etc/systemd/logind.conf.d/a.conf": "no ini file"}, "lid", CheckResult.NO_GO),
        ({"etc/systemd/logind.conf.d/a.conf": "[Login]\nHandleLidSwitch=lock"}, "lid", CheckResult.NO_GO),
    ],
)
def test_each_setting_counts(tmp_path: Path, change: dict[str, str], name: str, result: CheckResult) -> None:
    assert settings(tree(tmp_path, DELIVERED | change))[name].check.finding is result


def test_a_machine_that_says_nothing_is_no_reason_not_to_drive(tmp_path: Path) -> None:
    assert findings(settings(tmp_path), CheckResult.NO_GO) == set()


def test_the_commands_mend_what_they_are_for(tmp_path: Path) -> None:
    """Run by a shell in a tree of files in the place of the kernel's, with systemctl as systemd does its part."""
    root = tree(tmp_path / "root", DELIVERED)
    (root / "etc/security/limits.d").mkdir(parents=True)
    (root / "etc/systemd/system").mkdir(parents=True)
    tools = tmp_path / "bin"
    tools.mkdir()
    mask = 'for one in "$@"; do ln -s /dev/null "$ROOT/etc/systemd/system/$one"; done'
    (tools / "systemctl").write_text(f'#!/bin/sh\nif [ "$1" = mask ]; then shift; {mask}; fi\n', encoding="utf-8")
    (tools / "systemctl").chmod(0o755)
    said = script([*settings(root, Rights(real_time=False, memory=False)).values()])
    inside = said.replace(" /sys/", f" {root}/sys/").replace(" /etc/", f" {root}/etc/")
    environment = {"PATH": f"{tools}:{os.environ['PATH']}", "ROOT": str(root)}
    subprocess.run(["sh", "-eu"], input=inside, text=True, env=environment, check=True)
    found = settings(root)
    assert findings(found, CheckResult.GO) == set(found) - {"isolated cores"}  # which the boot loader has to mend
    limits = (root / "etc/security/limits.d/vve-sumo.conf").read_text(encoding="utf-8").splitlines()
    assert limits == ["bob - rtprio 30", "bob - nice -15", "bob - memlock unlimited"]
    assert "HandleLidSwitch=ignore" in (root / "etc/systemd/logind.conf.d/vve-sumo.conf").read_text(encoding="utf-8")


def link(**changes: Any) -> dict[str, Any]:
    """As iproute2 says it of a real card."""
    data = {
        "state": "ERROR-ACTIVE",
        "restart_ms": 100,
        "bittiming": {"bitrate": 500000, "sample_point": "0.875"},
    } | changes.pop("info_data", {})
    return {
        "ifname": "can0",
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "link_type": "can",
        "linkinfo": {"info_kind": "can", "info_data": data},
    } | changes


@pytest.mark.parametrize(
    ("said", "result", "words"),
    [
        (link(), CheckResult.GO, "ERROR-ACTIVE, 500000 bit/s, sample point 87.5 %, restart-ms 100"),
        (link(info_data={"restart_ms": 0}), CheckResult.NOTE, "restart-ms 0"),
        (link(info_data={"state": "BUS-OFF"}), CheckResult.NO_GO, "BUS-OFF"),
        (link(info_data={"state": "ERROR-PASSIVE"}), CheckResult.NOTE, "ERROR-PASSIVE"),
        (link(flags=["NOARP", "ECHO"], linkinfo={"info_kind": "can"}), CheckResult.NO_GO, "down"),
    ],
)
def test_a_can_link_is_judged_by_what_iproute2_says(said: Any, result: CheckResult, words: str, tmp_path: Path) -> None:
    links = can_links(json.dumps([said, {}, {"ifname": "lo", "link_type": "loopback"}]))
    found = settings(tmp_path, links=links)["can can0"]
    assert found.check.finding is result
    assert words in found.check.observed
    mends = result is CheckResult.NO_GO or "restart-ms 0" in words
    assert ("bitrate 500000 restart-ms 100" in found.command) is mends


@pytest.mark.parametrize("said", ["", "[]", "{}", "no json", "[1]"])
def test_a_computer_without_can_links_has_none(said: str) -> None:
    assert can_links(said) == []


def test_a_clock_that_nothing_disciplines_is_a_note() -> None:
    assert [clock(one).check.finding for one in (True, False)] == [CheckResult.GO, CheckResult.NOTE]


def test_the_command_reads_this_computer_and_takes_nothing_beside_it(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor", "--laptop", "--json"])
    said = json.loads(capsys.readouterr().out)
    assert {check["name"] for check in said["checks"]} >= {"power", "sleep", "lid", "governor", "clock"}
    assert code == (3 if said["verdict"] == "NO-GO" else 0)
    for wrong in (["--laptop", "--rig", "simulated"], ["--commands"], ["--laptop", "--commands", "--json"]):
        assert main(["doctor", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
