"""The street as a drive holds it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import libsumo
import pytest

from tests.isolated import isolated
from tests.world.streets import ALONE, FUSION, PERIOD, demand, grid, pose, street, trips
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.values import EGO
from vve_sumo.world.ego_sync import Ego
from vve_sumo.world.simulation import SUMO_VERSION, check_version
from vve_sumo.world.world import World

EAST = '<route edges="east"/>'
PARKED = (
    f'<vehicle id="parked" depart="0" departPos="300" departLane="0">{EAST}'
    '<stop lane="east_0" endPos="310" duration="1000" parking="true"/></vehicle>'
)
MIXED = PARKED + (
    '<vType id="lorry" vClass="truck" length="12" width="2.5"/><vType id="bike" vClass="bicycle"/>'
    f'<vehicle id="lorry" type="lorry" depart="0" departPos="200" departLane="0" departSpeed="5">{EAST}</vehicle>'
    f'<vehicle id="bike" type="bike" depart="0" departPos="250" departLane="0" departSpeed="3">{EAST}</vehicle>'
    f'<vehicle id="far" depart="0" departPos="900" departLane="0">{EAST}</vehicle>'
    '<person id="walker" depart="0" departPos="240"><walk edges="east" arrivalPos="900"/></person>'
)


def _mixed(folder: str) -> dict[str, dict[str, float]]:
    root = Path(folder)
    cars = demand(root, MIXED)
    with World(street(root), demand=[cars], seed=1, period=PERIOD, egos=ALONE, warm_up=10.0) as world:
        for k in range(100):
            assert world.step({EGO: pose(k * PERIOD, 250.0, -1.6, 0.0, 0.0)})[EGO].faults == ()
        actors = world.actors(EGO)
        assert actors is world.actors(EGO)
        rows = {}
        for i, name in enumerate(actors.ids):
            domain = libsumo.person if name == "walker" else libsumo.vehicle
            angle = math.radians(domain.getAngle(name))
            front = domain.getPosition(name)
            rows[name] = {
                "x": float(actors.x[i]),
                "y": float(actors.y[i]),
                "length": float(actors.length[i]),
                "width": float(actors.width[i]),
                "section": float(actors.radar_cross_section[i]),
                "off": math.dist(
                    (
                        actors.x[i] + actors.length[i] / 2 * math.sin(angle),
                        actors.y[i] + actors.length[i] / 2 * math.cos(angle),
                    ),
                    front,
                ),
                "turned": math.cos(actors.heading[i] - (math.pi / 2 - angle)),
                "slower": float(actors.speed[i]) - domain.getSpeed(name),
                "time": actors.time,
            }
    return rows


def test_lorries_bicycles_parked_cars_and_people_are_actors(tmp_path):
    rows = isolated(_mixed, str(tmp_path))
    assert rows.keys() == {"lorry", "bike", "parked", "walker"}
    assert (rows["lorry"]["length"], rows["lorry"]["width"]) == (12.0, 2.5)
    assert rows["parked"]["y"] < -6.0
    sections = [rows[name]["section"] for name in ("walker", "bike", "parked", "lorry")]
    assert sections == [0.5, 2.0, 10.0, 100.0]
    for row in rows.values():
        assert row["off"] < 1e-9  # SUMO gives the middle of the front, actors have the centre
        assert row["turned"] == pytest.approx(1.0)
        assert row["slower"] == 0.0
        assert row["time"] == pytest.approx(99 * PERIOD)


def _drive(folder: str, seed: int) -> list[str]:
    root = Path(folder)
    network = grid(root)
    rows = []
    with World(
        network, demand=[trips(root, network, 60, 1.0)], seed=seed, period=PERIOD, egos=ALONE, warm_up=20.0
    ) as world:
        for k in range(200):
            world.step({EGO: pose(k * PERIOD, 121.6, 60.0 + 0.1 * k, math.pi / 2, 5.0)})
            actors = world.actors(EGO)
            rows.append(
                f"{actors.ids}{actors.x.tobytes().hex()}{actors.y.tobytes().hex()}{actors.speed.tobytes().hex()}"
            )
    return rows


def test_the_same_seed_gives_the_same_street_bit_for_bit(tmp_path):
    first = isolated(_drive, str(tmp_path), 4)
    assert first == isolated(_drive, str(tmp_path), 4)
    assert first != isolated(_drive, str(tmp_path), 5)


def _contact(folder: str) -> list[tuple[str, ...]]:
    root = Path(folder)
    cars = demand(root, PARKED)
    reported = []
    with World(street(root), demand=[cars], seed=1, period=PERIOD, egos=ALONE, warm_up=60.0) as world:
        reported.append(world.contacts(EGO))
        for y in (-20.0, -6.4, -6.0):
            world.step({EGO: pose(0.0, 308.0, y, 0.0, 0.0)})
            reported.append(world.contacts(EGO))
    return reported


def test_contact_is_overlap_of_the_boxes(tmp_path):
    reported = isolated(_contact, str(tmp_path))
    assert reported == [(), (), ("parked",), ()]


def _entry(folder: str, speed: float) -> tuple[tuple[str, ...], bool]:
    """Enter in front of a car that does 15 m/s, 15 m behind a standing car."""
    root = Path(folder)
    lead = (
        '<vehicle id="lead" depart="0" departPos="420" departLane="0"><route edges="east"/>'
        '<stop lane="east_0" endPos="420" duration="1000"/></vehicle>'
        f'<vehicle id="rusher" depart="0" departPos="370" departLane="0" departSpeed="15">{EAST}</vehicle>'
    )
    with World(street(root, 1), demand=[demand(root, lead)], seed=1, period=PERIOD, egos=ALONE, warm_up=0.4) as world:
        touched = False
        for k in range(250):
            world.step({EGO: pose(k * PERIOD, min(400.0 + speed * k * PERIOD, 411.0), -1.6, 0.0, speed)})
            touched |= bool(world.contacts(EGO))
        return world.removed_at_entry, touched


def test_who_could_not_avoid_the_entering_ego_is_cleared_and_nobody_else(tmp_path):
    assert isolated(_entry, str(tmp_path), 0.0) == (("rusher",), False)
    assert isolated(_entry, str(tmp_path), 14.0)[0] == ()


def _again(folder: str) -> list[float]:
    """Two streets one after the other in one process, with traffic and a last pose that no step followed."""
    root = Path(folder)
    network = grid(root)
    cars = trips(root, network, 60, 1.0)
    reported = []
    for _ in range(3):
        with World(network, demand=[cars], seed=1, period=PERIOD, egos=ALONE, warm_up=30.0) as world:
            with pytest.raises(SimulationError, match="once"):
                World(network, seed=1, period=PERIOD, egos=ALONE)
            reported.append(world.step({EGO: pose(0.0, 121.6, 60.0, math.pi / 2, 5.0)})[EGO].position_error)
            libsumo.vehicle.moveToXY("ego", "", -1, 121.6, 60.1, 0.0, 2)
        world.close()
    return reported


def test_a_street_can_follow_another_in_one_process(tmp_path):
    assert isolated(_again, str(tmp_path)) == [0.0, 0.0, 0.0]


def _refused(network: Path, files: list[Path], extra: dict[str, object]) -> str:
    settings = {"seed": 1, "period": PERIOD, "egos": ALONE, "demand": files} | extra
    try:
        World(network, **settings).close()  # type: ignore[arg-type]
    except ConfigError as error:
        return str(error)
    return ""


def test_bad_input_is_one_line_that_names_the_file(tmp_path):
    network = street(tmp_path)
    unknown = demand(tmp_path, '<trip id="t" depart="400" from="nowhere" to="east"/>', "unknown")
    broken = tmp_path / "broken.net.xml"
    broken.write_text("<net><edge")
    cases = [
        (tmp_path / "absent.net.xml", [], {}, ["absent.net.xml", "cannot be read"]),
        (broken, [], {}, ["broken.net.xml", "well-formed"]),
        (unknown, [], {}, ["unknown.rou.xml", "<net>", "<routes>"]),
        (network, [network], {}, ["street.net.xml", "<routes>", "<net>"]),
        (network, [unknown], {}, ["unknown.rou.xml", "nowhere"]),
        (network, [], {"period": 0.0333}, ["period", "0.0333"]),
        (network, [], {"period": math.nan}, ["period", "nan"]),
        (network, [], {"warm_up": -1.0}, ["warm_up", "-1.0"]),
        (network, [], {"egos": [Ego(EGO, FUSION, ("east", "moon"))]}, ["street.net.xml", "moon"]),
        (network, [], {"egos": [Ego(EGO, FUSION, ("east", "west"))]}, ["street.net.xml", "east", "west"]),
        (network, [], {"egos": [Ego("a", FUSION), Ego("a", FUSION)]}, ["egos", "a, a"]),
        (network, [], {}, []),
    ]
    for file, files, extra, words in cases:
        message = isolated(_refused, file, files, extra)
        assert all(word in message for word in words), message
        assert bool(message) == bool(words), message
        assert "\n" not in message


def test_another_release_of_sumo_is_refused():
    check_version(SUMO_VERSION)
    with pytest.raises(ConfigError, match=r"1\.28\.0 is required, 1\.27\.0"):
        check_version("1.27.0")


def test_nothing_is_printed_while_the_street_runs(tmp_path, repository):
    program = f"from pathlib import Path; from tests.world.test_world import _drive; _drive({str(tmp_path)!r}, 1)"
    printed = subprocess.run(
        [sys.executable, "-c", program],
        cwd=repository,
        env={**os.environ, "PYTHONPATH": str(repository)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (printed.stdout, printed.stderr) == ("", "")
