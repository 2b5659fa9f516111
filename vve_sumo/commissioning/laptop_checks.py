"""The doctor's checks of how this computer is set up for a live drive, each with the command that mends it.

They read what the kernel and systemd say of themselves; they change nothing. Who wants the commands runs them as root.
"""

from __future__ import annotations

import configparser
import ctypes
import json
import os
import re
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.live.priority import DRIVE_NICE, GATEWAY_PRIORITY, Rights, rights

PROCESSORS: Final = "sys/devices/system/cpu"
#: of systemd: what puts a computer to sleep
SLEEP_TARGETS: Final = ("sleep.target", "suspend.target", "hibernate.target", "hybrid-sleep.target")
#: masked by the system's own configuration or until the next start
MASKS: Final = ("etc/systemd/system", "run/systemd/system")
#: how a kernel counts time in a register; other sources cost a microsecond and more for a look
FAST_CLOCKS: Final = ("tsc", "arch_sys_counter", "kvm-clock")
LIMITS_FILE: Final = "/etc/security/limits.d/vve-sumo.conf"
USUAL_BIT_RATE: Final = 500_000  #: of a car's bus [bit/s], where the link has none yet
RESTART: Final = 100  #: after bus-off [ms]: the gateway goes on with its stop, which takes seconds
#: a quarter of the processors busy with other things is too much
BUSY_SHARE: Final = 0.25
IP_TIMEOUT: Final = 2.0  #: that iproute2 has to answer [s]
TIME_ERROR: Final = 5  #: what adjtimex of Linux returns of a clock that nothing disciplines


class LaptopSetting(NamedTuple):
    """A check of this computer, and what mends it."""

    check: Check
    command: str = ""  #: lines of a shell run by root; empty where nothing is to be mended, or a person has to
    undo: str = ""  #: lines that take it back; empty where the next start of the computer does


def this_computer() -> Iterator[LaptopSetting]:
    """Check this computer for this user; nothing is changed."""
    yield from laptop(Path("/"), rights(), name_of_user(), can_links(_said_by_ip()))
    yield clock(is_disciplined())


