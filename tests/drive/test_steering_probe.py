"""Steering margins by drives through the real tick: stable below the predicted delay, lost above it, by 5 % each."""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from vve_sumo.drive.resolved_scenario import ResolvedScenario, resolve_scenario
from vve_sumo.drive.steering_margins import predicted_margin, steering_margins
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.overrides import apply_overrides


def probe(changes: dict[str, Any]) -> ResolvedScenario:
    file = REPOSITORY / "scenarios" / "steering_probe.toml"
    table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), changes)
    return resolve_scenario("steering_probe", parse(table, file), file, REPOSITORY)


def _driven(changes: dict[str, Any]) -> tuple[str, str, str]:
    import tempfile
    from pathlib import Path

    from vve_sumo.drive import run as drives

    with tempfile.TemporaryDirectory() as scratch:
        summary = drives.run(probe(changes), Path(scratch) / "record", REPOSITORY).summary
    return summary["outcome"], "; ".join(summary["reasons"]), summary["record_sha256"]


@cache
def outcome(speed: float, delay: float, observer: float, mass: float = 1.0) -> tuple[str, str, str]:
    """Return outcome, reasons and the record's hash of a drive with a delay of the steering [s]."""
    found = isolated(
        _driven,
        {
            "ego.speed_mps": speed,
            "ego.car.steering_delay_s": delay,
            "ego.car.mass_factor": mass,
            "controller.tuning.cdob_time_constant_s": observer,
        },
    )
    print(f"{speed} m/s, {1e3 * delay:.0f} ms, observer {observer} s, mass x {mass}: {found}")
    return found


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("observer", [0.0, 0.1])
@pytest.mark.parametrize("speed", [10.0, 4.0, 7.0, 13.0, 16.0])
def test_the_drive_is_lost_where_the_closed_form_says(speed: float, observer: float) -> None:
    limit = predicted_margin(probe({}), REPOSITORY, speed, 1.0, observer)
    assert outcome(speed, 0.95 * limit, observer)[0] == "stopped"
    above = outcome(speed, 1.05 * limit, observer)
    assert above[0] == "timeout" or (above[0] == "fault" and above[1] in ("off_path", "steering_not_following"))


@pytest.mark.thorough
def test_a_car_that_is_heavier_than_declared() -> None:
    speed = 10.0
    limit = predicted_margin(probe({}), REPOSITORY, speed, 1.3, 0.1)
    assert limit < predicted_margin(probe({}), REPOSITORY, speed, 1.0, 0.1)
    assert outcome(speed, 0.95 * limit, 0.1, 1.3)[0] == "stopped"
    assert outcome(speed, 1.05 * limit, 0.1, 1.3)[0] != "stopped"


@pytest.mark.thorough
def test_a_probe_drives_the_same_twice() -> None:
    first = outcome(10.0, 0.3, 0.1)
    outcome.cache_clear()
    assert outcome(10.0, 0.3, 0.1) == first


def test_margins_count_the_observer_that_the_controller_declares() -> None:
    plain, observed = probe({}), probe({"controller.tuning.cdob_time_constant_s": 0.1})
    margins = [min(row.delay_margin for row in steering_margins(one, REPOSITORY).rows) for one in (plain, observed)]
    assert margins[1] > 4.0 * margins[0]
    longer = probe({"controller.tuning.cdob_time_constant_s": 0.1, "controller.tuning.cdob_washout_s": 6.0})
    assert steering_margins(longer, REPOSITORY).delay == pytest.approx(2.0 * margins[1], rel=0.1)


def test_a_delay_of_the_steering_that_is_none_leaves_the_scenarios_table_as_it_was() -> None:
    def cars(delay: float) -> dict[str, Any]:
        return probe({"ego.car.steering_delay_s": delay}).scenario.ego.car.model_dump()

    assert "steering_delay_s" not in cars(0.0)
    assert cars(0.2) == cars(0.0) | {"steering_delay_s": 0.2}
