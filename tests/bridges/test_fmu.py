"""A controller as an FMU against the same law in Python. FMUs are built by others' tools; bad ones are one line."""

from __future__ import annotations

import math
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import vve_sumo as vve
from tests import vehicles
from tests.bridges.law import PLACE
from tests.bridges.test_agent import observation, scan_of
from tests.isolated import command, isolated
from vve_sumo.bridges.observed_numbers import ObservationEncoder
from vve_sumo.controller import Guarded, load
from vve_sumo.errors import ConfigError

pytest.importorskip("fmpy", reason="the extra fmi is not installed")
pytest.importorskip("pythonfmu", reason="pythonfmu is not installed")

from tests.bridges import fmus
from vve_sumo.bridges.fmu import FmuController

CAR = vehicles.FUSION.vehicle
VERSIONS = [
    pytest.param("2.0"),
    pytest.param("3.0", marks=pytest.mark.skipif(not fmus.available("3.0"), reason="pythonfmu3 is not installed")),
]
MAPPING = """
[inputs]
speed = "speed_mps"
gap = "ahead_1_m"
desired = "desired_speed_mps"

[outputs]
acceleration_mps2 = "wanted"
emergency = "hard"
"""
NEAR = {"obstacles.parked_car.at_m": 50.0, "ego.speed_mps": 8.0}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Builds an FMU of a version once."""
    made: dict[str, Path] = {}

    def build(version: str) -> Path:
        if version not in made:
            made[version] = fmus.build(version, tmp_path_factory.mktemp("fmu"))
        return made[version]

    return build


def controller(fmu: Path, folder: Path, mapping: str = MAPPING) -> FmuController:
    """The FMU behind a mapping, steered by the shipped controller."""
    (folder / "map.toml").write_text(mapping)
    tuning = {"fmu": str(fmu), "mapping": str(folder / "map.toml")}
    made = load("fmu", CAR, tuning, ())
    assert isinstance(made, FmuController)
    return made


def law(numbers: list[float], rate: float = 2.0) -> float:
    """The FMU's law."""
    gap, speed = numbers[PLACE["ahead_1_m"]], numbers[PLACE["speed_mps"]]
    allowed = min(numbers[PLACE["desired_speed_mps"]], math.sqrt(max(0.0, 2.0 * rate * (gap - 6.0))))
    return -2.0 if allowed < 0.5 else min(max(1.5 * (allowed - speed), -3.4), 1.5)


def _commands_its_law(fmu: Path, folder: Path) -> int:
    mine = controller(fmu, folder, MAPPING + "[parameters]\nrate = 1.25\nlatch = false\n")
    encoder = ObservationEncoder(CAR)
    for tick, x in enumerate((180.0, 150.0, 125.0, 110.0)):
        seen = replace(observation(scan_of((x, 0.5, -5.0))), time=2.0 + 0.02 * tick)
        commanded = mine.step(seen)
        assert commanded.acceleration == law(encoder.numbers(seen), 1.25)
        assert commanded.emergency is False
        assert math.isfinite(commanded.steering)
    return tick + 1


@pytest.mark.parametrize("version", VERSIONS)
def test_the_fmu_commands_what_its_law_says_of_the_observation(
    version: str, built: Callable[[str], Path], tmp_path: Path
) -> None:
    # In a process of its own: FMUs of two makers that are Python themselves do not share one well.
    assert isolated(_commands_its_law, built(version), tmp_path) == 4


def test_the_fmus_time_is_the_drives_where_ticks_are_skipped(built: Callable[[str], Path], tmp_path: Path) -> None:
    mine = controller(built("2.0"), tmp_path, MAPPING.replace('"wanted"', '"steps"'))
    steps = [mine.step(replace(observation(), time=time)).acceleration for time in (2.0, 2.02, 2.08, 2.1)]
    assert steps == [1.0, 2.0, 5.0, 6.0]


def test_an_fmu_that_steers_does_so(built: Callable[[str], Path], tmp_path: Path) -> None:
    mapping = MAPPING.replace("[outputs]", '[outputs]\nsteering_rad = "steps"')
    assert controller(built("2.0"), tmp_path, mapping).step(observation()).steering == 1.0


