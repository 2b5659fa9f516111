"""What is imported and what is refused: whole files, the line that is named, hostile XML, and what is written."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pyarrow.parquet as pq
import pytest

from tests.bridges.openscenario.stage import (
    ROAD,
    after,
    event,
    lane_change,
    of_entity,
    scenario,
    speed_action,
    step,
    write,
)
from tests.conftest import REPOSITORY, SHARED_DATA
from tests.isolated import command
from vve_sumo.bridges.openscenario.distributions import read_variation
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.write import import_file
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element, read_xml
from vve_sumo.errors import ConfigError
from vve_sumo.timing import PERIOD

FOLDER = SHARED_DATA / "openscenario"
#: files of others that are not taken: the line and the element that say why
REFUSED = {
    "highway_merge.xosc": (23, "LogicFile"),  # its roads are not beside it
    "slow-lead-vehicle.xosc": (19, "LogicFile"),  # likewise
    "lane_change_simple.xosc": (69, "LaneChangeAction"),  # of the ego
    # Their routes are in a catalog that is not beside them.
    "ltap-od.xosc": (38, "ScenarioObject"),
    "pedestrian.xosc": (29, "ScenarioObject"),
}


def files() -> list[Path]:
    """Every scenario, and variation of one, beside this checkout."""
    found = [*FOLDER.glob("esmini/xosc/*.xosc"), *FOLDER.glob("ncap/OpenSCENARIO/NCAP/AEB_C2C_2023/**/*.xosc")]
    return sorted(found)


def damaged(text: str) -> Iterator[str]:
    """Yield an XML text with one attribute after the other missing or wrong, one element after the other gone."""
    root = ElementTree.fromstring(text)
    for element in list(root.iter()):
        for name, value in list(element.attrib.items()):
            for other in (None, "", "x", "nan", "-1", "1e999"):
                del element.attrib[name]
                if other is not None:
                    element.set(name, other)
                yield ElementTree.tostring(root, encoding="unicode")
                element.attrib[name] = value
        for place, child in enumerate(list(element)):
            element.remove(child)
            yield ElementTree.tostring(root, encoding="unicode")
            element.insert(place, child)


@pytest.mark.parametrize("every", [11, pytest.param(1, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("which", ["scenario", "road"])
def test_a_file_that_is_damaged_anywhere_is_taken_or_refused_in_one_line(
    which: str, every: int, tmp_path: Path
) -> None:
    events = event("slow", speed_action("linear", "rate", "2", "$to"), after("2"))
    events += event("aside", lane_change("sinusoidal", "time", "3", "1"), after("4"))
    headway = '<TimeHeadwayCondition entityRef="Other" value="1" freespace="true" rule="lessThan" alongRoute="false"/>'
    events += event("near", step("5"), of_entity(headway), edge="rising")
    declared = '<ParameterDeclaration name="to" parameterType="double" value="4"/>'
    stop = (
        f'<ConditionGroup><Condition name="e" delay="0" conditionEdge="none">{after("20")}</Condition></ConditionGroup>'
    )
    text = scenario(events, parameters=declared, stop=stop)
    file = write(tmp_path, text)
    assert not read_scenario(file, "made").problems
    other, whole = (file, text) if which == "scenario" else (tmp_path / "road.xodr", ROAD)
    for changed in itertools.islice(damaged(whole), None, None, every):
        other.write_text(changed, encoding="utf-8")
        try:
            said = read_scenario(file, "made").problems
        except ConfigError as error:
            said = [str(error)]
        assert all(line and "\n" not in line for line in said)


def come_to(file: Path) -> list[Imported]:
    varied = read_variation(file)
    # The first set and the last stand for those between, which differ in numbers alone.
    sets = varied.sets if len(varied.sets) < 3 else [varied.sets[0], varied.sets[-1]]
    return [read_scenario(varied.file, "made", given=values) for values in sets]


@pytest.mark.skipif(not FOLDER.is_dir(), reason="scenarios of others are not beside this checkout")
def test_four_of_five_files_of_others_are_taken_whole() -> None:
    refused = {}
    for file in files():
        try:
            problems = [problem for one in come_to(file) for problem in one.problems]
        except ConfigError as error:
            problems = [str(error)]
        if problems:
            refused[file.name] = problems[0]
    assert len(files()) == 27
    assert refused.keys() == REFUSED.keys()
    assert len(refused) <= 0.2 * len(files())
    for name, (line, element) in REFUSED.items():
        assert f"{name}:{line}: <{element}>" in refused[name]


def refusal(folder: Path, text: str) -> str:
    """What a text is refused for."""
    try:
        found = read_scenario(write(folder, text), "made")
    except ConfigError as error:
        return str(error)
    assert found.problems
    return found.problems[0]


@pytest.mark.parametrize(
    ("events", "element", "why"),
    [
        (event("e", step("10").replace("SpeedAction", "WarpAction"), after("1")), "WarpAction", "not taken"),
        (event("e", step("${1/0}"), after("1")), "AbsoluteTargetSpeed", "expression"),
        (event("e", step("$Nobody"), after("1")), "AbsoluteTargetSpeed", "no parameter"),
        (event("e", step("nan"), after("1")), "AbsoluteTargetSpeed", "expected a number"),
        (event("e", step("-3"), after("1")), "AbsoluteTargetSpeed", "0 to 100"),
        (event("e", speed_action("wavy", "time", "2", "3"), after("1")), "SpeedActionDynamics", "dynamicsShape"),
        (event("e", step("3"), after("1"), more='maximumExecutionCount="0"'), "Event", "maximumExecutionCount"),
        (
            event(
                "e",
                step("3"),
                '<ByValueCondition><TimeOfDayCondition rule="lessThan" dateTime="x"/></ByValueCondition>',
            ),
            "TimeOfDayCondition",
            "not taken",
        ),
    ],
)
def test_what_is_not_understood_is_named_with_its_line(tmp_path: Path, events: str, element: str, why: str) -> None:
    text = scenario(events)
    # Init comes before the events, so that the last of a name is the event's.
    line = max(n for n, one in enumerate(text.splitlines(), 1) if re.search(f"<{element}[ >]", one))
    said = refusal(tmp_path, text)
    assert f"made.xosc:{line}: <{element}>: " in said
    assert why in said


def test_what_is_left_out_leaves_the_rest(tmp_path: Path) -> None:
    events = event("bad", step("10").replace("SpeedAction", "WarpAction"), after("1")) + event(
        "good", step("5"), after("2")
    )
    found = read_scenario(write(tmp_path, scenario(events)), "made")
    assert len(found.problems) == 1
    assert [action["name"] for action in found.table["actors"][0]["story"]["actions"]] == ["good"]


def test_the_ego_is_the_one_that_is_named(tmp_path: Path) -> None:
    file = write(tmp_path, scenario(""))
    assert [one["id"] for one in read_scenario(file, "made").table["actors"]] == ["Other"]
    assert [one["id"] for one in read_scenario(file, "made", ego="Other").table["actors"]] == ["Ego"]
    with pytest.raises(ConfigError, match="expected one of Ego, Other"):
        read_scenario(file, "made", ego="Nobody")


BOMB = """<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>
<OpenSCENARIO>&c;</OpenSCENARIO>"""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (BOMB, "document type"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><OpenSCENARIO/>', "document type"),
        ("<a>" * 300 + "</a>" * 300, "deeper"),
        ("<OpenSCENARIO><a></OpenSCENARIO>", "no XML"),
        ("", "no XML"),
        ("\x00\x01", "no XML"),
    ],
)
def test_hostile_files_are_one_line(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "bad.xosc"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=why) as said:
        read_xml(file, "OpenSCENARIO XML")
    assert "\n" not in str(said.value)


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "huge.xosc"
    with file.open("wb") as opened:
        opened.truncate(65_000_000)
    with pytest.raises(ConfigError, match="at most 64 MB"):
        read_xml(file, "OpenSCENARIO XML")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("${1+2*3}", 7.0),
        ("${-$a/4}", -2.0),
        ("${pow(2, 3)+sqrt($a*2)}", 12.0),
        ("${round(2.5)+floor(2.9)+ceil(2.1)}", 8.0),
        ("${max(1, min(5, $a))-abs(-1)}", 4.0),
        ("${sin(pi/2)+acos(1)}", 1.0),
        ("${sign(-3)*7%4}", -3.0),
        ("$a", 8.0),
    ],
)
def test_expressions(text: str, value: float) -> None:
    element = Element("E", {"x": text}, Path("f"), 1)
    assert Scope({"a": "8"}).number(element, "x") == pytest.approx(value)


@pytest.mark.parametrize(
    "text",
    ["${__import__('os')}", "${a.b}", "${'a'*9}", "${pow(9,pow(9,pow(9,9)))}", "${(lambda: 1)()}", "${[1][0]}", "${"
     + "(" * 1900 + ")" * 90 + "}", "${1", "${}", "${10**10**10}"],
)  # fmt: skip
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(NotTakenError):
        Scope().number(Element("E", {"x": text}, Path("f"), 1), "x")


def test_variations_are_every_set_of_values(tmp_path: Path) -> None:
    write(tmp_path, scenario(""))
    varied = tmp_path / "varied.xosc"
    varied.write_text(
        """<OpenSCENARIO><FileHeader revMajor="1" revMinor="2"/><ParameterValueDistribution>
    <ScenarioFile filepath="made.xosc"/><Deterministic>
    <DeterministicSingleParameterDistribution parameterName="a"><DistributionRange stepWidth="5">
    <Range lowerLimit="10" upperLimit="20"/></DistributionRange></DeterministicSingleParameterDistribution>
    <DeterministicSingleParameterDistribution parameterName="b"><DistributionSet><Element value="x"/>
    <Element value="y"/></DistributionSet></DeterministicSingleParameterDistribution></Deterministic>
    </ParameterValueDistribution>
    </OpenSCENARIO>""",
        encoding="utf-8",
    )
    found = read_variation(varied)
    assert found.file.name == "made.xosc"
    assert [(one["a"], one["b"]) for one in found.sets] == [(a, b) for a in ("10", "15", "20") for b in ("x", "y")]


def test_a_variation_of_roads_has_a_network_for_each(tmp_path: Path) -> None:
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    declared = '<ParameterDeclaration name="Roads" parameterType="string" value="road.xodr"/>'
    write(tmp_path, scenario("", parameters=declared).replace('filepath="road.xodr"', 'filepath="$Roads"'))
    (tmp_path / "lower.xodr").write_text(ROAD.replace('y="0"', 'y="-40"'), encoding="utf-8")
    varied = tmp_path / "varied.xosc"
    varied.write_text(
        """<OpenSCENARIO><FileHeader revMajor="1" revMinor="2"/><ParameterValueDistribution>
    <ScenarioFile filepath="made.xosc"/><Deterministic>
    <DeterministicSingleParameterDistribution parameterName="Roads"><DistributionSet><Element value="road.xodr"/>
    <Element value="lower.xodr"/></DistributionSet></DeterministicSingleParameterDistribution></Deterministic>
    </ParameterValueDistribution></OpenSCENARIO>""",
        encoding="utf-8",
    )
    found = import_file(varied, tmp_path, "two")
    assert found.scenarios == ["two_001", "two_002"]
    for name, network in (("two_001", "two"), ("two_002", "two_roads_2")):
        text = (tmp_path / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
        assert f'network = "{network}"' in text
        assert (tmp_path / "networks" / f"{network}.net.xml").is_file()
        # Each path lies on its own road: where the lane is, the ego is placed.
        assert f'path = "{network}_ego_lane_m1"' in text


@pytest.mark.thorough
def test_an_imported_scenario_is_driven(tmp_path: Path) -> None:
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    stop = (
        f'<ConditionGroup><Condition name="c" delay="0" conditionEdge="none">{after("4")}</Condition></ConditionGroup>'
    )
    write(tmp_path, scenario(event("e", speed_action("linear", "rate", "2", "14"), after("1")), stop=stop))
    made = command("scenarios", "import", "made.xosc", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    done = command("drive", "made", "--json", "--out", "record", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["outcome"], summary["reasons"][0]) == ("completed", "end_story")
    actors = pq.read_table(tmp_path / "record" / "actors.parquet").to_pandas()
    speeds = actors[actors.actor == "Other"].speed_mps.to_numpy()
    assert speeds[0] == pytest.approx(10.0)
    assert speeds[-1] == pytest.approx(14.0, abs=0.01)
    # From 1 s on by 2 m/s2: 10 m/s for a second, 24 m in the two of the change, then 14 m/s.
    xs = actors[actors.actor == "Other"].x_m.to_numpy()
    since = (len(xs) - 1) * PERIOD
    assert xs[-1] - xs[0] == pytest.approx(10.0 + 24.0 + 14.0 * (since - 3.0), abs=0.2)


def test_what_is_refused_leaves_nothing_behind(tmp_path: Path) -> None:
    write(tmp_path, scenario(event("e", step("10").replace("SpeedAction", "WarpAction"), after("1"))))
    done = command("scenarios", "import", "made.xosc", cwd=tmp_path)
    assert done.returncode == 2
    assert "<WarpAction>: this action is not taken" in done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["made.xosc", "road.xodr"]


def test_the_page_shows_a_scenario_that_is_taken_whole(tmp_path: Path) -> None:
    page = (REPOSITORY / "docs" / "openscenario.md").read_text(encoding="utf-8")
    road, text = re.findall(r"```xml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "road.xodr").write_text(road, encoding="utf-8")
    file = tmp_path / "braking.xosc"
    file.write_text(text, encoding="utf-8")
    found = read_scenario(file, "braking")
    assert not found.problems
    assert found.table["actors"][0]["at_m"] == 60.0
    assert found.table["ego"]["initial_speed_mps"] == 12.0
