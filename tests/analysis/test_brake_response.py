"""How brakes answered, found in records whose brakes are known: integrated in fine steps, or driven by the plant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.analysis import made
from tests.drive.street import altered, obstacle_s
from tests.exhaustive import with_slow
from tests.isolated import REPOSITORY, isolated
from vve_sumo.analysis.brake_response import UNKNOWN, BrakeAnswer, TimeInterval, brake_answer
from vve_sumo.analysis.braking import stop_of
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import LATE, NONE, StoppingBoundCheck, stopping_bound_check
from vve_sumo.metrics.stopping_tolerance import Tolerance
from vve_sumo.report import stops
from vve_sumo.values import Floats

FINE = 2e-4  #: step of the brute integration [s]
ONSET = 2.0  #: [s]
GAIN = 550.0  #: torque for each m/s2 [kg m]


@dataclass(frozen=True)
class Brakes:
    """A car that brakes, in fine steps: what a record's ticks are taken from."""

    delay: float = 0.025
    lag: float = 0.015
    strength: float = 1.0  #: of brakes over declared, or declared over true mass
    push: float = 0.0  #: constant, forward: downhill [m/s2]
    grip: float = math.inf  #: most that the road gives [m/s2]
    lead: float = 0.0  #: by which commands are sent before the tick that records them [s]


def course() -> tuple[Floats, Floats]:
    """Torque [N m] and throttle (0 to 1) of a stop like a regulated one: a ramp, and a saw about its level."""
    most = 1200.0
    time = made.PERIOD * np.arange(650)
    since = np.maximum(time - ONSET, 0.0)
    saw = 0.15 * most * np.abs((since / 0.8) % 1.0 - 0.5) * (since > 0.6)
    return np.minimum(since / 0.6, 1.0) * most - saw, np.where(time < ONSET, 0.15, 0.0)


@cache
def speeds(brakes: Brakes, start: float) -> Floats:
    """Speed at every tick [m/s] of the course, the commands of which hold until the next."""
    torque, throttle = course()
    many = round(made.PERIOD / FINE)
    late, ahead = round(brakes.delay / FINE), round(brakes.lead / FINE)
    asked = np.repeat(torque, many)
    asked = np.concatenate((asked[ahead:], np.full(ahead, asked[-1])))
    asked = np.concatenate((np.zeros(late), asked))[: len(asked)] / GAIN * brakes.strength
    pushed = np.concatenate((np.full(round(0.05 / FINE), throttle[0]), np.repeat(throttle, many)))
    braking, engine, speed, ticks = 0.0, float(throttle[0]), start, []
    for i, wanted in enumerate(asked.tolist()):
        if i % many == 0:
            ticks.append(speed)
        braking += (wanted - braking) * FINE / brakes.lag
        engine += (float(pushed[i]) - engine) * FINE / 0.25
        gained = brakes.push + engine - min(braking, brakes.grip) - 0.00022 * speed * speed
        speed = max(speed + gained * FINE, 0.0)
    return np.array(ticks)


def record(folder: Path, brakes: Brakes, start: float = 12.0, noise: float = 0.0, seed: int = 0) -> Run:
    """A record of such a stop, whose speeds are quantised as the receiver's are, with white noise [m/s]."""
    torque, throttle = course()
    speed = speeds(brakes, start)
    chance = np.random.default_rng(seed).normal(0.0, 1.0, len(speed))
    measured = np.where(speed > 0.0, np.round(speed + noise * chance, 4), 0.0)
    time = made.PERIOD * np.arange(len(speed))
    rows = [
        row
        | {
            "granted_acceleration_mps2": -t / GAIN,
            "true_acceleration_mps2": 0.0,
            "brake_torque_nm": t,
            "throttle_percent": 100.0 * p,
            "state": "engaged",
        }
        for row, t, p in zip(
            made.moving(time, 0.02 * np.cumsum(speed), measured), torque.tolist(), throttle.tolist(), strict=True
        )
    ]
    return Run(made.write(folder, rows))


def answer(run: Run) -> BrakeAnswer:
    stop = stop_of(run)
    assert stop is not None
    return brake_answer(run, stop)