def test_without_the_extra_its_name_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith(("fmpy", "vve_sumo.bridges.fmu"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(ConfigError, match=r"pip install 'vve-sumo\[fmi\]'") as raised:
        load("fmu", CAR, {}, ())
    assert "\n" not in str(raised.value)


@pytest.mark.thorough
@pytest.mark.parametrize("version", VERSIONS)
def test_an_fmu_drives_and_its_record_is_replayed(
    version: str, built: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "brake.toml").write_text(MAPPING)
    fmu = tmp_path / "brake.fmu"
    fmu.write_bytes(built(version).read_bytes())
    tuning = {"fmu": "brake.fmu", "mapping": "brake.toml"}
    scenario = vve.Scenario("delay_probe").replace(NEAR | {"controller": {"name": "fmu", "tuning": tuning}})
    first, again = (vve.drive(scenario, out=name, progress=False) for name in ("first", "again"))
    assert first.summary["outcome"] == "stopped"
    assert 3.0 < first.summary["stop_gap_m"] < 8.0
    assert first.summary["record_sha256"] == again.summary["record_sha256"]
    said = command("replay", "first", cwd=tmp_path)
    assert said.returncode == 0, said.stdout + said.stderr
    fmu.write_bytes(fmu.read_bytes() + b" ")  # a ZIP may be followed by more
    changed = command("replay", "first", cwd=tmp_path)
    assert "tuning_fmu has changed since" in changed.stdout + changed.stderr


@pytest.mark.parametrize(
    ("was", "now", "line"),
    [
        ('speed = "speed_mps"', 'speed = "sped_mps"', "inputs.speed: 'sped_mps' is not observed.*speed_mps"),
        ('speed = "speed_mps"', 'sped = "speed_mps"', "inputs.sped: expected an input of .*, it has no 'sped'.*speed"),
        ("speed = ", "wanted = ", "inputs.wanted: expected an input of .*, 'wanted' is its output"),
        ("speed = ", "latch = ", "inputs.latch: expected an input of .*, 'latch' is its parameter"),
        ('"wanted"', '"hard"', "outputs.acceleration_mps2: expected a number, 'hard' of the FMU is Boolean"),
        ('"hard"', '"wanted"', "outputs.emergency: expected a truth value, 'wanted' of the FMU is Real"),
        ("acceleration_mps2", "acceleration", "acceleration"),
        ('acceleration_mps2 = "wanted"', "", "acceleration_mps2"),
        ("[inputs]", "[other]", "unknown key 'other'"),
        ("[inputs]", "[inputs", "map.toml"),
        ("[outputs]", "[parameters]\nrat = 1.0\n[outputs]", "parameters.rat: expected a parameter of .*rate"),
        ("[outputs]", "[parameters]\nrate = true\n[outputs]", "parameters.rate: expected a truth value"),
        ("[outputs]", "[parameters]\nrate = nan\n[outputs]", "parameters: expected a finite number"),
        ("[inputs]", 'steered_by = "nobody"\n[inputs]', "controller nobody: unknown"),
    ],
)
def test_a_bad_mapping_is_one_line(was: str, now: str, line: str, built: Callable[[str], Path], tmp_path: Path) -> None:
    assert was in MAPPING
    with pytest.raises(ConfigError, match=line) as raised:
        controller(built("2.0"), tmp_path, MAPPING.replace(was, now, 1))
    assert "\n" not in str(raised.value)


def cut(fmu: Path) -> bytes:
    return fmu.read_bytes()[:1000]


def without_binaries(fmu: Path, version: str = "2.0", kind: str = "CoSimulation") -> bytes:
    """The FMU with nothing but its description, which says another version or kind."""
    with zipfile.ZipFile(fmu) as whole:
        description = whole.read("modelDescription.xml").decode()
    other = fmu.parent / "other.fmu"
    description = description.replace('fmiVersion="2.0"', f'fmiVersion="{version}"').replace("CoSimulation", kind)
    with zipfile.ZipFile(other, "w") as bare:
        bare.writestr("modelDescription.xml", description)
    return other.read_bytes()


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda fmu: b"", "expected an FMU, it can't be read"),
        (cut, "expected an FMU, it can't be read"),
        (without_binaries, "the FMU does not start"),
        (lambda fmu: without_binaries(fmu, version="1.0"), "expected"),
        (lambda fmu: without_binaries(fmu, kind="ModelExchange"), "expected"),
        (lambda fmu: None, "there is no such file"),
    ],
)
def test_a_file_that_is_no_such_fmu_is_one_line(
    make: Callable[[Path], bytes | None], line: str, built: Callable[[str], Path], tmp_path: Path
) -> None:
    file = tmp_path / "mine.fmu"
    if (content := make(built("2.0"))) is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=line) as raised:
        controller(file, tmp_path)
    assert "\n" not in str(raised.value)
    assert "mine.fmu" in str(raised.value)


@pytest.mark.parametrize(
    ("tuning", "line"), [({}, "'fmu': expected a file"), ({"fmu": "x", "map": "y"}, "'map' is unknown")]
)
def test_a_tuning_without_its_files_is_one_line(tuning: dict[str, Any], line: str) -> None:
    with pytest.raises(ConfigError, match=line):
        load("fmu", CAR, tuning, ())


def test_a_step_that_fails_is_a_reason_code(built: Callable[[str], Path], tmp_path: Path) -> None:
    mine = controller(built("2.0"), tmp_path)
    mine._steps = 7  # the FMU refuses a step that does not begin where the last one ended
    guarded = Guarded(mine)
    assert guarded.step(observation()) == (None, ("controller_raised",))
    assert "fmi2DoStep" in guarded.text
