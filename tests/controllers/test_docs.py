"""The page on controllers: its example drives, its table is the code's."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.controllers.street import FUSION, Obstacle, drive
from vve_sumo.controller import load
from vve_sumo.errors import ConfigError
from vve_sumo.path import Path


@pytest.fixture
def page(repository):
    return (repository / "docs" / "controllers.md").read_text(encoding="utf-8")


def test_the_example_drives_keeps_the_path_and_stops(page, tmp_path):
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(example.splitlines()) <= 40
    (tmp_path / "mine.py").write_text(example)
    controller = load("mine", FUSION, {"gap_m": 6.0}, [tmp_path])
    x = np.arange(0.0, 200.0)
    path = Path.from_points(x, 4.0 * np.tanh((x - 60.0) / 20.0))
    done = drive(controller, path, 9.0, [Obstacle(150.0)], 60.0)
    assert np.abs(done.offset).max() < 0.4
    assert done.speed[-1] == 0.0
    assert done.gap[-1] == pytest.approx(6.0, abs=1.0)
    with pytest.raises(ConfigError, match="allowed are gap_m, look_ahead_m"):
        load("mine", FUSION, {"gap": 6.0}, [tmp_path])


def test_the_table_of_tuning_keys_is_the_codes(page, part):
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| ([^|]*)\|", page, re.MULTILINE)
    told = {key: value.strip("`") for key, value, _ in rows}
    tuning = part("follow_and_stop").TUNING
    assert told == {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in tuning.items()}


def test_every_shipped_file_is_on_the_page(page, repository):
    for file in (repository / "controllers").glob("*.py"):
        assert f"`{file.name}`" in page
