"""What a sweep's dataset begins with: here the vehicle, which a sweep may vary and the command line may replace."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_file
from vve_sumo.sweep.plan import query_of

FUSION, MKZ = (hash_file(REPOSITORY / "vehicles" / f"{name}.toml") for name in ("ford_fusion", "lincoln_mkz"))


def sweep(folder: Path, parameters: str) -> str:
    file = folder / "mine.toml"
    file.write_text(f'scenario = "parked_car"\n[parameters]\n{parameters}\n', encoding="utf-8")
    return str(file)


def test_the_vehicle_is_a_parameter_like_any_other(tmp_path: Path) -> None:
    query = query_of(sweep(tmp_path, "ego.vehicle = ['ford_fusion', 'lincoln_mkz']"), REPOSITORY, yes=False)
    assert query.plan.cells == 2
    assert query.plan.files_sha256["vehicle"] == sorted([FUSION, MKZ])
    with pytest.raises(ConfigError, match=r"parameters\.ego\.vehicle: ego\.vehicle: no vehicle named 'tank'"):
        query_of(sweep(tmp_path, "ego.vehicle = ['tank']"), REPOSITORY, yes=False)


def test_the_command_line_replaces_the_scenarios_vehicle(tmp_path: Path) -> None:
    file = sweep(tmp_path, "ego.speed_mps = [5.0]")
    assert query_of(file, REPOSITORY, yes=False).plan.files_sha256["vehicle"] == [FUSION]
    assert query_of(file, REPOSITORY, yes=False, vehicle="lincoln_mkz").plan.files_sha256["vehicle"] == [MKZ]
    with pytest.raises(ConfigError, match=r"parked_car\.toml: ego\.vehicle: no vehicle named 'tank'"):
        query_of(file, REPOSITORY, yes=False, vehicle="tank")
