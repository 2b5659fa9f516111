"""What a process asks of the kernel: with the rights and without them, each in a process of its own."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys

import pytest

from vve_sumo.live.priority import DRIVE_NICE, GATEWAY_PRIORITY, TIME_SLICE, Rights, rights

#: takes all real-time rights away from a command; only root's processes need the first part
PLAIN = ["prlimit", "--rtprio=0", "--nice=0", "--memlock=65536"]
ROOT = ["setpriv", "--bounding-set=-sys_nice,-ipc_lock,-sys_resource"] if os.geteuid() == 0 else []
#: prints the scheduling policy, nice value and turn of this process, by the kernel's own report of them
REPORT = """
import ctypes, os, platform, struct
kept = ctypes.create_string_buffer(48)
number = {"x86_64": 315, "aarch64": 275}[platform.machine()]
assert ctypes.CDLL(None).syscall(number, 0, kept, 48, 0) == 0
_size, policy, _flags, nice, priority, turn, _deadline, _period = struct.unpack("=IIQiIQQQ", kept.raw)
print(policy, nice, priority, turn)
"""

pytestmark = pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs util-linux")
knows_turns = pytest.mark.skipif(
    tuple(map(int, platform.release().split(".")[:2])) < (6, 12) or platform.machine() not in ("x86_64", "aarch64"),
    reason="Linux before 6.12 knows no turns",
)
permitted = pytest.mark.skipif(not rights().real_time, reason="no real-time rights")


def run(code: str, *before: str) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh Python, whose command begins with `before`."""
    command = [*before, sys.executable, "-c", f"from vve_sumo.live import priority\n{code}"]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def unprivileged(code: str) -> str:
    """Return what code prints that runs without any real-time right."""
    done = run(code, *ROOT, *PLAIN)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@knows_turns
@pytest.mark.parametrize("asked", [GATEWAY_PRIORITY, DRIVE_NICE])
def test_without_the_rights_a_process_runs_all_the_same_and_says_so(asked: int) -> None:
    said, kernel = unprivileged(f"print(priority.raise_priority({asked}))\n{REPORT}").splitlines()
    assert said.startswith("no priority: the system does not allow it, but short turns, memory not locked")
    assert kernel == f"{os.SCHED_OTHER} 0 0 {TIME_SLICE}"


def test_on_a_processor_whose_call_is_not_known_the_turns_stay_as_they_are() -> None:
    code = "import platform\nplatform.machine = lambda: 'another'\nprint(priority.request_short_time_slice())"
    assert unprivileged(code) == "False"
    code += f"\nprint(priority.raise_priority({GATEWAY_PRIORITY}))"
    assert "no priority: the system does not allow it, memory not locked" in unprivileged(code)


def test_a_user_without_rights_is_told_what_is_lost_and_how_to_get_them() -> None:
    said = unprivileged("print(priority.rights().lacking())")
    assert said.startswith("no real-time and no locked-memory rights: ")
    for limit in (f"rtprio {GATEWAY_PRIORITY}", f"nice {DRIVE_NICE}", "memlock unlimited", "/etc/security/limits.d"):
        assert limit in said
    assert Rights(real_time=True, memory=True).lacking() == ""


@permitted
def test_asking_for_the_rights_leaves_the_process_as_it_was() -> None:
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    rights()
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


@permitted
def test_the_kernel_ends_a_real_time_process_that_computes_for_ever() -> None:
    code = "priority.MAX_REAL_TIME = 100_000\npriority.raise_priority(1)\nwhile True: pass"
    assert run(code).returncode == -9


@permitted
def test_a_real_time_process_that_waits_now_and_then_is_left_alone() -> None:
    code = """
import time
priority.MAX_REAL_TIME = 100_000
priority.raise_priority(1)
until = time.monotonic() + 0.5
while time.monotonic() < until:
    begun = time.monotonic()
    while time.monotonic() - begun < 0.02: pass
    time.sleep(0.001)
print("ended")
"""
    assert run(code).stdout == "ended\n"


@permitted
def test_an_urgent_part_is_real_time_between_its_begin_and_its_end() -> None:
    code = """
import os
policies = []
part = priority.RealTimeSection(10)
policies.append(os.sched_getscheduler(0))
part.begin()
policies.append(os.sched_getscheduler(0))
part.end()
policies.append(os.sched_getscheduler(0))
print(policies == [os.SCHED_OTHER, os.SCHED_FIFO, os.SCHED_OTHER])
"""
    assert run(code).stdout == "True\n"


def test_an_urgent_part_without_the_right_is_like_the_rest() -> None:
    code = "import os\npart = priority.RealTimeSection(10)\npart.begin()\nprint(os.sched_getscheduler(0), part.granted)"
    assert unprivileged(code) == f"{os.SCHED_OTHER} False"


@pytest.mark.thorough(witnesses=1)
@permitted
@pytest.mark.parametrize(("pauses", "expected"), [(True, 0), (False, -9)])
def test_urgent_parts_count_together_until_a_pause(pauses: bool, expected: int) -> None:
    code = f"""
import time
priority.MAX_REAL_TIME = 100_000
part = priority.RealTimeSection(1)
until = time.monotonic() + 1.0
while time.monotonic() < until:
    part.begin()
    begun = time.monotonic()
    while time.monotonic() - begun < 0.02: pass
    part.end()
    if {pauses}:
        part.pause()
    else:
        time.sleep(0.001)
"""
    assert run(code).returncode == expected


def test_what_a_lowered_process_starts_stays_low() -> None:
    child = f"import os\ntry:\n os.setpriority(os.PRIO_PROCESS, 0, -8)\nexcept PermissionError:\n pass\n{REPORT}"
    started = f"import subprocess, sys\npriority.keep_low(19)\nsubprocess.run([sys.executable, '-c', {child!r}])"
    done = run(started)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[:2] == [f"{os.SCHED_OTHER}", "19"]
