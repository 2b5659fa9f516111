"""What a delay costs: speed times delay where it is hidden from the fix's epoch, nothing where it is declared.

The radar is ideal, the noise off and the brake open loop, so that what is left is the delay alone. Phase is equal: 100
ms are five ticks and two scans, and the probe counts from the instant at which its trigger was passed, not from the
tick. The base has a receiver without any delay. The trust gate refuses a fix that is 100 ms old when it arrives, so the
declared one comes after 99 ms: in time for the same tick, which then drives on a fix 100 ms old.
"""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any, NamedTuple

import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated

SPEED = 13.9  #: of the scenario [m/s]


class Stop(NamedTuple):
    """Where a drive of the probe came to rest."""

    s: float  #: of the true rear axle [m]
    speed: float  #: true, when the brake was asked for [m/s]
    pose_age: float  #: of the fix that this was decided on [s]


def _probed(changes: dict[str, Any]) -> Stop:
    import tempfile
    from pathlib import Path

    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.record.reader import read_table
    from vve_sumo.scenario.load import parse
    from vve_sumo.scenario.overrides import apply_overrides

    file = REPOSITORY / "scenarios" / "delay_probe.toml"
    table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), changes)
    resolved = resolve_scenario("delay_probe", parse(table, file), file, REPOSITORY)
    with tempfile.TemporaryDirectory() as scratch:
        done = drives.run(resolved, Path(scratch) / "record", REPOSITORY)
        ticks = read_table(done.folder, "ticks")
    assert done.summary["outcome"] == "stopped", done.summary
    begun = ticks["note"].to_pylist().index("brake")
    x, y = (ticks[name][-1].as_py() for name in ("true_x_m", "true_y_m"))
    return Stop(
        resolved.path.project(x, y, None).s, ticks["true_speed_mps"][begun].as_py(), ticks["pose_age_s"][begun].as_py()
    )


@cache
def stop(hidden: float, declared: float) -> Stop:
    """Return where the probe comes to rest with delays [s]."""
    found = isolated(_probed, {"ego.car.gnss_hidden_delay_s": hidden, "ego.car.gnss_delay_s": declared})
    print(f"hidden {hidden} s, declared {declared} s: {found}")
    return found


@pytest.mark.thorough
def test_a_hidden_delay_moves_the_stop_by_speed_times_delay() -> None:
    base, late = stop(0.0, 0.0), stop(0.1, 0.0)
    assert base.speed == pytest.approx(SPEED, abs=0.02)
    assert late.speed == pytest.approx(base.speed, abs=0.005)  # it had settled, and to the same
    assert late.pose_age == pytest.approx(base.pose_age, abs=1e-6)  # the pipeline cannot tell
    assert late.s - base.s == pytest.approx(SPEED * 0.1, abs=0.05)


@pytest.mark.thorough
def test_the_same_delay_declared_is_predicted_away() -> None:
    base, late = stop(0.0, 0.0), stop(0.0, 0.099)
    assert late.pose_age - base.pose_age == pytest.approx(0.1, abs=0.0011)
    assert late.speed == pytest.approx(base.speed, abs=0.005)
    assert abs(late.s - base.s) <= 0.05