def _said_by_ip() -> str:
    """Return what iproute2 says of the CAN links; empty where it is not installed or does not answer."""
    command = ["ip", "-details", "-json", "link", "show", "type", "can"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=IP_TIMEOUT, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def laptop(root: Path, permitted: Rights, user: str, links: Sequence[dict[str, Any]]) -> Iterator[LaptopSetting]:
    """Check the computer whose file system begins at `root`.

    `permitted` is what the kernel lets this user do, `user` the name, `links` what `can_links` returns.
    """
    yield _power(root)
    yield _sleep(root)
    yield _lid(root)
    yield _governor(root)
    yield _turbo(root)
    yield _isolated(root)
    yield _limits(permitted, user)
    yield _real_time_share(root)
    yield _clock_source(root)
    yield _load(root)
    yield from (_can(link) for link in links)


def _read(file: Path) -> str | None:
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def _good(name: str, found: str) -> LaptopSetting:
    return LaptopSetting(Check(name, found))


def _note(name: str, found: str, advice: str, command: str = "", undo: str = "") -> LaptopSetting:
    return LaptopSetting(Check(name, found, CheckResult.NOTE, advice), command, undo)


def _no_go(name: str, found: str, advice: str, command: str = "", undo: str = "") -> LaptopSetting:
    return LaptopSetting(Check(name, found, CheckResult.NO_GO, advice), command, undo)


def _power(root: Path) -> LaptopSetting:
    supplies = sorted((root / "sys/class/power_supply").glob("*"))
    # A battery of scope Device is a mouse's or a headset's.
    batteries = [one for one in supplies if _read(one / "type") == "Battery" and _read(one / "scope") != "Device"]
    states = sorted({(_read(one / "status") or "unknown").lower() for one in batteries})
    if "discharging" in states:
        return _no_go("power", "on battery, which slows the processor down and ends", "plug the power supply in")
    return _good("power", f"battery {', '.join(states)}" if states else "no battery")


def _masked(root: Path) -> bool:
    """Whether systemd cannot put this computer to sleep."""
    return all(any(_is_mask(root / place / target) for place in MASKS) for target in SLEEP_TARGETS)


def _is_mask(file: Path) -> bool:
    return file.is_symlink() and str(file.readlink()) == "/dev/null"


def _sleep(root: Path) -> LaptopSetting:
    if not (root / "run/systemd/system").is_dir():
        return _good("sleep", "systemd does not run here: nothing that is known puts this computer to sleep")
    if _masked(root):
        return _good("sleep", "masked")
    targets = " ".join(SLEEP_TARGETS)
    advice = "a computer that falls asleep leaves the car to its watchdog; mask the targets of sleep"
    return _no_go("sleep", "possible", advice, f"systemctl mask {targets}", f"systemctl unmask {targets}")


def _lid(root: Path) -> LaptopSetting:
    lids = [_read(file) or "" for file in sorted((root / "proc/acpi/button/lid").glob("*/state"))]
    if not lids:
        return _good("lid", "none")
    action = _lid_switch(root)
    if action == "ignore" or _masked(root):
        return _good("lid", "a closed lid puts nothing to sleep")
    file = "/etc/systemd/logind.conf.d/vve-sumo.conf"
    command = (
        "mkdir -p /etc/systemd/logind.conf.d\n"
        f"printf '[Login]\\nHandleLidSwitch=ignore\\nHandleLidSwitchExternalPower=ignore\\n' > {file}\n"
        "systemctl kill -s HUP systemd-logind"
    )
    advice = "a lid that falls shut ends the drive; have it ignored"
    return _no_go("lid", f"closing it means {action}", advice, command, f"rm {file}")


def _lid_switch(root: Path) -> str:
    """Return what logind does when the lid is closed; `suspend` where nothing says otherwise."""
    files = [root / "etc/systemd/logind.conf", *sorted((root / "etc/systemd/logind.conf.d").glob("*.conf"))]
    found = "suspend"
    for file in files:
        said = configparser.ConfigParser(interpolation=None, strict=False)
        try:
            said.read_string(_read(file) or "")
        except configparser.Error:
            continue
        found = said.get("Login", "HandleLidSwitch", fallback=found)
    return found


def _governor(root: Path) -> LaptopSetting:
    files = sorted((root / PROCESSORS).glob("cpu[0-9]*/cpufreq/scaling_governor"))
    found = sorted({_read(file) or "unknown" for file in files})
    if not found:
        return _good("governor", "none: this kernel leaves the clock rate to others, as in a virtual machine")
    if found == ["performance"]:
        return _good("governor", "performance")
    advice = "the processor slows down between two ticks and wakes late; take performance"
    places = f"/{PROCESSORS}/cpu[0-9]*/cpufreq/scaling_governor"
    command = f"for one in {places}; do echo performance > $one; done"
    return _note("governor", ", ".join(found), advice, command)


def _turbo(root: Path) -> LaptopSetting:
    switches = {"intel_pstate/no_turbo": ("0", "1"), "cpufreq/boost": ("1", "0")}
    for place, (on, off) in switches.items():
        said = _read(root / PROCESSORS / place)
        if said == on:
            advice = "the clock rate follows heat and load, and so do the times of a tick; off they are even"
            return _note("turbo", "on", advice, f"echo {off} > /{PROCESSORS}/{place}")
        if said is not None:
            return _good("turbo", "off")
    return _good("turbo", "not switched by this kernel")


def _isolated(root: Path) -> LaptopSetting:
    said = _read(root / PROCESSORS / "isolated")
    if not said:
        return _good("isolated cores", "none")
    advice = "no process of a drive runs there by itself: take isolcpus off the kernel's command line"
    return _note("isolated cores", said, advice)


def _limits(permitted: Rights, user: str) -> LaptopSetting:
    lacking = permitted.lacking()
    if not lacking:
        return _good("limits", f"real-time priority {GATEWAY_PRIORITY} and locked memory are permitted")
    lines = (f"{user} - rtprio {GATEWAY_PRIORITY}", f"{user} - nice {DRIVE_NICE}", f"{user} - memlock unlimited")
    command = f"printf '%s\\n' {' '.join(map(shlex.quote, lines))} > {LIMITS_FILE}"
    return _note(
        "limits",
        "not permitted",
        f"{lacking} (the change counts from the next log-in on)",
        command,
        f"rm {LIMITS_FILE}",
    )


def _real_time_share(root: Path) -> LaptopSetting:
    said = _read(root / "proc/sys/kernel/sched_rt_runtime_us")
    if said is None:
        return _good("real-time share", "not limited by this kernel")
    if said == "0":
        advice = "no process may run with real-time priority: give them the kernel's usual share"
        return _no_go("real-time share", "none", advice, "sysctl -w kernel.sched_rt_runtime_us=950000")
    return _good("real-time share", "all" if said == "-1" else f"{said} us of each period")


def _clock_source(root: Path) -> LaptopSetting:
    said = _read(root / "sys/devices/system/clocksource/clocksource0/current_clocksource") or "unknown"
    if said in FAST_CLOCKS:
        return _good("clock source", said)
    return _note("clock source", said, "every look at the clock is a system call: see dmesg for why tsc was given up")


def _load(root: Path) -> LaptopSetting:
    said = _read(root / "proc/loadavg") or ""
    many = len(sorted((root / PROCESSORS).glob("cpu[0-9]*"))) or 1
    load = float(said.split()[0]) if re.match(r"[\d.]+ ", said) else 0.0
    found = f"load {load:.1f} on {many} processors"
    if load <= BUSY_SHARE * many:
        return _good("load", found)
    return _note("load", found, "end what else runs, and what updates the system by itself")


def _can(link: dict[str, Any]) -> LaptopSetting:
    """Check a CAN link of the kernel's by what iproute2 says of it."""
    name, data = str(link.get("ifname", "can")), (link.get("linkinfo") or {}).get("info_data") or {}
    timing = data.get("bittiming") or {}
    rate, point = int(timing.get("bitrate") or 0), float(timing.get("sample_point") or 0.0)
    restart, state = int(data.get("restart_ms") or 0), str(data.get("state", "unknown"))
    head = f"can {name}"
    found = f"{state}, {rate} bit/s, sample point {100.0 * point:.1f} %, restart-ms {restart}"
    set_up = f"ip link set {name} type can bitrate {rate or USUAL_BIT_RATE} restart-ms {RESTART}"
    up = "\n".join((f"ip link set {name} down", set_up, f"ip link set {name} up"))
    if "UP" not in link.get("flags", ()):
        return _no_go(head, f"down, {found}", "set it up with the bit rate of the car's bus", up)
    if state == "BUS-OFF":
        return _no_go(head, found, "wrong bit rate, no termination or a short circuit; mend the wire first", up)
    if state in ("ERROR-PASSIVE", "ERROR-WARNING"):
        return _note(head, found, "frames fail: look at bit rate, termination and plugs")
    if not restart:
        return _note(head, found, "after bus-off it stays dead, and the gateway cannot go on with its stop", up)
    return _good(head, found)


def can_links(said: str) -> list[dict[str, Any]]:
    """Return the CAN links in what `ip -details -json link show` printed; those of a computer without any are none."""
    try:
        links = json.loads(said or "[]")
    except ValueError:
        return []
    found = links if isinstance(links, list) else []
    return [one for one in found if isinstance(one, dict) and one.get("link_type") == "can"]


def is_disciplined() -> bool:
    """Whether something, such as PTP or NTP, keeps this computer's clock at the true time; as the kernel says."""
    times = ctypes.create_string_buffer(512)  # struct timex; all zero: nothing is changed
    return int(ctypes.CDLL(None).adjtimex(times)) not in (TIME_ERROR, -1)


def clock(disciplined: bool) -> LaptopSetting:
    """Return the check of this computer's clock."""
    if disciplined:
        return _good("clock", "the kernel says that it is disciplined")
    advice = "pose.clock = 'arrival' needs no true time; for 'absolute' have PTP or PPS discipline the clock"
    return _note("clock", "nothing disciplines it, as far as the kernel knows", advice)


def script(settings: Sequence[LaptopSetting]) -> str:
    """Return the commands that mend what is not GO, as a script for a shell that is run by root."""
    lines = ["# Written by vve-sumo doctor --laptop --commands; to be run by root."]
    for setting in settings:
        if setting.command:
            lines += ["", f"# {setting.check.name}: {setting.check.observed}", setting.command]
            lines.append(f"# to take it back: {setting.undo.replace(chr(10), '; ') or 'start the computer again'}")
    return "\n".join(lines) if len(lines) > 1 else f"{lines[0]}\n# There is nothing to mend."


def name_of_user() -> str:
    """Return who drives: whoever asked for root, or this user."""
    return os.environ.get("SUDO_USER") or os.environ.get("USER") or "root"
