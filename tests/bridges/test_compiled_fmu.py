"""An FMU that OpenModelica compiled and others publish, as a controller: its sum is a speed controller."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests import vehicles
from tests.bridges.law import PLACE
from tests.bridges.test_agent import observation, scan_of
from vve_sumo.bridges.observed_numbers import ObservationEncoder
from vve_sumo.controller import load
from vve_sumo.errors import ConfigError

pytest.importorskip("fmpy", reason="the extra fmi is not installed")

CAR = vehicles.FUSION.vehicle
GAIN = 0.8  # of the speed controller [1/s]
#: y = k1 u1 + k2 u2
MAPPING = f"""
[inputs]
u1 = "desired_speed_mps"
u2 = "speed_mps"

[outputs]
acceleration_mps2 = "y"

[parameters]
"add.k1" = {GAIN}
"add.k2" = {-GAIN}
"""


@pytest.fixture
def fmu() -> Path:
    place = os.environ.get("VVE_FMUS")
    if place is None:
        pytest.skip("the compiled FMUs are not there (VVE_FMUS; see tests/bridges/fmus.txt)")
    return Path(place) / "gemseo_fmu" / "problems" / "fmu_files" / "linux" / "add.fmu"


def test_an_fmu_of_openmodelica_commands_its_sum(fmu: Path, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAPPING, encoding="utf-8")
    mine = load("fmu", CAR, {"fmu": str(fmu), "mapping": str(tmp_path / "map.toml")}, ())
    encoder = ObservationEncoder(CAR)
    commands = []
    for tick in range(50):
        seen = observation(scan_of((150.0 - tick, 0.5, -5.0)))
        seen = replace(seen, time=2.0 + 0.02 * tick, desired_speed=5.0 + 0.1 * tick)
        numbers = encoder.numbers(seen)
        commands.append(mine.step(seen).acceleration)
        wanted = GAIN * (numbers[PLACE["desired_speed_mps"]] - numbers[PLACE["speed_mps"]])
        assert commands[-1] == pytest.approx(wanted, abs=1e-12)
    assert len(set(commands)) == 50


def test_a_variable_that_it_does_not_have_is_one_line(fmu: Path, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAPPING.replace("u2", "u3"), encoding="utf-8")
    with pytest.raises(ConfigError, match="u3") as refused:
        load("fmu", CAR, {"fmu": str(fmu), "mapping": str(tmp_path / "map.toml")}, ())
    assert "\n" not in str(refused.value)