def lies(part: TimeInterval, true: float, within: float) -> None:
    """Assert that a part is found within so much, and that its interval says so, a millisecond aside."""
    assert part.value == pytest.approx(true, abs=within)
    assert part.low - 0.001 <= true <= part.high + 0.001


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(("delay", "lag"), [(0.025, 0.015), (0.125, 0.015), (0.225, 0.015), (0.025, 0.2), (0.1, 0.1)])
@pytest.mark.parametrize("other", [{}, {"push": 0.3, "strength": 0.78}, {"push": -0.3, "strength": 1.29}])
def test_dead_time_and_lag_come_back_whatever_grade_mass_and_gain_are(
    tmp_path: Path, delay: float, lag: float, other: dict[str, float]
) -> None:
    found = answer(record(tmp_path / "r", Brakes(delay, lag, **other)))
    lies(found.together, delay + lag, 0.002)
    lies(found.reaction, delay, 0.004)
    lies(found.build_up, lag, 0.004)


@pytest.mark.thorough
@pytest.mark.parametrize("late", with_slow([0.0, 0.1, 0.2], lambda late: late == 0.0))
def test_the_intervals_hold_the_truth_as_often_as_two_standard_deviations_should(tmp_path: Path, late: float) -> None:
    """Twenty stops with 5 mm/s of white noise; the residuals' own size is an estimate too, so four in five must do."""
    found = [answer(record(tmp_path / f"{seed}", Brakes(0.025 + late), noise=0.005, seed=seed)) for seed in range(20)]
    for row, true in enumerate((0.025 + late, 0.015, 0.04 + late)):
        assert sum(one[row].low - 0.001 <= true <= one[row].high + 0.001 for one in found) >= 16
    widths = [one.together.high - one.together.low for one in found]
    assert 0.004 < float(np.median(widths)) < 0.03
    assert sum(one.together.low > 0.04 + LATE for one in found) == (20 if late else 0)


@pytest.mark.thorough
def test_a_record_that_does_not_tell_says_nothing(tmp_path: Path) -> None:
    """No torque, a road that gives less than is asked for, a stop from a walk: never a wrong number."""
    for grip in (1.2, 1.5, 1.7):
        assert str(answer(record(tmp_path / f"{grip}", Brakes(grip=grip)))) == str(UNKNOWN)
    assert str(answer(record(tmp_path / "walk", Brakes(), start=2.0))) == str(UNKNOWN)
    run = record(tmp_path / "none", Brakes())
    ticks = run.arrow("ticks")
    at = ticks.schema.get_field_index("brake_torque_nm")
    silent = ticks.set_column(at, ticks.schema.field(at), pa.array(np.zeros(ticks.num_rows)))
    pq.write_table(silent, run.folder / "ticks.parquet")
    assert str(answer(Run(run.folder))) == str(UNKNOWN)


def test_of_a_live_drive_the_gateways_own_steps_tell_when_it_commanded(tmp_path: Path) -> None:
    """A tick's row holds what the gateway last said, which may be 15 ms old; that is no part of the brakes' delay."""
    lead = 0.015
    folder = record(tmp_path / "live", Brakes(lead=lead)).folder
    lockstep = answer(Run(folder))
    torque, throttle = course()
    sent = made.PERIOD * np.arange(len(torque)) - lead
    made.put(
        folder,
        "gateway",
        [
            {"time_s": t, "brake_torque_nm": b, "throttle_percent": 100.0 * p}
            for t, b, p in zip(sent.tolist(), torque.tolist(), throttle.tolist(), strict=True)
        ],
    )
    said = (folder / "scenario.json").read_text()
    (folder / "scenario.json").write_text(said.replace('"layout"', '"rig": {}, "layout"', 1))
    live = answer(Run(folder))
    assert live.together.value == pytest.approx(0.04, abs=0.002)
    assert lockstep.together.value == pytest.approx(0.04 - lead, abs=0.003)


def test_the_stopping_bound_check_says_which_part_was_not_held() -> None:
    def missed(reaction: float, build_up: float, unsure: float = 0.0) -> tuple[str, ...]:
        one, other = (TimeInterval(v, v - unsure, v + unsure) for v in (reaction, build_up))
        whole = reaction + build_up
        given = BrakeAnswer(one, other, TimeInterval(whole, whole, whole))
        terms = Tolerance(0.1, 0.0, 0.0, 0.0)
        reported = StoppingBoundCheck(12.0, 2.0, 0.0, 0.025, 0.015, 40.0, 40.0, terms, given)
        assert reported.held is (not reported.missed)
        assert reported.broken is bool(reported.missed)
        return reported.missed

    assert missed(0.025 + LATE - 0.001, 0.0) == ()
    assert missed(0.025 + LATE + 0.001, 0.015) == ("reaction",)
    assert missed(0.025, 0.015 + LATE + 0.001) == ("build-up",)
    assert missed(0.1, 0.1) == ("reaction", "build-up")
    assert missed(0.06, 0.05, unsure=0.04) == ("reaction or build-up",)
    assert NONE.missed == ()


