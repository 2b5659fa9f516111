"""Starting a process of a live drive, and what the started one does first.

Knows how a configuration and the ends of channels get from one process to another; not what they are for.
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


def start(
    module: str, config: dict[str, Any], channels: dict[str, Channel], *, own_session: bool = False
) -> subprocess.Popen[bytes]:
    """Start `vve_sumo.live.<module>` as a process of its own and hand it `config` (plain JSON) and `channels`.

    The ends are given away: they are closed here. What the process says goes to the file that config["log"] names,
    else to where ours goes. With `own_session`, no key of this terminal and no closing of it reaches the process.
    """
    handed = {name: channel.fileno() for name, channel in channels.items()}
    log = config.get("log")
    with Path(log).open("ab") if log else contextlib.nullcontext(2) as said:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", f"vve_sumo.live.{module}"],
            stdin=subprocess.PIPE,
            stdout=said,
            stderr=said,
            env={**os.environ, "PYTHONPATH": _search_path()},
            pass_fds=tuple(handed.values()),
            start_new_session=own_session,
        )
    for channel in channels.values():
        channel.close()
    _tell(process, json.dumps({"config": config, "channels": handed}).encode())
    return process


def receive_config() -> tuple[dict[str, Any], dict[str, Channel]]:
    """Return what `start` handed to this process; to be called once, before anything else."""
    handed = json.load(sys.stdin.buffer)
    return handed["config"], {name: adopt(descriptor) for name, descriptor in handed["channels"].items()}


def _tell(process: subprocess.Popen[bytes], text: bytes) -> None:
    """Write to a process's standard input and close it; one that died already is found dead by its closed channels."""
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError), process.stdin as stdin:
        stdin.write(text)


def _search_path() -> str:
    """Return what this process looks at before its standard library, so that the new one finds the same modules.

    The new one is told not to look into its working folder first, where any file could pass for one of them.
    """
    ahead = []
    for place in sys.path:
        if place == sysconfig.get_path("stdlib") or place.endswith(".zip"):
            break
        ahead.append(str(Path(place or ".").absolute()))
    return os.pathsep.join(ahead)
