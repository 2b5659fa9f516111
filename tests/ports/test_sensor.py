"""The radar and a sensor of an invented make against the port's suite; how one is found, fails and goes on wires."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import LineString, box

from tests.conftest import REPOSITORY
from tests.drive.street import altered
from tests.ports.sensor import PERIOD, SensorConformance
from tests.ports.toy_sensors import AHEAD, FINDER, LISTER
from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from vve_sumo.coded_texts import CodedTexts
from vve_sumo.drive.assembly import seed_of
from vve_sumo.drive.brain import Publisher, virtual_placement
from vve_sumo.drive.pipeline import SensorFrame
from vve_sumo.drive.reasons import DRIVE_REASONS
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Mounting, local_frame
from vve_sumo.rig.load import parse as parse_rig
from vve_sumo.scenario.load import parse
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import PORT, SensorColumn, SensorSettings, load
from vve_sumo.values import Actors, Detections, Pose
from vve_sumo.wire.sample import Sample, no_fix

SCENE = actors([car(30.0, 0.0)])


class TestLidar(SensorConformance):
    kind = "lidar"
    settings: ClassVar[dict[str, Any]] = {"rate_hz": 20.0, "azimuth_step_deg": 1.0, "range_sigma_m": 0.02}


class TestCamera(SensorConformance):
    kind = "camera"
    settings: ClassVar[dict[str, Any]] = {"false_objects": 0.1}


class TestV2x(SensorConformance):
    kind = "v2x"
    settings: ClassVar[dict[str, Any]] = {"latency_s": 0.1}


class TestRadar(SensorConformance):
    kind = "radar"


class TestIdealRadar(SensorConformance):
    kind = "radar"
    settings: ClassVar[dict[str, Any]] = {"ideal": True}


class TestRangeFinder(SensorConformance):
    kind = FINDER
    settings: ClassVar[dict[str, Any]] = {"width_m": 1.2}


class TestObjectList(SensorConformance):
    kind = LISTER


class TestObjectListByRays(SensorConformance):
    kind = LISTER
    settings: ClassVar[dict[str, Any]] = {"rays": True}


@pytest.mark.thorough
def test_the_toy_measures_what_another_geometry_says() -> None:
    """Against shapely: the nearest point of a box in the beam, at any place and turn of it."""
    chance = np.random.default_rng(7)
    compared = 0
    for _ in range(300):
        x, y, turn = chance.uniform(8.0, 40.0), chance.uniform(-4.0, 4.0), chance.uniform(-math.pi, math.pi)
        sensor = load(FINDER).model_validate({"sigma_m": 0.0}).sensor(FUSION, np.random.default_rng(1))
        sensor.step(0.0, rear_axle(), actors([car(x, y, turn)]))
        body = affinity.translate(affinity.rotate(box(-2.25, -0.9, 2.25, 0.9), turn, (0, 0), use_radians=True), x, y)
        beam = box(BUMPER, -0.75, BUMPER + 200.0, 0.75)
        seen = body.intersection(beam)
        expected = [] if seen.is_empty else [LineString([(BUMPER, -9.0), (BUMPER, 9.0)]).distance(seen)]
        assert sensor.output.range.tolist() == pytest.approx(expected, abs=1e-9)
        compared += len(expected)
    assert compared > 50


# --- how a kind is found ----------------------------------------------------------------------------------------------


def test_the_shipped_kinds_are_known() -> None:
    assert set(PORT.shipped) == {"radar", "lidar", "camera", "v2x", "signals", "right_of_way"} <= set(PORT.known())


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("def make():\n    return 7\n", "make returned 7, expected a class derived from SensorSettings"),
        ("def make():\n    raise OSError('no licence')\n", "make raised OSError: no licence"),
        ("import nothing_like_it\n", "raised ModuleNotFoundError: "),
        ("", r"offers no function make\(\)"),
        (
            "from vve_sumo.sensors.port import SensorSettings\n\n\ndef make():\n    return SensorSettings\n",
            "SensorSettings: lacks columns, observation, max_age, sensor",
        ),
    ],
)
def test_what_is_no_sensor_is_one_line(tmp_path: Path, lines: str, said: str) -> None:
    file = tmp_path / "poor.py"
    file.write_text(lines, encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as refused:
        load(f"{file}:make")
    assert str(refused.value).startswith(f"sensor {file}:make: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ((), "expected one or more"),
        ((("tick", "int", "a tick"),), "none of them 'tick'"),
        ((("a_m", "float", "x"), ("a_m", "float", "y")), "each name once"),
        ((("a_m", "double", "x"),), "column 'a_m' is of kind 'double', expected float, int, int8, bool, str"),
        ((("a_m", "float"),), "expected a tuple of name, kind and meaning each"),
    ],
)
def test_columns_that_no_table_can_have_are_refused(
    columns: tuple[Any, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vve_sumo.sensors.radar_settings import RadarSettings

    monkeypatch.setattr(RadarSettings, "columns", columns)
    with pytest.raises(ConfigError, match=said):
        load("radar")


def test_a_name_that_no_file_can_have_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"^sensor a+…: cannot be looked up: ") as refused:
        load(f"{'a' * 5000}.py:make")
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize(
    ("sensors", "said"),
    [
        ([AHEAD, AHEAD], "sensors: name 'ahead' stands twice, expected each once"),
        ([AHEAD | {"name": "radar"}], r"name 'radar' stands twice, that of the table \[radar\]"),
        ([AHEAD | {"name": "Ahead!"}], r"sensors\.0\.name: "),
        ([AHEAD | {"range_m": 1.0}], r"unknown key 'sensors\.0\.range_m'"),
        ([{"name": "ahead"}], r"key 'sensors\.0\.kind' is missing"),
        ([AHEAD | {"settings": {"width_m": math.nan}}], r"sensors\.0\.settings\.width_m: "),
    ],
)
def test_a_scenario_with_wrong_sensors_is_one_line(sensors: list[dict[str, Any]], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as refused:
        altered({"sensors": sensors})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        (
            AHEAD | {"settings": {"width": 1.0}},
            r"sensors\.ahead: sensor .*: unknown key 'width', did you mean",
        ),
        (AHEAD | {"settings": {"width_m": -1.0}}, r"sensors\.ahead: sensor .*: width_m: expected greater than 0"),
        (
            AHEAD | {"kind": "sonar"},
            r"sensors\.ahead: sensor sonar: unknown; known are camera, lidar, radar, right_of_way, signals, v2x",
        ),
        (
            {"name": "roof", "kind": "lidar", "settings": {"azimuth_step_deg": 0.7}},
            r"sensors\.roof: sensor lidar: .*azimuth_step_deg: expected a whole number of steps in 360, got 514\.286",
        ),
        (
            {"name": "roof", "kind": "lidar", "settings": {"channels_deg": [90.0]}},
            r"sensors\.roof: sensor lidar: channels_deg.*expected less than 90",
        ),
        (AHEAD | {"kind": "nowhere.py:make"}, r"sensors\.ahead: sensor nowhere\.py:make: there is no file nowhere\.py"),
    ],
)
def test_settings_that_a_kind_does_not_have_are_one_line(sensor: dict[str, Any], said: str) -> None:
    setting = altered({"sensors": [sensor]})
    with pytest.raises(ConfigError, match=said) as refused:
        setting.sensors()
    assert "\n" not in str(refused.value)


def test_a_parameter_may_set_a_key_of_a_sensor() -> None:
    table = json.loads(json.dumps(altered({"sensors": [AHEAD]}).scenario.model_dump(mode="json")))
    table["parameters"] = {"beam": {"sets": ["sensors.ahead.settings.sigma_m"]}}
    assert parse(table, Path("mine.toml")).parameters["beam"].sets == ("sensors.ahead.settings.sigma_m",)
    table["parameters"]["beam"]["sets"] = ["sensors.behind.settings.sigma_m"]
    with pytest.raises(ConfigError, match=r"no key 'sensors\.behind\.settings\.sigma_m' that takes a value"):
        parse(table, Path("mine.toml"))


def test_a_sensors_stream_is_nobody_else_s() -> None:
    names = ("radar", "vehicle", "sensor radar", "sensor vehicle", "sensor ahead")
    drawn = {tuple(np.random.default_rng(seed_of(3, name)).integers(0, 2**63, 4)) for name in names}
    assert len(drawn) == len(names)


# --- how one fails ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Number:
    """An observation of one number."""

    time: float
    number: float = 0.0


class Scripted(SensorSettings):
    """A sensor that gives what a test says, from its second tick on."""

    columns: ClassVar[tuple[SensorColumn, ...]] = (
        SensorColumn("a_m", "float", "a"), SensorColumn("n", "int8", "n"), SensorColumn("word", "str", "w")
    )  # fmt: skip
    observation: ClassVar[type] = Number
    script: ClassVar[Mapping[int, Any]] = {}

    def max_age(self) -> float:
        return 0.1

    def sensor(self, _vehicle: Any, _generator: Any, /) -> Any:
        return Script(self.script)


class Script:
    def __init__(self, script: Mapping[int, Any]) -> None:
        self.output: Any = Number(-math.inf)
        self.refused = 0
        self._script, self._tick = script, -1

    def step(self, time: float, _pose: Pose, _actors: Actors) -> Any:
        self._tick += 1
        given = self._script.get(self._tick, ([1.5], [1], ["x"]))
        if given is None:
            return None
        if isinstance(given, BaseException):
            raise given
        output, columns = given if isinstance(given[0], Number) else (Number(time, 1.0), given)
        self.output = output
        return type("Rows", (), {"columns": lambda _self: columns})()


def scripted(script: Mapping[int, Any]) -> GuardedSensor:
    kind = type("Mine", (Scripted,), {"script": script})
    return GuardedSensor("mine", kind(), FUSION, np.random.default_rng(1))


SOUND = ([1.5], [1], ["x"])
FAILURES: list[tuple[Any, str]] = [
    (ValueError("no"), "sensor_raised"),
    (SystemExit(), "sensor_raised"),
    (([math.nan], [1], ["x"]), "sensor_not_finite"),
    (([math.inf], [1], ["x"]), "sensor_not_finite"),
    ((Number(0.02, math.nan), SOUND), "sensor_not_finite"),
    ((Number(0.02, -math.inf), SOUND), "sensor_not_finite"),
    ((Number(0.02, np.float32("nan")), SOUND), "sensor_not_finite"),
    ((Number(0.02, np.array([0.0, math.nan], np.float16)), SOUND), "sensor_not_finite"),
    ((Number(0.02, (1.0, math.nan)), SOUND), "sensor_wrong_type"),
    ((Number(0.02, [math.nan]), SOUND), "sensor_wrong_type"),
    ((Number(0.02, None), SOUND), "sensor_wrong_type"),
    ((Number(0.02, np.array([math.nan], object)), SOUND), "sensor_wrong_type"),
    ((Number(0.02, complex(0.0, math.nan)), SOUND), "sensor_wrong_type"),
    ((Number(0.02, np.array([complex(0.0, math.nan)])), SOUND), "sensor_wrong_type"),
    ((Number(math.nan), SOUND), "sensor_wrong_type"),
    ((Number(0.04), SOUND), "sensor_wrong_type"),
    ((Number(0.0), SOUND), "sensor_wrong_type"),
    (([1.5], [1]), "sensor_wrong_type"),
    (([1.5, 2.5], [1], ["x"]), "sensor_wrong_type"),
    (([1.5], [300], ["x"]), "sensor_wrong_type"),
    (([1.5], [1.25], ["x"]), "sensor_wrong_type"),
    (([1.5], [1], [7]), "sensor_wrong_type"),
    (([1.5], [1], CodedTexts(np.zeros(1, np.int32), [7])), "sensor_wrong_type"),  # type: ignore[list-item]
    (([1.5], [1], CodedTexts(np.zeros(2, np.int32), ["x"])), "sensor_wrong_type"),
    ((["far"], [1], ["x"]), "sensor_wrong_type"),
    (([[1.5]], [1], ["x"]), "sensor_wrong_type"),
    ((7, [1], ["x"]), "sensor_wrong_type"),
    (([1.5], [1], 7), "sensor_raised"),
]


@pytest.mark.parametrize(("given", "code"), FAILURES)
def test_a_failure_is_a_reason_code_and_the_output_stays_the_last_sound_one(given: Any, code: str) -> None:
    sensor = scripted({1: given})
    assert sensor.step(0.0, rear_axle(), SCENE) is not None
    before = sensor.output
    assert sensor.step(PERIOD, rear_axle(), SCENE) is None
    assert sensor.faults == (code,)
    assert sensor.output is before
    assert sensor.text.startswith("sensor mine: ")
    assert sensor.step(2 * PERIOD, rear_axle(), SCENE) is not None, "and it goes on"
    assert sensor.faults == ()
    assert code in DRIVE_REASONS


def test_an_interrupt_is_the_operators() -> None:
    with pytest.raises(KeyboardInterrupt):
        scripted({0: KeyboardInterrupt()}).step(0.0, rear_axle(), SCENE)


def test_a_sensor_without_a_reading_is_late_once_its_time_is_over() -> None:
    sensor = scripted(dict.fromkeys([*range(20), *range(25, 60)]))
    late = [tick for tick in range(60) if (sensor.step(PERIOD * tick, rear_axle(), SCENE), sensor.faults)[1]]
    # Ticks of 0.02 s, 0.1 s allowed: from the first tick at 0 s, and from the reading at tick 24.
    assert late == [*range(6, 20), *range(30, 60)]


@pytest.mark.parametrize("age", [0.0, -1.0, math.nan])
def test_a_limit_of_no_time_is_refused(age: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Scripted, "max_age", lambda _self: age)
    with pytest.raises(ValueError, match="expected a positive time"):
        scripted({})


def test_nobody_can_write_to_what_was_measured() -> None:
    sensor = TestRadar().guarded()
    columns = next(c for tick in range(50) if (c := sensor.step(PERIOD * tick, rear_axle(), SCENE)) and len(c[0]))
    with pytest.raises(ValueError, match="read-only"):
        columns[0][0] = 0.0  # type: ignore[index]


# --- what of one goes out on wires ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("member", "value", "said"),
    [
        ("serves", ("tracks",), "serves 'tracks', expected detections"),
        ("observation", Number, "serves 'detections' with an observation of Number, expected Detections"),
    ],
)
def test_a_kind_that_serves_what_it_does_not_have_is_refused(
    member: str, value: Any, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vve_sumo.sensors.radar_settings import RadarSettings

    monkeypatch.setattr(RadarSettings, member, value)
    with pytest.raises(ConfigError, match=said):
        load("radar")


NOISY = {"name": "noisy", "kind": "radar", "settings": {"false_alarms": 3.0}}


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        ("noisy", ""),
        ("radar", ""),
        ("ahead", "outputs.2.sensor: 'ahead' serves no detections, which 'osi_data' carries"),
        ("absent", "outputs.2.sensor: the scenario has no sensor 'absent', expected radar or ahead or noisy"),
    ],
)
def test_a_wire_is_of_a_sensor_that_the_scenario_has_and_that_serves_it(sensor: str, said: str) -> None:
    table = tomllib.loads((REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8"))
    table["outputs"] = [*table["outputs"][:2], {"kind": "osi_data", "udp": "127.0.0.1:5077", "sensor": sensor}]
    rig = parse_rig(table, Path("rig.toml"))
    resolved = altered({"sensors": [AHEAD, NOISY]})
    if not said:
        assert resolved.with_rig(rig, REPOSITORY).scenario.sensors == resolved.scenario.sensors
        return
    with pytest.raises(ConfigError, match="^" + re.escape(said)):
        resolved.with_rig(rig, REPOSITORY)


def test_the_sample_of_a_tick_carries_every_sensor_s_detections() -> None:
    sent: list[Sample] = []
    scan = Detections(4.9, *(np.array([value]) for value in (30.0, 0.1, -5.0)), np.zeros(1, np.int8))
    other = replace(scan, time=4.95, range=np.array([12.5]))
    publisher = Publisher(sent.append, virtual_placement(local_frame(0.7, -1.4), Mounting(0.0, 0.0), 0.0), 0.0)
    seen = {"radar": scan, "noisy": other, "ahead": Number(4.9, 3.0)}
    publisher.publish(5.0, SensorFrame(rear_axle(), no_fix(5.0, 5.0), SCENE, seen), ())
    (sample,) = sent
    assert sample.measured is not None
    assert sample.measured.scan is scan
    assert dict(sample.measured.others) == {"noisy": other}
    as_noisy = sample.seen_by("noisy").measured
    assert as_noisy is not None
    assert (as_noisy.scan, as_noisy.scan_age) == (other, pytest.approx(0.05))
