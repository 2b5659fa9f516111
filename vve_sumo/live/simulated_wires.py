"""Keeps a process, and every process that it starts, from opening anything but simulated wires: for rehearsals.

An audit hook of the interpreter looks at every file, socket and library that is opened, by whatever code; once
installed, nothing takes it out again. What it refuses is not opened: serial ports and other devices, CAN and raw
sockets, addresses of other machines, and libraries of CAN cards' makers. It knows no rig.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import stat
import sys
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import RigError

#: environment variable by which the processes that are started know that they belong to a rehearsal
MARK: Final = "VVE_SUMO_SIMULATED_WIRES"
#: majors of the Linux kernel's character devices that lead to no hardware (Documentation/admin-guide/devices.txt):
#: memory (null, urandom), the terminal of this process with the maker of pseudo-terminals, and pseudo-terminals
HARMLESS_MAJORS: Final = frozenset({1, 5, *range(136, 144)})
#: minor of /dev/console, which may be a serial line, among those of major 5
CONSOLE: Final = (5, 1)
#: of sockets; -1 is Python's word for internet, and for that of a descriptor that is open already
FAMILIES: Final = frozenset({socket.AF_UNIX, socket.AF_INET, socket.AF_INET6, -1})
ADDRESS_EVENTS: Final = frozenset({"socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg"})
#: of names of libraries through which python-can's drivers reach cards
DRIVER_LIBRARIES: Final = (
    "canlib", "pcan", "vxlapi", "vci", "nican", "usb2can", "canal", "icsneo", "ucan", "nixnet", "controlcan", "zlg",
    "libusb",
)  # fmt: skip


def forbid_hardware() -> None:
    """Refuse hardware from now on in this process and in those that it starts, for as long as they live."""
    os.environ[MARK] = "1"
    sys.addaudithook(_refuse)


def forbid_hardware_in_rehearsal() -> None:
    """Call `forbid_hardware` where this process was started by one that had."""
    if os.environ.get(MARK):
        forbid_hardware()


def refusal(event: str, arguments: tuple[Any, ...]) -> str:
    """Return what of an audit event (docs.python.org, "Audit events table") leads to hardware; empty for nothing."""
    if event == "open":
        return _device(arguments[0])
    if event == "socket.__new__" and arguments[1] not in FAMILIES:
        return f"a socket of family {arguments[1]}"
    if event in ADDRESS_EVENTS:
        return _elsewhere(arguments[1])
    if event == "ctypes.dlopen":
        name = Path(str(arguments[0] or "")).name.lower()
        return f"library {name}" if any(part in name for part in DRIVER_LIBRARIES) else ""
    return ""


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    if what := refusal(event, arguments):
        raise RigError(f"rehearsal: {what} is refused, for nothing but simulated wires is opened")


def _device(path: object) -> str:
    """Return the name of a device that is hardware; links are followed. Empty for anything else."""
    if not isinstance(path, (str, bytes, os.PathLike)):
        return ""  # a descriptor that is open already
    try:
        found = Path(os.fsdecode(path)).stat()
    except (OSError, ValueError):
        return ""  # which opens nothing either, or makes a new file
    return "" if is_harmless(found.st_mode, found.st_rdev) else f"device {os.fsdecode(path)}"


def is_harmless(mode: int, device: int) -> bool:
    """Return whether a file of this mode (stat) and device number is no hardware."""
    if stat.S_ISBLK(mode):
        return False
    if not stat.S_ISCHR(mode):
        return True
    number = os.major(device), os.minor(device)
    return number[0] in HARMLESS_MAJORS and number != CONSOLE


def _elsewhere(address: object) -> str:
    """Return an internet address that is not this machine's loopback; empty for other addresses."""
    if not (isinstance(address, tuple) and address and isinstance(address[0], str)):
        return ""
    host = address[0]
    try:
        here = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        here = False
    return "" if here else f"address {host or 'of every network'}"
