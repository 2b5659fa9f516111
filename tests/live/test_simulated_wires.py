"""A process of a rehearsal opens no hardware, and neither does one that it starts, whatever code asks for it."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.live.simulated_wires import MARK, is_harmless, refusal


@pytest.mark.parametrize(
    ("kind", "major", "minor", "harmless"),
    [
        (stat.S_IFCHR, 188, 0, False),  # ttyUSB0
        (stat.S_IFCHR, 166, 0, False),  # ttyACM0
        (stat.S_IFCHR, 4, 64, False),  # ttyS0
        (stat.S_IFCHR, 204, 64, False),  # ttyAMA0
        (stat.S_IFCHR, 5, 1, False),  # console
        (stat.S_IFCHR, 180, 0, False),  # of USB
        (stat.S_IFBLK, 8, 0, False),  # a disk
        (stat.S_IFCHR, 1, 3, True),  # null
        (stat.S_IFCHR, 5, 2, True),  # ptmx
        (stat.S_IFCHR, 136, 4, True),  # pts/4
        (stat.S_IFREG, 0, 0, True),
        (stat.S_IFDIR, 0, 0, True),
    ],
)
def test_devices_that_lead_to_hardware(kind: int, major: int, minor: int, harmless: bool) -> None:
    assert is_harmless(kind | 0o600, os.makedev(major, minor)) is harmless


@pytest.mark.parametrize(
    ("event", "arguments", "refused"),
    [
        ("socket.__new__", (None, 29, socket.SOCK_RAW, 1), "family 29"),  # AF_CAN
        ("socket.__new__", (None, 17, socket.SOCK_RAW, 3), "family 17"),  # AF_PACKET
        ("socket.__new__", (None, socket.AF_INET, socket.SOCK_DGRAM, 0), ""),
        ("socket.__new__", (None, -1, -1, -1), ""),  # of a descriptor
        ("socket.bind", (None, ("0.0.0.0", 3000)), "0.0.0.0"),
        ("socket.bind", (None, ("", 3000)), "every network"),
        ("socket.bind", (None, ("127.0.0.1", 3000)), ""),
        ("socket.bind", (None, b"\0vve_sumo rig"), ""),
        ("socket.connect", (None, ("192.168.25.44", 3000)), "192.168.25.44"),
        ("socket.connect", (None, ("receiver.local", 3000)), "receiver.local"),
        ("socket.sendto", (None, ("239.74.163.2", 43113)), "239.74.163.2"),
        ("ctypes.dlopen", ("/usr/lib/libpcanbasic.so",), "libpcanbasic"),
        ("ctypes.dlopen", ("libcanlib.so.1",), "libcanlib"),
        ("ctypes.dlopen", (None,), ""),
        ("open", ("/dev/null", "r", 0), ""),
        ("open", ("/etc/hostname", "r", 0), ""),
        ("open", (3, "r", 0), ""),
    ],
)
def test_what_is_refused(event: str, arguments: tuple, refused: str) -> None:
    what = refusal(event, arguments)
    assert (refused in what) if refused else what == ""


TRIES = """
import socket, sys
from vve_sumo.live.spawn import receive_config
receive_config()
from vve_sumo.errors import VveError
from vve_sumo.bus import Bus
from vve_sumo.pose.sources import open_serial, open_tcp, open_udp
tries = {
    "card": lambda: Bus("socketcan", "can0"),
    "cloud": lambda: Bus("udp_multicast", "239.74.163.2"),
    "pcan": lambda: Bus("pcan", "PCAN_USBBUS1"),
    "serial": lambda: open_serial(sys.argv[1], 115200),
    "adapter": lambda: Bus("slcan", sys.argv[1]),
    "broadcast": lambda: open_udp("0.0.0.0", 3999, "192.168.25.44"),
    "server": lambda: open_tcp("192.168.25.44", 3000),
    "raw": lambda: socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW),
}
for name, tried in tries.items():
    try:
        tried()
    except (VveError, OSError) as error:
        print(name, "refused" if "rehearsal" in str(error) else error)
    else:
        print(name, "opened")
"""


def test_no_door_of_the_program_opens_hardware_in_a_process_of_a_rehearsal(tmp_path: Path) -> None:
    """A link to a device is followed. The one that there is everywhere and that counts as hardware is the console."""
    line = next((one for one in ("/dev/ttyS0", "/dev/console") if Path(one).exists()), None)
    if line is None:
        pytest.skip("no device of this machine is hardware")
    (tmp_path / "innocent.pty").symlink_to(line)
    done = subprocess.run(
        [sys.executable, "-c", TRIES, str(tmp_path / "innocent.pty")],
        input='{"config": {}, "channels": {}}',
        env={**os.environ, MARK: "1", "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    said = dict(row.split(" ", 1) for row in done.stdout.splitlines())
    assert done.returncode == 0, done.stderr
    assert said.pop("pcan").startswith(("refused", "CAN bus pcan")), "or its library is not installed"
    assert len(said) == 7
    assert set(said.values()) == {"refused"}, said
