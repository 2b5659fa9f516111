"""What is kept of the signals is what SUMO shows at every step, also at the newest."""

from __future__ import annotations

import math
from itertools import count
from pathlib import Path
from typing import Any

import libsumo
import pytest

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, pose
from vve_sumo.intersections import SignalPhase
from vve_sumo.record.signals import SIGNALS, read_signals, signals_text
from vve_sumo.values import EGO, SignalChange
from vve_sumo.world.world import World

STEPS = 1000


def _driven(
    network: str,
) -> tuple[list[SignalChange], list[dict[str, str]], list[dict[str, str]], list[dict[str, SignalPhase]]]:
    """Return the changes, what every signal showed after each step, and what the road said then, in two ways."""
    with World(Path(network), seed=1, period=PERIOD, egos=ALONE) as world:
        shown, said, timed, phases = [], [], [], world.timed_signals()
        for k in range(STEPS):
            world.step({EGO: pose(k * PERIOD, 1000.0, 1000.0, 0.0, 0.0)})
            lights = libsumo.trafficlight
            shown.append({name: lights.getRedYellowGreenState(name) for name in lights.getIDList()})
            said.append(dict(world.signals_now))
            timed.append(dict(phases(k * PERIOD)))
            # Whoever asks late, of a street that lags, is told no later end.
            for name, phase in phases(k * PERIOD + 0.1).items():
                assert math.isclose(phase.remaining, max(timed[-1][name].remaining - 0.1, 0.0), abs_tol=1e-9)
        return list(world.signals), shown, said, timed


@pytest.fixture(scope="module")
def driven(repository: Path) -> Any:
    return isolated(_driven, str(repository / "networks" / "linden.net.xml"))


def test_the_changes_say_what_sumo_showed_after_every_step(driven: Any) -> None:
    changes, shown, said, _timed = driven
    assert len(shown[0]) == 6
    assert len(changes) > 2 * 6
    assert said == shown
    states: dict[str, str] = {}
    waiting = iter(changes)
    change = next(waiting, None)
    for k in count():
        while change is not None and change.time <= k * PERIOD + 1e-9:
            assert states.get(change.signal) != change.state
            states[change.signal] = change.state
            change = next(waiting, None)
        assert states == shown[k]
        if k == STEPS - 1:
            break
    assert change is None


def test_a_signal_shows_what_it_shows_for_exactly_as_long_as_it_says(driven: Any) -> None:
    """The programs of this network have fixed times, and each of their phases shows something else."""
    changes, shown, _said, timed = driven
    next_changes: dict[str, list[float]] = {}
    for change in changes:
        next_changes.setdefault(change.signal, []).append(change.time)
    compared = 0
    for k, phases in enumerate(timed):
        assert {name: phase.state for name, phase in phases.items()} == shown[k]
        for name, phase in phases.items():
            coming = [time for time in next_changes[name] if time > k * PERIOD + 1e-9]
            if coming:
                assert k * PERIOD + phase.remaining == pytest.approx(coming[0], abs=1e-6)
                compared += 1
            else:
                assert phase.remaining > (STEPS - 1 - k) * PERIOD - 1e-6
    assert compared > STEPS


def test_the_file_gives_back_what_was_written(driven: Any, tmp_path: Path) -> None:
    changes = driven[0]
    (tmp_path / SIGNALS).write_text(signals_text(changes), encoding="utf-8")
    reported = read_signals(tmp_path)
    again = sorted((time, name, state) for name, pair in reported.items() for time, state in zip(*pair, strict=True))
    assert again == sorted((round(one.time, 3), one.signal, one.state) for one in changes)


@pytest.mark.parametrize("content", [None, "", "[1]", '{"a": 3}', '{"a": [["x"], ["r"]]}', "\ud800"])
def test_a_file_that_says_nothing_of_signals_is_none(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / SIGNALS).write_bytes(content.encode("utf-8", "surrogatepass"))
    assert read_signals(tmp_path) == {}
