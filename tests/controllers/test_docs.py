"""The page on controllers: its example drives, its table is the code's."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import REPOSITORY
from tests.controllers.street import FUSION, Flaws, Obstacle, drive
from tests.controllers.test_car_following import steady_gap
from tests.drive.street import drive_once
from tests.exhaustive import with_slow
from tests.isolated import isolated
from vve_sumo.controller import load
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath

SHIPPED = REPOSITORY / "controllers"


@pytest.fixture
def page(repository):
    return (repository / "docs" / "controllers.md").read_text(encoding="utf-8")


def documented(page, pattern):
    """The numbers of a sentence on the page, wherever its lines are broken."""
    return tuple(map(float, re.search(pattern, " ".join(page.split())).groups()))


@pytest.fixture
def example(page, tmp_path):
    """The page's controller, saved as it stands there."""
    text, _of_parts, _tolerant = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    said = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    assert len(said) <= 30
    file = tmp_path / "mine.py"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.thorough
@pytest.mark.parametrize(
    "changes",
    with_slow([{"seed": 1}, {"seed": 2, "obstacles.0.at_m": 400.0}], lambda changes: changes["seed"] == 2),
)
def test_the_example_passes_the_shipped_scenario(page, example, changes):
    """The car with all its flaws, radar noise and traffic; what the page says of the drive, and of a shorter one."""
    within, least, most = documented(page, r"within (\S+) m of the path and stops (\S+) to (\S+) m before")
    summary = isolated(drive_once, changes | {"controller": {"name": f"{example}:make"}})
    assert summary["outcome"] == "stopped", summary
    assert summary["collision"] is False
    assert least <= summary["stop_gap_m"] <= most
    assert summary["max_lateral_deviation_m"] <= within
    assert summary["failed"] == []


@pytest.mark.thorough
def test_the_example_made_of_shipped_parts_keeps_its_gap(page, tmp_path, monkeypatch):
    """In a folder of its own, where no `controllers/` lies; the gap in equilibrium is the law's closed form."""
    _first, text, _tolerant = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert sum(bool(line.strip()) for line in text.splitlines()) <= 20
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    gap, speed = steady_gap("mine.py:make", {}, 6.0)
    assert gap == pytest.approx(5.0 + 0.15 * speed**2, abs=0.3)


def test_the_example_with_an_observer_bears_a_late_link(page, tmp_path):
    """0.7 s of delay: the law alone, made by name, swings off a straight road, the example keeps it."""
    _first, _of_parts, text = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    late = replace(FUSION, steering_delay=FUSION.steering_delay + 0.7)
    path = ReferencePath.from_points([0.0, 2000.0], [0.0, 0.0])
    off = []
    for name, keys, folder in (("mine", {}, tmp_path), ("follow_and_stop", {"steering": "stanley"}, SHIPPED)):
        controller = load(name, FUSION, keys, [folder])
        done = drive(controller, path, 10.0, [], 40.0, vehicle=late, start_speed=10.0, flaws=Flaws(steering_zero=0.0))
        off.append(float(np.abs(done.d).max()))
    assert off[0] < 1.0 < off[1]


@pytest.mark.slow
def test_the_example_stops_at_the_end_of_the_path(example):
    changes = {"obstacles": [], "road.demand": [], "controller": {"name": f"{example}:make"}}
    summary = isolated(drive_once, changes)
    assert summary["outcome"] == "arrived", summary
    assert summary["collision"] is False


def test_the_example_takes_tuning_and_names_a_wrong_key(example):
    controller = load("mine", FUSION, {"gap_m": 8.0}, [example.parent])
    x = np.arange(0.0, 200.0)
    path = ReferencePath.from_points(x, 4.0 * np.tanh((x - 60.0) / 20.0))
    done = drive(controller, path, 9.0, [Obstacle(150.0)], 60.0)
    assert np.abs(done.d).max() < 0.4
    assert done.speed[-1] == 0.0
    assert done.gap[-1] == pytest.approx(8.0, abs=1.0)
    with pytest.raises(ConfigError, match="allowed are gap_m, look_ahead_s"):
        load("mine", FUSION, {"gap": 6.0}, [example.parent])


@pytest.mark.slow
def test_a_car_parked_askew_is_seen_too_late(page):
    """The limit that the page admits of the shipped controller; when this fails, the page is to be rewritten."""
    aside, turned = documented(page, r"a car (\S+) m left of the path and turned by (\S+)°")
    askew = {"id": "askew", "at_m": 639.0, "offset_m": aside, "turned_deg": turned}
    summary = isolated(drive_once, {"road.demand": [], "obstacles": [askew]})
    assert summary["collision"] is True
    assert summary["impact_speed_mps"] == pytest.approx(25 * 0.44704, abs=0.3)


def test_the_design_table_has_units_in_its_heads(part):
    design = part("design")
    head, row = design.table([design.SpeedRow(11.2, 9.0, 0.072, 16.8, 65.1, 0.431)]).splitlines()
    assert dict(zip(head.split(), map(float, row.split()), strict=True)) == {
        "speed_mps": 11.2,
        "look_ahead_m": 9.0,
        "kp_rad_per_m": 0.072,
        "gain_margin_db": 16.8,
        "phase_margin_deg": 65.1,
        "delay_margin_ms": 431.0,
    }


def test_the_table_of_tuning_keys_is_the_codes(page, part):
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| ([^|]*)\|", page, re.MULTILINE)
    documented = {key: value.strip("`") for key, value, _ in rows}
    tuning = part("follow_and_stop").TUNING
    assert documented == {
        key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in tuning.items()
    }


def test_every_shipped_file_is_on_the_page(page, repository):
    for file in (repository / "controllers").glob("*.py"):
        assert f"`{file.name}`" in page
