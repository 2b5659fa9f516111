"""The radar and a sensor of an invented make against the port's suite; how a sensor is found, fails and drives."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from shapely import affinity
from shapely.geometry import LineString, box

from tests.conftest import REPOSITORY
from tests.drive.forge import change_json, seal_again
from tests.drive.street import altered, drive_once
from tests.isolated import isolated
from tests.ports.sensor import PERIOD, SensorConformance
from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from vve_sumo import cli
from vve_sumo.analysis.load import load as load_record
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

TOY = Path(__file__).parent / "toy"
FINDER = f"{TOY / 'range_finder.py'}:make"
LISTER = f"{TOY / 'object_list.py'}:make"
AHEAD = {"name": "ahead", "kind": FINDER, "settings": {"sigma_m": 0.05}}
GAP = 6.0
SCENE = actors([car(30.0, 0.0)])


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
    assert set(PORT.shipped) == {"radar"} <= set(PORT.known())


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
        (AHEAD | {"kind": "lidar"}, r"sensors\.ahead: sensor lidar: unknown; known are radar"),
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


# --- how one drives ---------------------------------------------------------------------------------------------------


def stop_for_the_range(folder: str, changes: dict[str, Any]) -> dict[str, Any]:
    """Drive the paper's scenario with the toy's controller and sensor; call it through `isolated`."""
    controller = {"name": f"{TOY / 'range_stop.py'}:make", "tuning": {"gap_m": GAP}}
    return drive_once({"sensors": [AHEAD], "controller": controller, "criteria": {}} | changes, folder)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("range") / "record"
    summary = isolated(stop_for_the_range, str(folder), {})
    assert summary["outcome"] == "stopped"
    assert not summary["collision"]
    return folder


def test_a_controller_stops_the_car_for_somebody_s_own_sensor(stopped: Path) -> None:
    """The gap at rest by shapely, from the recorded boxes, is the one asked for: to its noise and the crawl's end."""
    last = pq.read_table(stopped / "ticks.parquet").to_pylist()[-1]
    rows = pq.read_table(stopped / "actors.parquet").to_pylist()
    parked = next(row for row in rows if row["actor"] == "parked_car" and row["tick"] == last["tick"])
    body = box(-0.5 * parked["length_m"], -0.5 * parked["width_m"], 0.5 * parked["length_m"], 0.5 * parked["width_m"])
    body = affinity.rotate(body, parked["heading_rad"], (0, 0), use_radians=True)
    vehicle = json.loads((stopped / "scenario.json").read_text(encoding="utf-8"))["vehicle"]
    front = vehicle["wheelbase"] + vehicle["front_overhang"]
    ego = box(front - vehicle["length"], -0.5 * vehicle["width"], front, 0.5 * vehicle["width"])
    ego = affinity.rotate(ego, last["true_heading_rad"], (0, 0), use_radians=True)
    gap = affinity.translate(ego, last["true_x_m"], last["true_y_m"]).distance(
        affinity.translate(body, parked["x_m"], parked["y_m"])
    )
    assert last["true_speed_mps"] == pytest.approx(0.0, abs=1e-6)
    assert gap == pytest.approx(GAP, abs=1.0)


def test_what_it_measured_stands_in_a_table_of_its_own(stopped: Path) -> None:
    run = load_record(stopped)
    ranges = run.sensor("ahead")  # type: ignore[union-attr]
    readings = run.table("readings")  # type: ignore[union-attr]
    assert set(readings["sensor"]) == {"radar", "ahead"}
    assert ranges.attrs["units"]["range_m"] == "m"
    own = readings[readings["sensor"] == "ahead"]
    assert np.diff(own["tick"]).tolist() == [2] * (len(own) - 1)
    assert own["rows"].sum() == len(ranges) > 100
    assert (own.set_index("tick")["measured_s"] == 0.02 * own.set_index("tick").index).all()


def test_the_hash_of_its_code_is_in_the_record(stopped: Path) -> None:
    files = json.loads((stopped / "scenario.json").read_text(encoding="utf-8"))["files_sha256"]
    assert {"sensor_ahead:range_finder", "controller_range_stop"} <= files.keys()
    # Both parts lie in one folder, and neither's code counts as the other's.
    assert [role for role in files if role.startswith(("sensor_", "controller_"))] == [
        "controller_range_stop", "sensor_ahead:range_finder"
    ]  # fmt: skip


