"""What a sweep sees of processes that come and go while it looks at them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from vve_sumo.sweep import process_tree

SLEEP = "import time; time.sleep(600)"
#: starts a process that starts another, says which, and waits
FAMILY = f"""
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", 'import subprocess, sys; '
    'print(subprocess.Popen([sys.executable, "-c", "{SLEEP}"]).pid, flush=True); {SLEEP}'])
print(child.pid, flush=True)
{SLEEP}
"""
#: starts processes that end at once, for as long as it lives
CHURN = "while :; do (: & : & wait) & wait; done"


@pytest.fixture
def family() -> Iterator[tuple[int, set[int]]]:
    """A process and its descendants: a child and a grandchild."""
    with subprocess.Popen([sys.executable, "-c", FAMILY], stdout=subprocess.PIPE, text=True) as top:
        assert top.stdout is not None
        below = {int(top.stdout.readline()) for _ in range(2)}
        yield top.pid, below
        process_tree.kill([top.pid, *below])


def test_descendants_are_children_and_theirs(family: tuple[int, set[int]]) -> None:
    top, below = family
    assert set(process_tree.descendants(top)) == below
    assert top in process_tree.descendants(os.getpid())


def test_memory_is_that_of_the_kernels_status_file(family: tuple[int, set[int]]) -> None:
    top, _below = family
    lines = Path(f"/proc/{top}/status").read_text(encoding="ascii").splitlines()
    kilobytes = next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:"))
    assert process_tree.resident(top) == pytest.approx(1024 * kilobytes, rel=0.2)


PATIENCE = 30.0  #: a busy machine takes longer to show many processes [s]


def test_a_zombie_is_a_descendant_without_memory_and_one_that_is_gone_is_nothing() -> None:
    zombie = subprocess.Popen(["true"])
    os.waitid(os.P_PID, zombie.pid, os.WEXITED | os.WNOWAIT)
    assert zombie.pid in process_tree.descendants(os.getpid())
    assert process_tree.resident(zombie.pid) == 0
    zombie.wait()
    assert zombie.pid not in process_tree.descendants(os.getpid())
    assert process_tree.descendants(zombie.pid) == []
    assert process_tree.resident(zombie.pid) == 0
    process_tree.kill([zombie.pid])


@pytest.mark.thorough
def test_processes_that_end_while_they_are_looked_at_do_no_harm() -> None:
    with subprocess.Popen(["sh", "-c", CHURN], start_new_session=True) as churn:
        seen = set[int]()
        begun = time.monotonic()
        while (passed := time.monotonic() - begun) < 1.0 or (len(seen) <= 10 and passed < PATIENCE):
            for process in process_tree.descendants(churn.pid):
                assert process_tree.resident(process) >= 0
                seen.add(process)
        process_tree.kill([churn.pid])
        churn.wait()
        process_tree.end_session(churn.pid)
        assert len(seen) > 10
    for process in Path("/proc").glob("[0-9]*"):
        try:
            assert os.getsid(int(process.name)) != churn.pid
        except ProcessLookupError:
            continue
