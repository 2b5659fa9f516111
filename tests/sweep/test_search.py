"""Searches: flips are bracketed in few runs, the worst case is found, no kill and no order changes what is asked."""

from __future__ import annotations

import itertools
import json
import math
import random
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats.qmc import Sobol

from tests.conftest import REPOSITORY
from tests.sweep.reading import load_rows
from tests.vehicles import FUSION
from vve_sumo.cli.search_results import lines, table_of
from vve_sumo.errors import ConfigError
from vve_sumo.laws import stopping_distance
from vve_sumo.record.sweep_folder import SweepPlan, read_tables
from vve_sumo.report import search_results
from vve_sumo.report.formatting import SPACE
from vve_sumo.sweep import boundary, worst
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.plan import query_of
from vve_sumo.sweep.run_specs import RunSpec, RunSpecs
from vve_sumo.sweep.search import AdaptiveSearch, met, min_runs
from vve_sumo.sweep.spec import Spec, parse_spec

Drive = Callable[[Mapping[str, Any], int], dict[str, Any]]


def asked_until_settled(rows: list[Callable[[int], bool]], count: int, scan: int, batch: int) -> list[dict[int, bool]]:
    """What is known of rows of places whose verdicts are functions, after a whole search."""
    known: list[dict[int, bool]] = [{} for _ in rows]
    wanted = boundary.first(len(rows), count, scan)
    while wanted:
        for ask in wanted:
            assert 0 <= ask.place < count
            assert ask.place not in known[ask.row], "asked twice"
            known[ask.row][ask.place] = rows[ask.row](ask.place)
        wanted = boundary.closer(known, batch)
    return known


@given(count=st.integers(2, 3000), scan=st.integers(2, 9), batch=st.integers(1, 9), data=st.data())
def test_one_flip_is_found_in_as_few_runs_as_sections_allow(count: int, scan: int, batch: int, data: Any) -> None:
    flip = data.draw(st.integers(1, count - 1))
    good_below = data.draw(st.booleans())
    known = asked_until_settled([lambda place: (place < flip) == good_below], count, scan, batch)[0]
    assert boundary.flips_of(known) == [boundary.Flip(flip - 1, flip, good_below)]
    widest = math.ceil((count - 1) / (min(scan, count) - 1)) + 1
    rounds = math.ceil(math.log(widest, batch + 1)) + 1
    assert len(known) <= min(scan, count) + batch * rounds


@given(verdicts=st.lists(st.booleans(), min_size=2, max_size=40), scan=st.integers(2, 40), batch=st.integers(1, 5))
def test_every_flip_that_the_scan_tells_apart_is_reported(verdicts: list[bool], scan: int, batch: int) -> None:
    known = asked_until_settled([verdicts.__getitem__], len(verdicts), scan, batch)[0]
    found = {flip.above for flip in boundary.flips_of(known)}
    true = {place for place in range(1, len(verdicts)) if verdicts[place] != verdicts[place - 1]}
    assert found <= true
    for low, high in itertools.pairwise(boundary.scanned(len(verdicts), scan)):
        if verdicts[low] != verdicts[high]:
            assert found & {*range(low + 1, high + 1)}
    if scan >= len(verdicts):
        assert found == true


@given(flips=st.lists(st.integers(1, 99), min_size=1, max_size=7), batch=st.integers(1, 20))
def test_pooled_is_where_half_of_the_seeds_fail(flips: list[int], batch: int) -> None:
    rows = [lambda place, flip=flip: place < flip for flip in flips]
    known = asked_until_settled(rows, 100, 5, batch)
    share = [sum(not row(place) for row in rows) / len(rows) for place in range(100)]
    first = next(place for place in range(100) if share[place] >= 0.5)
    assert boundary.pooled(known) == [boundary.Flip(first - 1, first, True)]


BOUNDARY = """
scenario = "s"
seeds = 3
search = { along = "speed", criterion = "collision", scan = 4, batch = 6 }
[parameters]
sight = [12.0, 18]
speed = { from = 5.0, to = 15.0, step = 0.1 }
"""
WORST = """
scenario = "s"
seeds = 2
search = { highest = "impact_speed_mps", points = 60, batch = 6 }
[parameters]
kind = ["car", "truck"]
sight = { min = 5.0, max = 50.0 }
speed = { min = 3.0, max = 15.0 }
"""