def test_it_replays_bit_for_bit_and_a_changed_range_is_found(
    stopped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", str(stopped)]) == 0
    assert "every setpoint and every frame is the same" in capsys.readouterr().out
    copy = Path(shutil.copytree(stopped, tmp_path / "copy"))
    table = pq.read_table(copy / "sensor_ahead.parquet").to_pandas()
    at = len(table) // 2
    table.loc[at, "range_m"] += 1e-12 * table.loc[at, "range_m"] + 1e-9
    schema = pq.read_schema(copy / "sensor_ahead.parquet")
    pq.write_table(pa.Table.from_pandas(table, schema, preserve_index=False), copy / "sensor_ahead.parquet")
    assert cli.main(["replay", str(copy)]) == 1
    assert "sensor_ahead is not as the drive left it" in capsys.readouterr().out
    seal_again(copy)
    assert cli.main(["replay", str(copy)]) == 1
    said = capsys.readouterr().out
    assert said.startswith(f"tick {table.loc[at, 'tick']} ")
    assert "differs in sensor ahead: row 0" in said


def test_one_whose_code_has_changed_is_not_run(
    stopped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(stopped, tmp_path / "copy"))
    change_json(copy / "scenario.json", "files_sha256", "sensor_ahead:range_finder", value="0" * 64)
    seal_again(copy)
    assert cli.main(["replay", str(copy)]) == 1
    assert capsys.readouterr().out == "sensor_ahead:range_finder has changed since\nnot replayed\n"
    assert cli.main(["redrive", str(copy), "--controller", "follow_and_stop"]) == 2
    assert "sensor_ahead:range_finder has changed since: not run" in capsys.readouterr().err


SHORT = {"duration_s": 12.0, "obstacles.0.at_m": 60.0, "criteria": {}}


def test_another_sensor_changes_neither_the_radar_nor_the_car(tmp_path: Path) -> None:
    other = AHEAD | {"name": "second", "kind": "radar", "settings": {"false_alarms": 3.0}}
    hashes = []
    for name, sensors in (("plain", []), ("more", [AHEAD, other])):
        isolated(drive_once, SHORT | {"sensors": sensors}, str(tmp_path / name))
        summary = json.loads((tmp_path / name / "summary.json").read_text(encoding="utf-8"))
        hashes.append(summary["record_parts_sha256"])
    plain, more = hashes
    assert {"sensor_ahead", "sensor_second"} == more.keys() - plain.keys()
    assert {part for part in plain if plain[part] != more[part]} == {"scenario.json", "readings", "ticks"}
    radars = [pq.read_table(tmp_path / "more" / f"sensor_{name}.parquet").num_rows for name in ("radar", "second")]
    assert radars[1] > radars[0] > 0


BROKEN = """
from vve_sumo.sensors.port import SensorColumn, SensorSettings
from dataclasses import dataclass, replace
import math


@dataclass(frozen=True)
class Out:
    time: float
    number: float = 0.0

    def columns(self):
        return ([self.number],)


class Settings(SensorSettings):
    columns = (SensorColumn("a_m", "float", "a"),)
    observation = Out

    def max_age(self):
        return 0.1

    def sensor(self, vehicle, generator, /):
        return Sensor()


class Sensor:
    output, refused = Out(-math.inf), 0

    def step(self, time, pose, actors):
        if time > 6.0:
            FAILURE
        self.output = Out(time, 1.0)
        return self.output


def make():
    return Settings
"""
WAYS = {
    "sensor_raised": "raise RuntimeError('burnt out')",
    "sensor_not_finite": "self.output = Out(time, math.nan); return self.output",
    "sensor_late": "return None",
    "sensor_wrong_type": "return Out(time, 'far')",
}


@pytest.mark.parametrize("code", WAYS)
def test_a_sensor_that_fails_stops_the_car(code: str, tmp_path: Path) -> None:
    file = tmp_path / "broken.py"
    file.write_text(BROKEN.replace("FAILURE", WAYS[code]), encoding="utf-8")
    sensors = [{"name": "mine", "kind": f"{file}:make"}]
    summary = isolated(drive_once, {"sensors": sensors, "criteria": {}}, str(tmp_path / "record"))
    assert summary["outcome"] == "fault"
    assert code in summary["reasons"]
    assert summary["text"].startswith("sensor mine: ")
    assert not summary["collision"]
