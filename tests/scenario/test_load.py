"""Scenario files: what they may say, and the one line that says what is wrong."""

from __future__ import annotations

import contextlib
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.complaints import complaint_of
from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load, parse

FILE = REPOSITORY / "scenarios" / "parked_car.toml"
TEXT = FILE.read_text(encoding="utf-8")


def table() -> dict[str, object]:
    return tomllib.loads(TEXT)


@pytest.mark.parametrize("file", sorted((REPOSITORY / "scenarios").glob("*.toml")), ids=lambda f: f.stem)
def test_every_shipped_scenario_loads(file: Path) -> None:
    assert load(file).title


def test_whole_numbers_are_good_where_a_number_is_asked_for() -> None:
    changed = table()
    changed["ego"]["speed_mps"] = 11  # type: ignore[index]
    assert parse(changed, FILE).ego.speed_mps == 11.0


WRONG = {
    ("ego", "speed_mps"): ["fast", True, 0.0, float("inf"), float("nan"), None],
    ("seed",): [-1, 1.5, "1", 2**31],
    ("road", "network"): ["", 3],
    ("obstacles",): [[{"id": "a"}], [{"id": "a b", "at_m": 1.0}], "none"],
    ("criteria", "stop_gap_m"): [{"min": "4"}, {"least": 4.0}, 5.0],
    ("ego", "lot", "heading_deg"): [360.0, -1.0],
}


@pytest.mark.parametrize(("path", "value"), [(path, value) for path, values in WRONG.items() for value in values])
def test_a_wrong_value_is_one_line_with_file_key_and_value(path: tuple[str, ...], value: object) -> None:
    changed = table()
    inner = changed
    for key in path[:-1]:
        inner = inner[key]  # type: ignore[assignment]
    inner[path[-1]] = value
    with pytest.raises(ConfigError) as caught:
        parse(changed, FILE)
    text = str(caught.value)
    assert "\n" not in text
    assert str(FILE) in text
    assert ".".join(path) in text


def test_two_obstacles_of_one_name_are_refused() -> None:
    changed = table()
    changed["obstacles"] = [{"id": "a", "at_m": 100.0}, {"id": "a", "at_m": 200.0}]
    with pytest.raises(ConfigError, match="'a' stands twice"):
        parse(changed, FILE)


#: one of everything that a scenario can hold
FULL = """
[[obstacles]]
id = "parked"
at_m = 300.0
[[actors]]
id = "lead"
ahead_m = 30.0
speed_mps = 8.0
[[actors.events]]
when = { ego_within_m = 20.0, ttc_s = 3.0 }
speed_mps = 0.0
acceleration_mps2 = 6.0
[[actors.events]]
when = { after_s = 2.0 }
leaves = true
[end_trigger]
ttc_s = 0.5
[weather]
friction = 0.6
[parameters.gap]
sets = ["actors.lead.ahead_m"]
min = 10.0
"""


def full() -> dict[str, Any]:
    base = tomllib.loads(TEXT)
    return (
        base | tomllib.loads(FULL) | {"controller": {"tuning": {"gap_m": 5.0}}, "criteria": {"min_ttc_s": {"min": 1}}}
    )


def test_a_corridor_may_be_said_in_any_unit_and_for_a_part_of_the_path() -> None:
    changed = table()
    changed["ego"]["corridor"] = [{"left": "10 ft"}, {"from_m": 40, "to": "0.1 km", "left_m": 1, "right_m": 3.5}]  # type: ignore[index]
    whole, part = parse(changed, FILE).ego.corridor
    assert (whole.from_m, whole.to_m, whole.right_m) == (0.0, None, 0.0)
    assert whole.left_m == pytest.approx(3.048)
    assert (part.from_m, part.to_m, part.left_m, part.right_m) == (40.0, 100.0, 1.0, 3.5)
    written = parse(changed, FILE).model_dump(mode="json")
    assert parse(written, FILE) == parse(changed, FILE)


def test_a_scenario_without_a_corridor_is_recorded_as_before_there_was_one() -> None:
    scenario = parse(table(), FILE)
    for written in (
        scenario.model_dump(mode="json")["ego"],
        scenario.ego.model_dump(),
        json.loads(scenario.model_dump_json())["ego"],
    ):
        assert [*written] == ["vehicle", "path", "speed_mps", "deviation_limit_m", "speed_margin_mps", "lot", "car"]


