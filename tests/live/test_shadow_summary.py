"""A drive in shadow mode is no test of its criteria: the gateway commands nothing, whoever drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.drive.street import altered, drive_once
from tests.isolated import isolated
from tests.live.command_line import own_rig
from vve_sumo.drive.summary import without_verdict
from vve_sumo.live import session


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("shadow", [True, False])
def test_a_drive_that_commands_nothing_is_not_judged(tmp_path: Path, shadow: bool) -> None:
    changes = {"duration_s": 2.0}  # too short for its criteria
    assert isolated(drive_once, changes, str(tmp_path / "record"))["passed"] is False
    rig = str(own_rig(tmp_path))
    plan = session.plan("parked_car", rig, tmp_path, out=tmp_path / "out", seed=None, controller=None, shadow=shadow)
    plan = replace(plan, folder=tmp_path / "record", resolved=altered(changes))
    summary = session._summary(plan, (), lambda line: None)
    assert summary["shadow"] is shadow
    assert summary["passed"] is (None if shadow else False)
    assert bool(summary["failed"]) is not shadow
    assert without_verdict(summary) == summary | {"passed": None, "failed": []}
