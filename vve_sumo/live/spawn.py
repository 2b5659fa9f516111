"""Starts a process of a live drive, and receives its configuration in the started process.

Knows how a configuration and the ends of channels get from one process to another, not what they are for.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from vve_sumo.live.channel import Channel, adopt
from vve_sumo.live.simulated_wires import forbid_hardware_in_rehearsal


def start(
    module: str,
    config: dict[str, Any],
    channels: dict[str, Channel],
    *,
    own_session: bool = False,
    inherited: tuple[int, ...] = (),
) -> subprocess.Popen[bytes]:
    """Start `vve_sumo.live.<module>` as a process of its own and hand it `config` (plain JSON) and `channels`.

    The ends are closed in this process. The started one's output goes to the file that config["log"] names, else to
    this one's standard error. With `own_session`, neither keys nor the closing of this terminal reach the process. The
    file descriptors in `inherited` stay open in it until it ends.
    """
    handed = {name: channel.fileno() for name, channel in channels.items()}
    log = config.get("log")
    with Path(log).open("ab") if log else contextlib.nullcontext(2) as output:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", f"vve_sumo.live.{module}"],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=output,
            env={**os.environ, "PYTHONPATH": _search_path()},
            pass_fds=(*handed.values(), *inherited),
            start_new_session=own_session,
        )
    for channel in channels.values():
        channel.close()
    _tell(process, json.dumps({"config": config, "channels": handed}).encode())
    return process


def end(process: subprocess.Popen[bytes], timeout: float) -> None:
    """Wait for a process that ends because its channel was closed; after `timeout` [s] it is killed."""
    try:
        process.wait(timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def receive_config() -> tuple[dict[str, Any], dict[str, Channel]]:
    """Return what `start` handed to this process; to be called once, before anything else.

    A process of a rehearsal can open no hardware from then on.
    """
    forbid_hardware_in_rehearsal()
    handed = json.load(sys.stdin.buffer)
    return handed["config"], {name: adopt(descriptor) for name, descriptor in handed["channels"].items()}


def _tell(process: subprocess.Popen[bytes], text: bytes) -> None:
    """Write to a process's standard input and close it; one that has died already shows by its closed channels."""
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError), process.stdin as stdin:
        stdin.write(text)


def _search_path() -> str:
    """Return the folders that this process searches before its standard library, for the new one to search them too.

    The new one does not search its working folder (-P), where any file could pass for one of the modules.
    """
    ahead = []
    for place in sys.path:
        if place == sysconfig.get_path("stdlib") or place.endswith(".zip"):
            break
        ahead.append(str(Path(place or ".").absolute()))
    return os.pathsep.join(ahead)