NEAR_MISSES = [
    ("ego.corridor", [{"left_m": 0.0}], "ego.corridor.0: expected left_m or right_m above 0"),
    ("ego.corridor", [{"from_m": 9, "to_m": 9, "left_m": 1}], "ego.corridor.0: to_m 9 is not beyond from_m 9"),
    ("ego.corridor", [{"left_m": -1.0}], "ego.corridor.0.left_m: expected greater than or equal to 0, got -1.0"),
    ("ego.corridor", [{"left": 3.0}], "unknown key 'ego.corridor.0.left', did you mean 'left_m'?"),
    ("ego.corridor", {"left_m": 3.0}, "ego.corridor: expected an array, got a table"),
    ("actors.0.events.0.when.ttc", 1.0, "unknown key 'actors.0.events.0.when.ttc', did you mean 'ttc_s'?"),
    ("actors.0.events.0.when.ttc_s", "x", "actors.0.events.0.when.ttc_s: expected a number, got 'x'"),
    ("actors.0.events.0.speed", 1.0, "unknown key 'actors.0.events.0.speed', did you mean 'speed_mps'?"),
    ("actors.0.events.1.when", 3, "actors.0.events.1.when: expected a table, got 3"),
    ("actors.0.kind", "lorry", "actors.0.kind: expected 'car', 'van', 'truck', "),
    ("actors.0.at_m", 5.0, "actors.0: actor lead: expected one of at_m and ahead_m"),
    ("actors.0.id", "parked", "id 'parked' stands twice"),
    ("actors.0.id", "ego", "actors: id 'ego' is the car's that is tested, expected another"),
    ("obstacles.0.id", "ego", "obstacles: id 'ego' is the car's that is tested, expected another"),
    ("actors", {"id": "lead"}, "actors: expected an array, got a table"),
    ("parameters.gap.set", ["x"], "unknown key 'parameters.gap.set', did you mean 'sets'?"),
    ("parameters.gap.sets", "x", "parameters.gap.sets: expected an array, got 'x'"),
    ("parameters.gap.min", True, "parameters.gap.min: expected a number, got True"),
    ("parameters.gap.max", 9.0, "parameters.gap: least 10 is above greatest 9"),
    ("parameters.Gap", {"sets": ["x"]}, "parameters.Gap: string should match pattern"),
    (
        "controller.tuning.gap_m",
        [1],
        "controller.tuning.gap_m: expected true or false or a number or a whole number or a text in quotes, got [1]",
    ),
    ("controller.tuning.a\nb", [1], r"controller.tuning.'a\nb': expected"),
    ("weather.friktion", 0.3, "unknown key 'weather.friktion', did you mean 'friction'?"),
    ("abort", {"contact": True}, "key 'abort' is now 'end_trigger'"),
    ("street", {"network": "linden"}, "key 'street' is now 'road'"),
    ("actors.0.acts", [], "key 'actors.0.acts' is now 'events'"),
    ("end_trigger.ttc_ms", 3.0, "unknown key 'end_trigger.ttc_ms', did you mean 'ttc_s'?"),
    ("criteria.min_ttc_s.maxi", 3.0, "unknown key 'criteria.min_ttc_s.maxi', did you mean 'max'?"),
    ("seed", 16**5000, "seed: expected less than or equal to 2147483647, got int beyond all bounds"),
]


def put(table: Any, place: tuple[Any, ...], value: object) -> None:
    for key in place[:-1]:
        table = table[key]
    if isinstance(table, list):
        table[int(place[-1])] = value
    else:
        table[place[-1]] = value


@pytest.mark.parametrize(("key", "value", "said"), NEAR_MISSES, ids=[repr(key) for key, _, _ in NEAR_MISSES])
def test_a_near_miss_deep_inside_is_named_with_what_was_meant(key: str, value: object, said: str) -> None:
    changed = full()
    put(changed, tuple(int(part) if part.isdigit() else part for part in key.split(".")), value)
    assert said in complaint_of(parse, changed)


