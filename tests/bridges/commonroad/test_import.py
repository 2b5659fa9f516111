"""CommonRoad files: what becomes of states, obstacles, problems and goals that are known in closed form."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bridges.openscenario.stage import Moment, played
from tests.export.made import with_roads
from tests.isolated import REPOSITORY, command
from vve_sumo.analysis import Run
from vve_sumo.bridges.commonroad.importer import import_file, is_commonroad, read_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.export.write import export
from vve_sumo.path import ReferencePath
from vve_sumo.timing import PERIOD

STEP = 0.1
#: a body is nowhere farther from its recorded states than this [m]
TOLERANCE = 0.2
#: the street's lanelets begin here [m], far from 0 as those of recorded traffic
X, Y = 4_000.0, -300.0


def exact(tag: str, value: float) -> str:
    return f"<{tag}><exact>{value!r}</exact></{tag}>"


def state(tag: str, time: int, x: float, y: float, heading: float, speed: float = 0.0, more: str = "") -> str:
    place = f"<position><point><x>{x!r}</x><y>{y!r}</y></point></position>"
    turn, when = exact("orientation", heading), f"<time><exact>{time}</exact></time>"
    return f"<{tag}>{place}{turn}{when}{exact('velocity', speed)}{more}</{tag}>"


def bound(tag: str, y: float, begin: float, end: float) -> str:
    points = "".join(f"<point><x>{X + at}</x><y>{Y + y}</y></point>" for at in (begin, 0.5 * (begin + end), end))
    return f"<{tag}>{points}</{tag}>"


def lanelet(name: int, begin: float, end: float, *successors: int, y: float = 0.0) -> str:
    following = "".join(f'<successor ref="{one}"/>' for one in successors)
    sides = bound("leftBound", y + 1.75, begin, end) + bound("rightBound", y - 1.75, begin, end)
    return f'<lanelet id="{name}">{sides}{following}<laneletType>urban</laneletType></lanelet>'


SHAPE = "<shape><rectangle><length>4.4</length><width>1.9</width></rectangle></shape>"


def dynamic(number: int, kind: str, states: list[tuple[float, float, float]], shape: str = SHAPE) -> str:
    """An obstacle with a state of x, y, heading each time step."""
    rows = [(n, X + x, Y + y, heading) for n, (x, y, heading) in enumerate(states)]
    later = "".join(state("state", *row) for row in rows[1:])
    first = state("initialState", *rows[0])
    inner = f"<type>{kind}</type>{shape}{first}<trajectory>{later}</trajectory>"
    return f'<dynamicObstacle id="{number}">{inner}</dynamicObstacle>'


GOAL = (
    "<goalState><position><rectangle><length>20</length><width>4</width><center>"
    f"<x>{X + 150}</x><y>{Y}</y></center></rectangle></position>"
    "<time><intervalStart>0</intervalStart><intervalEnd>200</intervalEnd></time></goalState>"
)


def problem(goal: str = GOAL, x: float = 30.0, y: float = 0.3, speed: float = 10.0) -> str:
    begin = state("initialState", 0, X + x, Y + y, 0.0, speed, exact("yawRate", 0.0) + exact("slipAngle", 0.0))
    return f'<planningProblem id="900">{begin}{goal}</planningProblem>'


def scenario(*obstacles: str, task: str = problem(), version: str = "2020a", more: str = "") -> str:
    """Two lanelets in a row, 120 m and 180 m long, and one beside the first."""
    lanes = lanelet(1, 0.0, 120.0, 2) + lanelet(2, 120.0, 300.0) + lanelet(3, 0.0, 120.0, y=3.5)
    said = f'commonRoadVersion="{version}" benchmarkID="ZAM_Made-1_1_T-1" timeStepSize="{STEP}"'
    return (
        f'<?xml version="1.0"?>\n<commonRoad {said}>'
        f"\n<location/>\n<scenarioTags/>\n{lanes}\n{more}\n" + "\n".join(obstacles) + f"\n{task}\n</commonRoad>\n"
    )


def write(folder: Path, text: str) -> Path:
    file = folder / "made.xml"
    file.write_text(text, encoding="utf-8")
    return file


def at(moments: list[Moment], time: float) -> Moment:
    return moments[round(time / PERIOD)]


def weaving(count: int = 81) -> list[tuple[float, float, float]]:
    """A car that brakes from 12 m/s at 1 m/s² on a sine across the lane."""
    found = []
    for n in range(count):
        time = n * STEP
        x = 50.0 + 12.0 * time - 0.5 * time**2
        found.append((x, 0.8 * math.sin(x / 15.0), math.atan(0.8 / 15.0 * math.cos(x / 15.0))))
    return found


def test_obstacles_are_where_their_states_are_at_their_times(tmp_path: Path) -> None:
    walker = [(80.0, -6.0 + 0.14 * n, 0.5 * math.pi) for n in range(61)]
    found = read_scenario(
        write(tmp_path, scenario(dynamic(11, "car", weaving()), dynamic(12, "pedestrian", walker))), "made"
    )
    assert found.problems == []
    moments = played(found, 7.9, speed=0.0)
    for name, states in (("obstacle_11", weaving()), ("obstacle_12", walker)):
        for n, (x, y, heading) in enumerate(states[:-1]):
            body = at(moments, n * STEP).actors[name]
            assert math.dist((body.x, body.y), (X + x, Y + y)) < TOLERANCE, (name, n)
            assert abs(math.remainder(body.heading - heading, math.tau)) < 0.1
    speeds = [at(moments, n * STEP).actors["obstacle_11"].speed for n in (10, 40, 70)]
    assert speeds == pytest.approx([11.0, 8.0, 5.0], abs=0.3)
    assert "obstacle_12" not in at(moments, 6.5).actors  # its last state is at 6.0 s


def test_a_body_that_stands_stays_whatever_element_it_is(tmp_path: Path) -> None:
    still = [(100.0, 3.0, 2.0)] * 5
    place = state("initialState", 0, X + 90.0, Y - 1.0, 0.4)
    static = f'<staticObstacle id="21"><type>parkedVehicle</type>{SHAPE}{place}</staticObstacle>'
    old = f'<obstacle id="22"><role>static</role><type>truck</type>{SHAPE}{place}</obstacle>'
    found = read_scenario(write(tmp_path, scenario(static, old, dynamic(23, "car", still))), "made")
    assert found.problems == []
    actors = {one["id"]: one for one in found.table["actors"]}
    assert [actors[f"obstacle_{n}"]["kind"] for n in (21, 22, 23)] == ["car", "truck", "car"]
    moment = at(played(found, 0.2), 0.2)
    for name, expected in (
        ("obstacle_21", (90.0, -1.0, 0.4)),
        ("obstacle_22", (90.0, -1.0, 0.4)),
        ("obstacle_23", still[0]),
    ):
        body = moment.actors[name]
        assert (body.x - X, body.y - Y) == pytest.approx(expected[:2], abs=1e-3)
        assert math.cos(body.heading - expected[2]) == pytest.approx(1.0, abs=1e-6)
        assert body.speed == 0.0


def test_the_ego_begins_at_its_state_and_its_goal_ends_the_drive(tmp_path: Path) -> None:
    found = read_scenario(write(tmp_path, scenario()), "made")
    ego = found.table["ego"]
    assert (ego["speed_mps"], ego["initial_speed_mps"]) == (10.0, 10.0)
    path = ReferencePath.from_points(*zip(*found.lines[ego["path"]], strict=True))
    rear = path.at(ego["initial_s_m"])
    middle = 0.5 * 4.872 - 1.032  # of the Ford Fusion: half its length less its rear overhang
    assert (rear.x + middle, rear.y) == pytest.approx((X + 30.0, Y + 0.3), abs=1e-3)
    moments = played(found, 20.0)
    first = next(one.time for one in moments if one.ended)
    # The rectangle begins 110 m ahead of the car's centre.
    assert first == pytest.approx(11.0, abs=4 * PERIOD)


def test_a_goal_in_a_lanelet_with_a_speed_and_a_time(tmp_path: Path) -> None:
    goal = (
        '<goalState><position><lanelet ref="2"/></position><velocity><intervalStart>5</intervalStart><intervalEnd>9'
        "</intervalEnd></velocity><time><intervalStart>100</intervalStart><intervalEnd>150</intervalEnd></time></goalState>"
    )
    found = read_scenario(write(tmp_path, scenario(task=problem(goal))), "made")
    assert found.problems == []
    assert not any(one.ended for one in played(found, 20.0))  # at 10 m/s it is too fast
    first = next(one.time for one in played(found, 20.0, speed=9.0) if one.ended)
    assert first == pytest.approx(10.0, abs=4 * PERIOD)  # 90 m to the lanelet: there by then
    assert found.table["duration_s"] == 20.0


def test_an_ego_at_rest_begins_from_its_place(tmp_path: Path) -> None:
    found = read_scenario(write(tmp_path, scenario(task=problem(speed=0.0))), "made")
    ego = found.table["ego"]
    assert "initial_speed_mps" not in ego
    (x, y), *_ = found.lines[ego["path"]]
    assert (x + 0.5 * 4.872 - 1.032, y) == pytest.approx((X + 30.0, Y + 0.3), abs=1e-3)
    assert any("from rest" in note for note in found.notes)


LATE = dynamic(31, "car", weaving()).replace("<time><exact>0</exact>", "<time><exact>-1</exact>", 1)
OCCUPANCY = dynamic(32, "car", weaving(2)).replace("<trajectory>", "<occupancySet/><trajectory>")
POLYGON = dynamic(33, "car", weaving(5), "<shape><polygon/></shape>")
BACKWARDS = dynamic(34, "car", [(x, y, heading + math.pi) for x, y, heading in weaving()])
TRAM = dynamic(35, "tram", weaving(5))
REGION = dynamic(36, "car", weaving(5)).replace("<point>", "<circle>", 1).replace("</point>", "</circle>", 1)


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (LATE, "after the start"),
        (OCCUPANCY, "<occupancySet>"),
        (POLYGON, "<polygon>"),
        (BACKWARDS, "backwards"),
        (TRAM, "'tram'"),
        (REGION, "expected a <point>"),
        ('<trafficLight id="5"/>', "<trafficLight>: this element is not taken"),
    ],
)
def test_what_is_not_taken_is_refused_with_its_line_or_left_out(tmp_path: Path, obstacle: str, words: str) -> None:
    file = write(tmp_path, scenario(obstacle, dynamic(11, "car", weaving())))
    found = read_scenario(file, "made")
    (said,) = found.problems
    assert said.startswith(f"{file}:7: <")
    assert words in said
    assert [one["id"] for one in found.table["actors"]] == ["obstacle_11"]
    with pytest.raises(ConfigError, match="--partial leaves out"):
        import_file(file, tmp_path, "made")
    assert {one.name for one in tmp_path.iterdir()} == {"made.xml"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("2020a", "2016a", "commonRoadVersion"),
        ('timeStepSize="0.1"', 'timeStepSize="nan"', "timeStepSize"),
        ("leftBound", "middleBound", "<lanelet>: expected a <leftBound>"),
        (f"<x>{X + 30.0!r}</x>", "<x>inf</x>", "<x>: expected a number"),
        (f"<x>{X + 30.0!r}</x>", "<x>9e9</x>", "begins on no lanelet"),
        ("<planningProblem", "<plan", "no XML"),
        ("<velocity><exact>10.0", "<velocity><exact>300.0", "at most 40 m/s"),
        ("<commonRoad ", "<!DOCTYPE x><commonRoad ", "DOCTYPE"),
    ],
)
def test_what_cannot_be_driven_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = scenario()
    assert old in text
    file = write(tmp_path, text.replace(old, new))
    with pytest.raises(ConfigError) as refused:
        read_scenario(file, "made")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_says_by_its_root_what_it_is(tmp_path: Path) -> None:
    assert is_commonroad(write(tmp_path, scenario()))
    assert not is_commonroad(write(tmp_path, "<OpenSCENARIO/>"))
    assert not is_commonroad(tmp_path / "gone.xml")


def test_an_import_is_a_scenario_that_can_be_shown(tmp_path: Path) -> None:
    write(tmp_path, scenario(dynamic(11, "car", weaving())))
    done = command("scenarios", "import", "made.xml", cwd=tmp_path)
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, "made.xml written to scenarios/made.toml"), done.stderr
    again = command("scenarios", "import", "made.xml", cwd=tmp_path)
    assert (again.returncode, "exists" in again.stderr) == (2, True)
    given = command("scenarios", "import", "made.xml", "--set", "a=1", cwd=tmp_path)
    assert (given.returncode, "--set" in given.stderr) == (2, True)


def test_our_own_export_comes_back_as_commonroads_reader_has_it(tmp_path: Path) -> None:
    """The states that commonroad-io reads are where the actors of the import are."""
    place = os.environ.get("VVE_COMMONROAD")
    if place is None:
        pytest.skip("commonroad-io is not there (VVE_COMMONROAD; see tests/export/commonroad.txt)")
    file, *_ = export(Run(with_roads(tmp_path / "mine")), "commonroad", tmp_path)
    run = subprocess.run(
        [sys.executable, "-m", "tests.export.commonroad_reader", str(file)],
        cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": place}, check=True, stdout=subprocess.PIPE, timeout=120,
    )  # fmt: skip
    (read,) = json.loads(run.stdout)
    found = read_scenario(file, "mine")
    moments = played(found, 2.9, speed=0.0)
    taken = {name: one for name, one in read["moving"].items() if one["states"][0][0] == 0}
    assert taken
    for name, one in taken.items():
        for number, x, y, *_ in one["states"][:-1]:
            body = at(moments, number * read["dt"]).actors[f"obstacle_{name}"]
            assert math.dist((body.x, body.y), (x, y)) < TOLERANCE
