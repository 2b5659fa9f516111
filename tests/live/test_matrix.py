"""The fault matrix, row by row, with the real processes: whatever breaks, what is right to happen happens.

A row is judged by what the car really did and by what stands in its record. A run that fails while the machine itself
was seen to stand still says nothing of the drive and is repeated; one that fails without is a failure.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from threading import Semaphore

import numpy as np
import pytest
import shapely

from tests import vehicles
from tests.exhaustive import with_slow
from tests.live.matrix import (
    EACH,
    GATEWAY,
    MATRIX,
    QUICK,
    SLOW,
    SPEED,
    STEP,
    TOLERANCE,
    WATCHDOG,
    Layer,
    Right,
    Row,
    bound,
    in_turn,
    pace,
)
from tests.live.stage import Evidence, Stage
from vve_sumo.bus import read_log
from vve_sumo.drive import reasons
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve
from vve_sumo.values import Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import CRITICAL
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.layout import Variant

ATTEMPTS = 4
#: drives at a time; each takes half a core while it starts and a fifth of one under way
TOGETHER = 2
DRIVING = Semaphore(TOGETHER)
JUDGING = 1  # while the next drives begin
STANDING = 0.05  # slower is rest [m/s]
VARIANT = Variant.DBW1_2024


@pytest.fixture(scope="module")
def tried(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Future[str]]]:
    """What came of every row that was asked for, by name; those that are ridden through share a drive."""
    params = (
        item.callspec.params
        for item in request.session.items
        if isinstance(item, pytest.Function) and hasattr(item, "callspec")
    )
    chosen = [param["row"] for param in params if isinstance(param.get("row"), Row)]
    crew = ThreadPoolExecutor(TOGETHER + JUDGING)
    ridden = tuple(row for row in chosen if row.right is Right.RIDDEN)
    tries = [ridden] * bool(ridden) + [(row,) for row in chosen if row not in ridden]
    came = [(rows, crew.submit(attempt, rows, tmp_path_factory.mktemp(rows[0].name))) for rows in tries]
    yield {row.name: future for rows, future in came for row in rows}
    crew.shutdown(cancel_futures=True)


@pytest.mark.live
@pytest.mark.parametrize(
    "row", with_slow(MATRIX, lambda row: row.name not in SLOW, lambda row: row.name in QUICK), ids=lambda row: row.name
)
def test_a_fault_has_its_right_outcome(row: Row, tried: dict[str, Future[str]]) -> None:
    print(tried[row.name].result())


def attempt(rows: tuple[Row, ...], folder: Path) -> str:
    """Run rows in one drive and judge each, again where the machine stood still; return what was found in words."""
    words, row = "", in_turn(rows)
    for number in range(1, ATTEMPTS + 1):
        with DRIVING:
            evidence = Stage(row, folder / str(number)).run()
        try:
            for turn, each in enumerate(rows):
                judge(each, dataclasses.replace(evidence, moment=evidence.moment + turn * EACH))
        except AssertionError:
            if not evidence.stalls or number == ATTEMPTS:
                raise
            stood = ", ".join(f"{1e3 * (end - begin):.0f} ms at {begin:.2f} s" for begin, end in evidence.stalls)
            words += f"{row.name}: run {number} says nothing: the machine stood still for {stood} of the drive\n"
        else:
            return f"{words}{row.name}: {measured(row, evidence)}"
    raise AssertionError("a run is judged or fails")


def measured(row: Row, evidence: Evidence) -> str:
    """What came out of a row, for whoever looks."""
    begun, most = moment(row, evidence), math.nan if row.stops is None else allowed(row, evidence)
    words = f"{evidence.summary['outcome']}: {'+'.join(evidence.summary['reasons'])}"
    driven, speed = way_to_rest(evidence, begun), speed_at(evidence, begun)[0]
    return f"{words}; {driven:.2f} m to rest from {speed:.2f} m/s, at most {most:.2f}"


def judge(row: Row, evidence: Evidence) -> None:
    """Assert all that a row promises."""
    assert_broken_under_way(row, evidence)
    assert evidence.alive == ()
    match row.right:
        case Right.REST:
            assert_at_rest(row, evidence)
        case Right.DRIVER:
            assert_driver_has_control(evidence)
        case Right.RIDDEN:
            assert_ridden_through(evidence)
    assert_told(row, evidence)
    assert_inside(evidence)
    assert "Traceback" not in evidence.said
    if row.name == "drive_frozen":
        assert_silent(evidence)


# Each of the three right outcomes.


def assert_broken_under_way(row: Row, evidence: Evidence) -> None:
    """Nothing was wrong before the fault, and the car drove."""
    assert not math.isnan(evidence.moment), f"it never came to the fault: {evidence.said}"
    begun = moment(row, evidence)
    assert [step["state"] for step in evidence.gateway if step["time_s"] <= begun][-1] == "engaged"
    assert speed_at(evidence, begun)[0] > SPEED - 1.0


def assert_at_rest(row: Row, evidence: Evidence) -> None:
    """The car came to rest within the bound, for this reason, and nothing let it go on."""
    truth = evidence.truth
    assert truth["speed_mps"][-1] == 0.0
    assert way_to_rest(evidence, moment(row, evidence)) <= allowed(row, evidence)
    after = [step for step in evidence.gateway if step["time_s"] > moment(row, evidence)]
    stopped = [step for step in after if step["state"] != "engaged"]
    assert all(step["throttle_percent"] == 0.0 for step in stopped)
    stood = [step["time_s"] for step in stopped if step["state"] == "stopped"]
    assert all(speed_at(evidence, when)[0] < STANDING for when in stood), "a car that moves is not held to stand"
    assert after[len(after) - len(stopped) :] == stopped, "engaged again"
    if row.stops is GATEWAY and CRITICAL.isdisjoint(evidence.summary["reasons"]):
        assert hardest(evidence) < pace(row), "the gateway keeps its own pace"
    if row.stops is WATCHDOG:
        assert truth["watchdog_braking"].any()
    begun = [step["reasons"].split("+") for step in stopped[:1]] or [evidence.summary["reasons"]]
    assert begun[0][0] in row.reasons + row.first, "the record, or what is left of it, says why it began to stop"


def assert_driver_has_control(evidence: Evidence) -> None:
    """Every enable bit is off in the frames that follow the report of the override, and the counter goes on."""
    frames = [frame for _time, _bus, frame in read_log(evidence.folder / "can.log")]
    said = [codec.decode(frame, VARIANT) for frame in frames]
    latched = next(index for index, message in enumerate(said) if getattr(message, "override", False))
    kinds = (codec.BrakeCommand, codec.ThrottleCommand, codec.SteeringCommand)
    for kind in kinds:
        before = [message for message in said[:latched] if isinstance(message, kind)]
        after = [message for message in said[latched:] if isinstance(message, kind)]
        assert before[-1].enable
        assert not any(message.enable for message in after)
        counted = [message.counter for message in (before[-1], *after)]
        assert np.all(np.diff(counted) % 256 == 1)
        assert len(after) > 20
    assert not evidence.truth["watchdog_braking"].any()
    assert evidence.truth["speed_mps"][-1] == 0.0, "the driver stopped it"


def assert_ridden_through(evidence: Evidence) -> None:
    """The drive went on until the operator stopped it."""
    went = [step for step in evidence.gateway if step["state"] != "engaged" and step["time_s"] > evidence.moment]
    assert went[0]["operator_command"] == "stop"
    assert went[0]["time_s"] > evidence.moment + 2.5
    assert went[0]["reasons"] == "stop_asked"
    assert evidence.truth["speed_mps"][-1] == 0.0


# What holds for all.


def assert_told(row: Row, evidence: Evidence) -> None:
    """The reasons stand in the record, and there are words for them."""
    assert evidence.summary.get("outcome") == row.ending, evidence.said
    assert set(row.reasons) <= set(evidence.summary["reasons"])
    assert all(code in reasons.ALL for code in evidence.summary["reasons"])
    if row.fix:
        refused = [tick["pose_reasons"].split("+") for tick in evidence.ticks if tick["time_s"] > evidence.moment]
        assert any(not set(row.fix).isdisjoint(codes) for codes in refused)


def assert_inside(evidence: Evidence) -> None:
    """All the ground that the body covered lies inside the lot."""
    rig = rigs.load(evidence.folder.parent / "rig.toml")
    lot, car, truth = resolve.lot_of(rig), vehicles.FUSION.vehicle, evidence.truth
    ground = shapely.Polygon(lot.outline, lot.holes)
    ahead, behind, half = car.wheelbase + car.front_overhang, -car.rear_overhang, car.width / 2.0
    corners = np.array([[ahead, half], [behind, half], [behind, -half], [ahead, -half]])
    cos, sin = np.cos(truth["heading_rad"]), np.sin(truth["heading_rad"])
    x = truth["x_m"][:, None] + np.outer(cos, corners[:, 0]) - np.outer(sin, corners[:, 1])
    y = truth["y_m"][:, None] + np.outer(sin, corners[:, 0]) + np.outer(cos, corners[:, 1])
    assert shapely.covers(ground, shapely.polygons(np.stack([x, y], axis=-1))).all()


def assert_silent(evidence: Evidence) -> None:
    """No frame derives from a setpoint beyond its lifetime; what follows is the gateway's own stop."""
    taken = [(step["time_s"], link.decode_setpoint(step["setpoint"])) for step in evidence.gateway if step["setpoint"]]
    last, setpoint = taken[-1]
    assert isinstance(setpoint, Setpoint)
    assert last < evidence.moment + STEP
    assert setpoint.expires - setpoint.time <= 0.1 + 1e-9
    late = [step for step in evidence.gateway if step["time_s"] > setpoint.expires]
    assert late
    assert all(step["state"] != "engaged" for step in late)
    assert {step["sequence"] for step in late} <= {setpoint.sequence, -1}
    assert max(step["throttle_percent"] for step in late) == 0.0
    assert late[0]["time_s"] < setpoint.expires + 2.0 * STEP