def collides(values: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Braking at 5 m/s2 in sight of a wall, after a dead time that the seed decides."""
    room = values["sight"] - stopping_distance(values["speed"], 5.0, 0.05 * seed)
    impact = math.sqrt(10.0 * -room) if room < 0.0 else 0.0
    if values.get("kind") == "truck":
        impact *= 0.9
    return {"collision": room < 0.0, "passed": room >= 0.0, "failed": "hit" * (room < 0.0), "impact_speed_mps": impact}


def spec_of(text: str) -> Spec:
    return parse_spec(tomllib.loads(text), Path("s.toml"))


def driven(
    folder: Path, text: str, drive: Drive = collides, *, most: int = 10**9, order: int = 0
) -> tuple[AdaptiveSearch, list[int]]:
    """Search as far as `most` runs go, every batch's results coming in an order of their own; and what was driven."""
    spec = spec_of(text)
    seeds = range(1, 1 + spec.repeats)
    cells = RunSpecs(spec, "s", seeds)
    kinds = {name: axis.kind for name, axis in spec.parameters.items()}
    plan = SweepPlan(tomllib.loads(text), "s", {}, "/s.toml", "/", cells.count, kinds, [], {}, {})
    dataset = Dataset(folder, plan, resume=True, rows_per_part=16)
    held = {row["number"]: row for table in read_tables(folder) for row in table.to_pylist()}
    hunt = AdaptiveSearch(cells, held, folder)
    waiting: list[RunSpec] = []
    numbers: list[int] = []
    for cell in hunt.cells():
        if cell is not None:
            waiting.append(cell)
            continue
        if order:
            random.Random(order + len(numbers)).shuffle(waiting)
        if len(numbers) >= most or not waiting:
            break
        one = waiting.pop(0)
        numbers.append(one.number)
        figures = drive(one.values, one.seed)
        error = figures.pop("error", "")
        hunt.take(dataset.add(one, RunResult(one.key, {} if error else figures, error=error)))
    if hunt.result is not None:
        dataset.settle(hunt.runs)
    dataset.close()
    return hunt, numbers


def content(folder: Path) -> dict[str, bytes]:
    files = (file for place in ("rows", "machine") for file in (folder / place).glob("*"))
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def true_flip(sight: float, seed: int) -> float:
    """The speed above which braking from it takes more than what is in sight: a quadratic equation."""
    dead = 0.05 * seed
    return 5.0 * (math.sqrt(dead * dead + 2.0 * sight / 5.0) - dead)


def test_boundaries_are_where_the_closed_form_has_them(tmp_path: Path) -> None:
    hunt, numbers = driven(tmp_path / "a", BOUNDARY)
    assert hunt.result is not None
    assert (len(numbers), sorted(numbers)) == (hunt.runs, list(range(hunt.runs)))
    assert hunt.runs == hunt.result["runs"] <= 6 * (4 + math.ceil(math.log2(34)))
    lines_of = hunt.result["boundaries"]
    assert [line["values"] for line in lines_of] == [{"sight": 12.0}, {"sight": 18.0}]
    rows = load_rows(tmp_path / "a").set_index("key")
    for line in lines_of:
        sight = line["values"]["sight"]
        for one in line["seeds"]:
            (flip,) = one["flips"]
            assert flip["meets"] <= true_flip(sight, one["seed"]) < flip["fails"] <= flip["meets"] + 0.1 + 1e-9
            assert flip["why"] == "hit"
            assert rows["speed"][flip["key_fails"]] == flip["fails"]
            assert rows["seed"][flip["key_meets"]] == one["seed"]
        (pooled,) = line["flips"]
        assert pooled["meets"] <= true_flip(sight, 2) < pooled["fails"]


def island(values: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Bad between 8 and 11, and an error above 14."""
    bad = 8.0 <= values["speed"] <= 11.0
    return {"collision": bad, "passed": not bad, "failed": "", "error": "timed_out" if values["speed"] > 14.0 else ""}


def test_what_is_not_monotone_is_said_and_a_fault_meets_nothing(tmp_path: Path) -> None:
    hunt, _numbers = driven(tmp_path / "a", BOUNDARY, island)
    assert hunt.result is not None
    for line in hunt.result["boundaries"]:
        ends = [(round(flip["meets"], 6), round(flip["fails"], 6)) for flip in line["flips"]]
        assert ends == [(7.9, 8.0), (11.1, 11.0), (14.0, 14.1)]
    assert hunt.result["errors"] > 0
    said = "\n".join(lines(hunt.result, tmp_path / "a"))
    assert "2 of 2 combinations flip more than once" in said
    assert "with an error" in said
    table = table_of(hunt.result, "t")
    assert table is not None
    assert table.row_count == 6


@pytest.mark.thorough
@pytest.mark.parametrize("text", [BOUNDARY, WORST.replace("60", "30")], ids=["boundary", "worst"])
def test_kills_and_the_order_of_results_change_nothing_and_nothing_is_driven_twice(tmp_path: Path, text: str) -> None:
    whole, numbers = driven(tmp_path / "whole", text)
    other: list[int] = []
    for most in (3, 11, 20, 10**9):
        hunt, more = driven(tmp_path / "killed", text, most=most, order=1 + most)
        other += more
    assert hunt.result == whole.result
    assert sorted(other) == sorted(numbers)
    assert content(tmp_path / "killed") == content(tmp_path / "whole")
    again, more = driven(tmp_path / "killed", text)
    assert (again.result, more) == (whole.result, [])
    assert content(tmp_path / "killed") == content(tmp_path / "whole")
    assert not (tmp_path / "killed" / "journal.jsonl").exists()


def test_rows_of_another_course_are_refused(tmp_path: Path) -> None:
    driven(tmp_path / "a", BOUNDARY, most=5)
    journal = tmp_path / "a" / "journal.jsonl"
    key = json.loads(journal.read_text(encoding="utf-8").splitlines()[0])["key"]
    journal.write_text(journal.read_text(encoding="utf-8").replace(key, "0" * 16), encoding="utf-8")
    with pytest.raises(ConfigError, match="another Optuna"):
        driven(tmp_path / "a", BOUNDARY)


def late(values: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Nothing is ever hit with the first seed."""
    return collides(values, seed) | ({"impact_speed_mps": 0.0} if seed == 1 else {})


@pytest.mark.thorough
def test_the_worst_case_is_found(tmp_path: Path) -> None:
    """The worst is known: fastest, shortest sight, a car, the later seed."""
    hunt, _numbers = driven(tmp_path / "a", WORST, late)
    assert hunt.result is not None
    case = hunt.result["worst"]
    greatest = collides({"sight": 5.0, "speed": 15.0}, 2)["impact_speed_mps"]
    spread = (
        collides({"sight": 5.0 + 45.0 * a, "speed": 3.0 + 12.0 * b}, 2) for a, b in Sobol(2, seed=1).random(64).tolist()
    )
    assert max(one["impact_speed_mps"] for one in spread) < case["impact_speed_mps"] <= greatest
    assert case["impact_speed_mps"] > 0.95 * greatest
    assert (case["values"]["kind"], case["seed"]) == ("car", 2)
    rows = load_rows(tmp_path / "a")
    assert case["impact_speed_mps"] == rows["impact_speed_mps"].max()
    assert len(rows) == hunt.runs <= 120
    table = table_of(hunt.result, "t")
    assert table is not None
    assert case["key"] in "\n".join(lines(hunt.result, tmp_path / "a"))


def test_a_run_that_is_asked_for_again_is_not_driven_again(tmp_path: Path) -> None:
    text = WORST.replace("min = 3.0, max = 15.0", "min = 1.0, max = 1.0000000000000002")
    hunt, numbers = driven(tmp_path / "a", text.replace("sight = { min = 5.0, max = 50.0 }", "sight = [5.0, 9.0]"))
    assert 0 < hunt.runs <= 2 * 2 * 2 * 2
    assert sorted(numbers) == list(range(hunt.runs))
    assert load_rows(tmp_path / "a")["key"].is_unique


def chosen_and_costs(cost: Callable[[worst.Shares], float], points: int, seed: int) -> list[float]:
    course = worst.search(2, points, 8, seed)
    costs: list[float] = []
    try:
        shares = next(course)
        while True:
            costs += (came := [cost(one) for one in shares])
            shares = course.send(came)
    except StopIteration:
        return costs


def test_corners_come_first_where_a_batch_holds_them() -> None:
    assert next(worst.search(2, 10, 4, 1)) == list(itertools.product((0.0, 1.0), repeat=2))
    assert not {0.0, 1.0} & {share for point in next(worst.search(2, 10, 3, 1)) for share in point}


@pytest.mark.thorough
@pytest.mark.parametrize(("figure", "goal"), [("min_gap_m", "lowest"), ("max_drac_mps2", "highest")])
def test_a_contact_is_worse_than_every_value_whatever_was_measured_of_it(
    tmp_path: Path, figure: str, goal: str
) -> None:
    """As where the ego was hit from the side: its gap is none. Of two contacts the harder one is the worst."""

    def drive(values: Mapping[str, Any], seed: int) -> dict[str, Any]:
        hit = 9.0 < values["speed"] < 11.0
        row: dict[str, Any] = {"collision": hit, "passed": not hit, "outcome": "contact" if hit else "stopped"}
        return row | {
            "failed": "hit" * hit,
            figure: None if hit else 1.0,
            "impact_speed_mps": values["speed"] if hit else 0.0,
        }

    text = WORST.replace('highest = "impact_speed_mps"', f'{goal} = "{figure}"')
    assert text != WORST
    hunt, _numbers = driven(tmp_path / "a", text, drive)
    assert hunt.result is not None
    case = hunt.result["worst"]
    assert 9.0 < case["values"]["speed"] < 11.0
    assert (case["collision"], case[figure], hunt.result["without"]) == (True, None, 0)
    assert case["impact_speed_mps"] == load_rows(tmp_path / "a")["impact_speed_mps"].max()
    assert table_of(hunt.result, "t") is not None
    at = f"contact at {case['impact_speed_mps']:.2f}"
    assert at in search_results.sentence(hunt.result, {}).replace(SPACE, " ")


def test_costs_that_are_none_do_not_stop_a_search() -> None:
    def cost(shares: worst.Shares) -> float:
        return math.nan if shares[0] > 0.5 else (shares[0] - 0.3) ** 2 + (shares[1] - 0.7) ** 2

    costs = chosen_and_costs(cost, 60, 1)
    assert len(costs) == 60
    assert min(one for one in costs if one == one) < 0.01


def test_criteria_are_judged_from_rows() -> None:
    row = {"passed": None, "collision": None, "meets_stop_gap_m": True}
    assert not met(row, "passed")
    assert not met(row, "collision")
    assert met(row, "stop_gap_m")
    assert met({"passed": True, "collision": False}, "collision")
    assert not met({"collision": False, "meets_collision": False}, "collision")


def test_a_search_counts_what_it_drives_at_least() -> None:
    assert min_runs(RunSpecs(spec_of(BOUNDARY), "s", range(1, 4))) == 2 * 3 * 4
    assert min_runs(RunSpecs(spec_of(WORST), "s", range(1, 3))) == 60 * 2


UNFIT = {
    "parameters.ego.speed_mps = [5.0, 6.0]": r"--search: expected a table \[search\]",
    "search = { along = 'speed', criterion = 'min_gap_m' }\nparameters.speed = { from = 5, to = 6, step = 1 }": (
        "search.criterion: expected passed, collision, outcome, .*got 'min_gap_m'"
    ),
    "search = { lowest = 'gap' }\nparameters.speed = { min = 5, max = 6 }": "search.lowest: .*min_gap_m.*got 'gap'",
    "search = { highest = 'gap' }\nparameters.speed = { min = 5, max = 6 }": "search.highest: .*got 'gap'",
    "search = { along = 'speed', scan = 1001 }\nseeds = 100\nparameters.speed = { from = 5, to = 6, step = 0.001 }": (
        "100,100 runs; --yes drives that many"
    ),
}


@pytest.mark.parametrize("text", UNFIT)
def test_what_no_row_says_cannot_be_searched_for(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.toml").write_text(f"scenario = 'parked_car'\n{text}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=UNFIT[text]) as found:
        query_of(str(tmp_path / "mine.toml"), REPOSITORY, yes=False, search=True)
    assert "\n" not in str(found.value)


def test_without_optuna_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(ConfigError, match=r"pip install 'vve-sumo\[search\]'$"):
        worst.require_optuna()


SPEED = "[parameters]\nspeed = { from = 1, to = 2, step = 1 }\n"
BAD = {
    "search = { along = 'speed' }\n[parameters]\nspeed = [1, 2]": "search.along: expected a parameter with { from, to",
    "search = { along = 'spede' }\n" + SPEED: "got 'spede'",
    "search = { criterion = 'passed' }\n" + SPEED: "'search.along' is missing",
    "search = { along = 'speed', scan = 1 }\n" + SPEED: "search.scan: .*greater than or equal to 2",
    "search = { along = 'speed', scann = 3 }\n" + SPEED: "unknown key 'search.scann', did you mean 'scan'",
    "search = { along = 'speed' }\ndesign = 'grid'\n" + SPEED: "a search chooses its runs itself",
    "search = { along = 'speed' }\n" + SPEED + "x = { min = 1, max = 2 }": "parameters.x: min and max go with",
    "search = { lowest = 'min_gap_m' }\n" + SPEED: "to choose from",
    "search = {}\n" + SPEED: "search: expected one of lowest and highest",
    "search = { lowest = 'a', highest = 'b' }\n" + SPEED: "search: expected one of lowest and highest",
    "search = 5\n" + SPEED: "search: expected a table",
}


@pytest.mark.parametrize("text", BAD)
def test_a_mistake_is_one_line_that_names_the_key(text: str) -> None:
    with pytest.raises(ConfigError, match=BAD[text]) as found:
        spec_of(f"scenario = 's'\n{text}")
    assert "\n" not in str(found.value)


WALL = """
title = "A wall that is seen late"
duration_s = 20.0
after_stop_s = 0.2
road.network = "proving_ground"
ego.path = "proving_ground"
ego.speed_mps = 8.0
ego.car.noise = false
ego.lot = { latitude_deg = 40.0041, longitude_deg = -83.0186, heading_deg = 85.0 }
radar = { ideal = true, range_limit_m = 12.0 }
obstacles = [{ id = "wall", at_m = 90.0 }]
criteria.collision = false
"""
LATE = """
scenario = "wall.toml"
search = { along = "ego.speed_mps", criterion = "collision", scan = 2, batch = 2 }
parameters.ego.speed_mps = { from = 8.5, to = 12.5, step = 0.25 }
"""


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-P", "-m", "vve_sumo.cli", "sweep", *arguments]
    environment = {"PYTHONPATH": str(REPOSITORY), "PATH": "/usr/bin:/bin"}
    return subprocess.run(line, check=False, cwd=folder, capture_output=True, text=True, env=environment, timeout=500)


@pytest.mark.slow
def test_a_real_car_hits_what_it_sees_too_late_from_the_speed_of_the_closed_form(tmp_path: Path) -> None:
    """Real drives: sight of 12 m against the way that full braking takes.

    The dead time lies between two cycles of the radar, which come between the first hit and the third, and four cycles
    with two ticks: a first hit may be a cycle late, and one is up to a tick late itself. Then comes the brakes' own.
    Drag adds up to 3 % to the brakes. The car is a little slower than it is asked for; what counts is what it drove.
    """
    (tmp_path / "wall.toml").write_text(WALL, encoding="utf-8")
    (tmp_path / "late.toml").write_text(LATE, encoding="utf-8")
    ran = command("late.toml", "--search", "--out", "found", "--quiet", folder=tmp_path)
    assert ran.returncode == 0, ran.stderr
    found = json.loads((tmp_path / "found" / "search.json").read_text(encoding="utf-8"))
    (flip,) = found["boundaries"][0]["flips"]
    assert flip["fails"] - flip["meets"] == 0.25
    assert f"{flip['fails']:.6g}" in ran.stdout
    rows = load_rows(tmp_path / "found").set_index("ego.speed_mps")
    assert len(rows) == found["runs"] <= 12
    car = FUSION.vehicle
    build_up = 2.0 * car.brake_lag + car.deceleration_limit / 30.0
    brakes = ((car.deceleration_limit, car.brake_delay + 0.2), (1.03 * car.deceleration_limit, car.brake_delay + 0.1))
    speeds = [0.01 * number for number in range(500, 1500)]
    slow, fast = (next(v for v in speeds if stopping_distance(v, *brake, build_up) > 12.0) for brake in brakes)
    assert rows["max_speed_mps"][flip["fails"]] > slow
    assert rows["max_speed_mps"][flip["meets"]] < fast
    before = content(tmp_path / "found")
    again = command("late.toml", "--resume", "--out", "found", "--quiet", folder=tmp_path)
    assert (again.returncode, again.stdout) == (0, ran.stdout)
    assert content(tmp_path / "found") == before
