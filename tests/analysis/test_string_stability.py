"""String stability, headways and error of the time gap of records made by hand, against their closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.analysis.made import BOX, PERIOD, moving, put, write
from vve_sumo.analysis import headway_distribution, load, string_stability, time_gap_error_of
from vve_sumo.analysis.bodies import bodies
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.string_stability import head_to_tail
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.per_drive import PER_DRIVE

TIME = np.arange(0.0, 12.0 + 1e-9, PERIOD)
#: three cars whose speeds sway about 12 m/s with these amplitudes [m/s], once in 4 s
SWAYS = {"head": 1.0, "ego": 1.5, "tail": 1.2}
SPEED, RATE, BEHIND = 12.0, math.tau / 4.0, 25.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A string of three, and a car that overtakes in another lane."""
    folder = tmp_path_factory.mktemp("string") / "record"
    x, v = {}, {}
    for place, (name, sway) in enumerate(SWAYS.items()):
        x[name] = -BEHIND * place + SPEED * TIME - sway / RATE * (np.cos(RATE * TIME) - 1.0)
        v[name] = SPEED + sway * np.sin(RATE * TIME)
    x |= {"passing": SPEED * TIME * 1.5 - 40.0}
    v |= {"passing": np.full_like(TIME, 18.0)}
    write(folder, moving(TIME, x["ego"], v["ego"]))
    rows = [
        BOX | {"tick": tick, "actor": name, "x_m": float(x[name][tick]), "speed_mps": float(v[name][tick])}
        | {"y_m": 3.5 if name == "passing" else 0.0}
        for tick in range(len(TIME))
        for name in ("head", "tail", "passing")
    ]  # fmt: skip
    put(folder, "actors", rows)
    return load(folder)  # type: ignore[return-value]


def test_each_vehicle_amplifies_by_the_ratio_of_the_sways(run: Run) -> None:
    table = string_stability(run)
    assert [*table.index] == ["head", "ego", "tail"]
    for column in ("amplification_l2", "amplification_linf"):
        np.testing.assert_allclose(table[column], [math.nan, 1.5, 0.8], rtol=0.02)
    for column in ("head_to_tail_l2", "head_to_tail_linf"):
        np.testing.assert_allclose(table[column], [math.nan, 1.5, 1.2], rtol=0.02)
    assert all(table.attrs["meanings"].values())
    assert [*string_stability(run, ["ego", "tail"])["amplification_l2"]] == pytest.approx(
        [math.nan, 0.8], nan_ok=True, rel=0.02
    )
    with pytest.raises(ConfigError, match="no passing in the string, which has head, ego, tail"):
        string_stability(run, ["passing", "ego"])
    figures = PER_DRIVE.measure(run.data)
    assert figures["speed_amplification_l2"] == pytest.approx(1.5, rel=0.02)
    assert figures["speed_amplification_linf"] == pytest.approx(1.5, rel=0.02)


def test_the_ego_has_its_id_among_the_vehicles_of_a_string_and_among_the_bodies(run: Run) -> None:
    mine = Run(run.folder)
    mine.data.ego = "mine"
    assert [*string_stability(mine).index] == ["head", "mine", "tail"]
    assert [body.name for body in bodies(mine)] == ["mine", "head", "passing", "tail"]


def test_headways_take_the_time_that_they_held(run: Run) -> None:
    gap, speed = run.data.lead.gap, run.motion.speed
    headway = (gap / speed)[:-1]
    table = headway_distribution(run, [0.0, 1.4, 1.6])
    expected = [np.mean(headway < 1.4), np.mean((headway >= 1.4) & (headway < 1.6)), np.mean(headway >= 1.6)]
    np.testing.assert_allclose(table["time_share"], expected, atol=1e-6)
    assert 0.1 < expected[1] < 0.9
    figures = PER_DRIVE.measure(run.data)
    assert figures["headway_median_s"] == pytest.approx(np.median(gap / speed))
    assert figures["headway_p05_s"] == pytest.approx(np.quantile(gap / speed, 0.05))


def test_the_time_gap_is_held_against_what_was_wanted(run: Run) -> None:
    gap, speed = run.data.lead.gap, run.motion.speed
    error = (gap - 2.0) / speed - 1.5
    found = time_gap_error_of(run, 1.5, 2.0)
    assert found == pytest.approx((error.mean(), math.sqrt((error**2).mean())))
    with pytest.raises(ConfigError, match="time_headway_s"):
        time_gap_error_of(run)


def test_an_ego_that_follows_nobody_has_no_string(tmp_path: Path) -> None:
    run = Run(write(tmp_path / "alone", moving(TIME, SPEED * TIME, np.full_like(TIME, SPEED))))
    assert string_stability(run).empty
    assert headway_distribution(run)["time_share"].isna().all()
    assert math.isnan(time_gap_error_of(run, 1.5).rms)
    figures = PER_DRIVE.measure(run.data)
    assert math.isnan(figures["speed_amplification_l2"])
    assert math.isnan(figures["headway_median_s"])


def test_a_platoons_last_ego_is_held_against_its_leader_from_settled_following_on(tmp_path: Path) -> None:
    """Two egos that sway 1.5 and 1.2 times as far as their leader, after six steady seconds and a rough begin."""
    time = np.arange(0.0, 14.0 + 1e-9, PERIOD)
    since = np.maximum(time - 6.0, 0.0)
    rough = np.where(time < 1.0, 2.0 * (1.0 - time), 0.0)
    v = {name: SPEED + sway * np.sin(RATE * since) for name, sway in {"lead": 0.4, "ego": 0.6, "b": 0.48}.items()}
    v["b"] = v["b"] + rough
    x = {name: np.cumsum(speed) * PERIOD - BEHIND * place for place, (name, speed) in enumerate(v.items())}
    folder = tmp_path / "record"
    further = folder / "egos"
    write(folder, moving(time, x["ego"], v["ego"]))
    further.mkdir()
    write(
        further / "b",
        moving(time, x["b"], v["b"]),
        further_ego={"id": "b", "obstacles": [], "actors": [], "egos": ["ego"]},
    )
    for record, ahead in ((folder, "lead"), (further / "b", "ego")):
        rows = [
            BOX | {"tick": tick, "actor": ahead, "x_m": float(x[ahead][tick]), "speed_mps": float(v[ahead][tick])}
            for tick in range(len(time))
        ]
        put(record, "actors", rows)
    run = Run(folder)
    assert head_to_tail(run, "lead", ["ego"], SPEED, 0.0).l2 == pytest.approx(1.5, rel=0.02)
    assert head_to_tail(run, "lead", ["ego", "b"], SPEED, 0.0).l2 == pytest.approx(1.2, rel=0.02)
    assert math.isnan(head_to_tail(run, "lead", ["ego", "b"], SPEED, 20.0).l2)
