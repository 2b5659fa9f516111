"""External controllers in lockstep: the shipped rig on free ports, and a brain as a process of its own."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.conftest import REPOSITORY
from tests.live.stage import free_ports


def write_rig(folder: Path, deadline: float = 10.0, more: str = "") -> list[int]:
    """Write the shipped rig as foreign.toml, with free ports and `more` tables; return ports of GNSS, radar, setpoints.

    `deadline`: for the brain to answer [s].
    """
    ports = free_ports(3)
    text = (REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8")
    free = dict(zip(("5001", "5002", "5003"), map(str, ports), strict=True))
    text, replaced = re.subn(r"\b500[123]\b", lambda found: free[found[0]], text)
    assert replaced == len(free)
    text = text.replace("[brain]\n", f"[brain]\ndeadline_s = {deadline}\n")
    (folder / "foreign.toml").write_text(text + more, encoding="utf-8")
    return ports


@contextmanager
def running(words: list[str], port: int) -> Iterator[None]:
    """Have a brain run while the block does, which begins when the brain listens on a UDP port."""
    with subprocess.Popen(words) as process:
        try:
            limit = time.monotonic() + 60.0
            while f":{port:04X} " not in Path("/proc/net/udp").read_text(encoding="ascii"):
                assert process.poll() is None
                assert time.monotonic() < limit
                time.sleep(0.02)
            yield
        finally:
            process.kill()