# Measuring.


def moment(row: Row, evidence: Evidence) -> float:
    """Drive time of the fault [s]."""
    if not row.by_reason:
        return evidence.moment
    return float(next(step["time_s"] for step in evidence.gateway if step["state"] == "stopping")) - STEP


def speed_at(evidence: Evidence, when: float) -> tuple[float, float]:
    """Return speed and acceleration at a drive time."""
    truth = evidence.truth
    time, speed = truth["time_s"], truth["speed_mps"]
    here, before = (float(np.interp(at, time, speed)) for at in (when, when - 0.1))
    return here, (here - before) / 0.1


def way_to_rest(evidence: Evidence, when: float) -> float:
    """Return how far the car drove after a drive time [m]."""
    truth = evidence.truth
    after = truth["time_s"] >= when
    return float(np.hypot(np.diff(truth["x_m"][after]), np.diff(truth["y_m"][after])).sum())


def hardest(evidence: Evidence) -> float:
    """Return the hardest deceleration over a tenth of a second [m/s2]."""
    speed = evidence.truth["speed_mps"]
    return float((speed[:-10] - speed[10:]).max()) / 0.1


def allowed(row: Row, evidence: Evidence) -> float:
    """Return how far it may have driven [m]."""
    return bound(row, *speed_at(evidence, moment(row, evidence)))


def test_the_bound_is_the_closed_form_of_known_examples() -> None:
    """From 40 km/h: 9.60 m at 9 m/s2 and 30 m/s3 after 0.1 s, 16.34 m at 6 m/s2 and 12 m/s3 after 0.3 s."""
    for delay, deceleration, jerk, distance in ((0.1, 9.0, 30.0, 9.60), (0.3, 6.0, 12.0, 16.34)):
        layer = Layer("", deceleration, deceleration / jerk, 0.0)
        row = Row("", "", Right.REST, stops=layer, notice=delay)
        assert bound(row, 40.0 / 3.6, 0.0) - TOLERANCE * 40.0 / 3.6 == pytest.approx(distance, abs=0.005)
