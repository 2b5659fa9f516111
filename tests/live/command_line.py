"""Rigs of a test's own and the command run on them."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

from tests.conftest import REPOSITORY

SIMULATED = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
#: a real car's rig, without anything that only the car itself tells
WATCHDOG = "[watchdog_test]\ndate = 2026-01-01\narmed = true\ndeceleration_mps2 = 2.5\ndelay_s = 0.12\n"


def free_port() -> int:
    """A UDP port of the loopback that nobody has right now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def own_rig(folder: Path, *changes: tuple[str, str], name: str = "mine") -> Path:
    """Write the simulated vehicle as a rig of the test's own, on a port of its own, with passages changed."""
    text = SIMULATED.replace("port = 3000", f"port = {free_port()}")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    file = folder / f"{name}.toml"
    file.write_text(text, encoding="utf-8")
    return file


def outline(*corners: tuple[float, float]) -> tuple[str, str]:
    """The change of the simulated rig's lot to these corners, without holes."""
    begin, end = SIMULATED.index("outline = ["), SIMULATED.index("[alignment]")
    inside = ", ".join(f"[{latitude:.7f}, {longitude:.7f}]" for latitude, longitude in corners)
    return SIMULATED[begin:end], f"outline = [{inside}]\n\n"


def begun(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    """Start the command with the checkout's package; nobody is at its keyboard."""
    return subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", *arguments],
        cwd=cwd,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(REPOSITORY), "HOME": str(cwd)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def vve_sumo(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    process = begun(*arguments, cwd=cwd)
    out, err = process.communicate(timeout=300)
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)
