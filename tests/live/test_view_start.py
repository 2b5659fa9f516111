"""A stop that the page asks for while its process starts is not lost: the drive does not begin."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vve_sumo.errors import RigError
from vve_sumo.live import optional_processes, spawn
from vve_sumo.live.messages import Ready, encode
from vve_sumo.rig.connections import RigView


@pytest.mark.parametrize("stops", [0, 1])
def test_a_stop_beside_the_word_that_the_page_is_ready_ends_the_start(
    stops: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(_name: str, _config: Any, channels: Any, **_more: Any) -> subprocess.Popen[bytes]:
        for said in (encode(Ready(("here",))), *[b"stop"] * stops):
            channels["console"].send(said)
        return subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)

    monkeypatch.setattr(spawn, "start", start)
    rig = SimpleNamespace(view=RigView(), outputs=(), v2x=None)
    nobody = SimpleNamespace(people=())
    plan: Any = SimpleNamespace(view=True, foxglove=False, rig=rig, resolved=nobody, folder=tmp_path, working=tmp_path)
    if stops:
        with pytest.raises(RigError, match="a page asked to stop before the drive began"):
            optional_processes.start(plan, {}, {"vehicle": {}}, lambda _: None)
        return
    started = optional_processes.start(plan, {}, {"vehicle": {}}, lambda _: None)
    assert started.view is not None
    with started.view as process:
        process.kill()