@pytest.mark.parametrize(
    ("place", "good"),
    [
        ("ego.speed_mps", True),
        ("seed", True),
        ("actors.0.speed_mps", True),
        ("actors.lead.events.1.when.after_s", True),
        ("actors.lead.enters.drive_s", True),  # no table of that name in the file
        ("obstacles.parked.at_m", True),
        ("criteria.stop_gap_m.min", True),
        ("controller.tuning.anything", True),
        ("ego.sped_mps", False),
        ("ego", False),
        ("ego.", False),
        ("ego.speed_mps.x", False),
        ("actors.lead", False),
        ("actors.1.speed_mps", False),
        ("actors.follower.speed_mps", False),
        ("actors.lead.events", False),
        ("actors.lead.events.2.speed_mps", False),
        ("street.demand.9", False),
        ("parameters.gap.min", False),
        ("9" * 5000, False),
    ],
)
def test_a_parameter_sets_what_takes_a_value(place: str, good: bool) -> None:
    changed = full()
    changed["parameters"]["gap"]["sets"] = ["actors.lead.ahead_m", place]
    if good:
        parse(changed, FILE)
        return
    with pytest.raises(ConfigError, match=r"parameters\.gap\.sets: no key .* that takes a value") as caught:
        parse(changed, FILE)
    assert len(str(caught.value)) < 200


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place of a table, and in each table inside it one for a key that is not there."""
    if isinstance(value, dict):
        return [at, (*at, "other"), (*at, "max_s")] + [p for key, one in value.items() for p in places(one, (*at, key))]
    if isinstance(value, list):
        return [at] + [place for number, one in enumerate(value) for place in places(one, (*at, number))]
    return [at]


PLACES = [place for place in places(full()) if place]
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.dates() | st.times()
VALUES = st.recursive(
    SCALARS | st.sampled_from(["car", 10**400, "a\nb"]),
    lambda one: st.lists(one, max_size=3) | st.dictionaries(st.text(max_size=8), one, max_size=3),
    max_leaves=6,
)


def refusal_of(table: Any) -> str:
    try:
        parse(table, Path("mine.toml"))
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.thorough
@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(PLACES), VALUES), min_size=1, max_size=3))
def test_a_wrong_table_is_one_line_and_never_another_exception(changes: list[tuple[tuple[Any, ...], object]]) -> None:
    changed: Any = full()
    for place, value in changes:
        with contextlib.suppress(KeyError, IndexError, TypeError, ValueError):  # what an earlier change took away
            put(changed, place, value)
    text = refusal_of(changed)
    assert text.isprintable()
    assert text == "" or text.startswith("mine.toml: ")


@pytest.mark.parametrize("text", ["a = " + "[" * 20_000, "seed = " + "9" * 5000, "seed = 0x" + "f" * 9000])
def test_what_the_reader_of_toml_chokes_on_is_one_line_too(tmp_path: Path, text: str) -> None:
    file = tmp_path / "x.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert str(caught.value).isprintable()


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path)


def test_quantities_in_a_sensors_settings_become_numbers_by_the_keys_of_its_kind() -> None:
    def parsed(settings: dict[str, Any], kind: str = "radar") -> Any:
        return parse(table() | {"sensors": [{"name": "second", "kind": kind, "settings": settings}]}, FILE).sensors[0]

    assert parsed({"range_limit_m": "300 ft", "latency": "40 ms", "ideal": True}).settings == {
        "range_limit_m": pytest.approx(91.44),
        "latency_s": pytest.approx(0.04),
        "ideal": True,
    }
    assert parsed({"range_limit_m": 80.0}).settings == {"range_limit_m": 80.0}
    # What a kind that cannot be found would say is not known here: its sensor is refused where it is made.
    assert parsed({"range_limit_m": "300 ft"}, kind="nowhere").settings == {"range_limit_m": "300 ft"}
    with pytest.raises(ConfigError, match=r"sensors\.0\.settings\.latency_s: expected a time in s, .*, got '3 m'"):
        parsed({"latency_s": "3 m"})
    with pytest.raises(ConfigError, match=r"sensors\.0\.settings\.latency: is there beside latency_s"):
        parsed({"latency": "3 ms", "latency_s": 0.1})