# Drives of the plant: `parked_car` is a regulated stop, in which the distance does not show late brakes.

#: speed [m/s], what is wrong with the car, and by how much its brakes are later [s] and slower [s] than declared
PLANTED: dict[str, tuple[float, dict[str, float], float, float]] = {
    "as declared": (11.176, {}, 0.0, 0.0),
    "uphill, heavy, weak": (8.0, {"grade_percent": 3.0, "mass_factor": 1.15, "brake_gain_factor": 0.9}, 0.0, 0.0),
    "200 ms late, slow": (5.0, {}, 0.2, 0.0),
    "200 ms late, fast": (20.0, {}, 0.2, 0.0),
    "100 ms late": (11.176, {"grade_percent": -3.0, "mass_factor": 1.15}, 0.1, 0.0),
    "a lag of 100 ms more": (11.176, {}, 0.0, 0.1),
}


def _drive(folder: Path) -> None:
    """Drive all of them; call it through `isolated`. What the gateway believes of the car stays as declared."""
    from vve_sumo.drive import lockstep
    from vve_sumo.drive import run as drives

    as_declared = lockstep.car_parameters
    for seed, (name, (speed, errors, delay, lag)) in enumerate(PLANTED.items(), 1):

        def late(resolved: Any, delay: float = delay, lag: float = lag) -> Any:
            parameters = as_declared(resolved)
            vehicle = parameters.vehicle
            brakes = replace(vehicle, brake_delay=vehicle.brake_delay + delay, brake_lag=vehicle.brake_lag + lag)
            return replace(parameters, vehicle=brakes)

        lockstep.car_parameters = late
        at = obstacle_s(speed, 20.0) if speed < 7.0 else obstacle_s(speed)
        changes = {
            "seed": seed,
            "duration_s": 200.0,
            "road.demand": [],
            "ego.speed_mps": speed,
            "obstacles": [{"id": "parked_car", "at_m": at}],
            **{f"ego.car.{key}": value for key, value in errors.items()},
        }
        drives.run(altered(changes), folder / name, REPOSITORY)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("answers")
    isolated(_drive, folder, timeout=900.0)
    return folder


def without_truth(folder: Path, copy: Path) -> Run:
    """The same record as of a real car, whose true motion nobody knows."""
    copy.mkdir()
    for file in folder.iterdir():
        if file.is_file():
            (copy / file.name).write_bytes(file.read_bytes())
    ticks = pq.read_table(copy / "ticks.parquet")
    for at, field in enumerate(ticks.schema):
        if field.name.startswith("true_"):
            ticks = ticks.set_column(at, field, pa.array(np.full(ticks.num_rows, np.nan)))
    pq.write_table(ticks, copy / "ticks.parquet")
    return Run(copy)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTED)
def test_late_brakes_are_found_in_regulated_stops_and_nominal_ones_are_not(
    driven: Path, tmp_path: Path, name: str
) -> None:
    _speed, errors, delay, lag = PLANTED[name]
    wanted = ["reaction"] * (delay > 0.0) + ["build-up"] * (lag > 0.0)
    run = Run(driven / name)
    given = stopping_bound_check(run)
    assert given.answer.together.value == pytest.approx(0.04 + delay + lag, abs=0.006)
    assert [part for part in given.missed if part != "distance"] == wanted
    if not errors:
        assert "distance" not in given.missed, "the distance alone does not show it"
        assert given.broken is bool(wanted)
    answer = stops.bound_check(run)["answer"]
    assert (answer.kind == "no") is bool(wanted)
    assert ("LATER THAN DECLARED: " + "".join(wanted) in answer.text) is bool(wanted)

    real = stopping_bound_check(without_truth(driven / name, tmp_path / "real"))
    assert real.answer.together.value == pytest.approx(0.04 + delay + lag, abs=LATE)
    assert [part for part in real.missed if part != "distance"] == wanted
