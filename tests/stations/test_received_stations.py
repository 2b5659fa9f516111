"""Bodies of real stations: where, when and how they move, in closed form; and through hostile reports."""

from __future__ import annotations

import json
import math
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.stations.messages import EPOCH, FRAME, car, walker
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame
from vve_sumo.stations.received_stations import (
    CATCH_UP,
    EXTRAPOLATION,
    MAX_OFFSET,
    ReceivedStations,
    StationsSetup,
    StationState,
)
from vve_sumo.stations.reports import StationReport, read
from vve_sumo.stations.station_gate import REASONS, GateLimits

HERE = StationsSetup(FRAME.projection, FRAME.offset, Alignment(), (0.0, 0.0), EPOCH, GateLimits())
DELAY = 0.03


def hear(stations: ReceivedStations, datagram: bytes, received: float) -> str:
    said = read(datagram, received, EPOCH)
    return stations.receive(received, said) if isinstance(said, StationReport) else said


def only(states: tuple[StationState, ...]) -> StationState:
    (state,) = states
    return state


def test_a_car_has_its_body_once_two_messages_were_believed_and_moves_as_it_says() -> None:
    stations = ReceivedStations(HERE)
    for number in range(20):
        time = 0.1 * number
        assert hear(stations, car(time, 10.0 * time, 3.0), time + DELAY) == ""
        states = stations.step(time + 0.06)
        if number == 0:
            assert states == ()
            continue
        state = only(states)
        # Its middle is half a length behind the front that it tells of; to the rounding of 1e-7 degrees.
        assert state.body.x == pytest.approx(10.0 * (time + 0.06) - 2.25, abs=0.03)
        assert state.body.y == pytest.approx(3.0, abs=0.03)
        assert (state.body.id, state.body.kind, state.body.speed) == ("station.4711", "car", 10.0)
        assert abs(state.body.heading) < math.radians(0.06)
        assert state.age == pytest.approx(0.06, abs=1e-3)


def test_a_car_in_a_bend_follows_its_circle_between_messages() -> None:
    """20 m of radius at 8 m/s: half a second on, it is where the circle is."""
    stations, rate = ReceivedStations(HERE), 8.0 / 20.0

    def circle(time: float) -> tuple[float, float, float]:
        turn = rate * time
        return 20.0 * math.sin(turn), 20.0 * (1.0 - math.cos(turn)), turn

    for time in (0.0, 0.5):
        x, y, turn = circle(time)
        front = x + 2.25 * math.cos(turn), y + 2.25 * math.sin(turn)
        assert hear(stations, car(time, *front, turn, 8.0, yaw_rate=rate), time + DELAY) == ""
    body = only(stations.step(1.0)).body
    x, y, turn = circle(1.0)
    # A chord of the half step stands for the arc: 4 m x (1 - sinc) = 7 mm.
    assert (body.x, body.y, body.heading) == pytest.approx((x, y, turn), abs=0.04)


def test_a_station_lies_where_the_alignment_lays_its_lot() -> None:
    """Turned by 0.6 rad and moved, on a map whose north is not the road's."""
    leaning = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-86 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
    x, y = leaning.to_map(math.radians(40.0041), math.radians(-83.0186))
    turned = Alignment(
        0.6, 1000.0 - x * math.cos(0.6) + y * math.sin(0.6), 500.0 - x * math.sin(0.6) - y * math.cos(0.6)
    )
    setup = StationsSetup(leaning.projection, leaning.offset, turned, (1000.0, 500.0), EPOCH, GateLimits())
    stations = ReceivedStations(setup)
    for time in (0.0, 0.1):
        front = x + 12.25 + 10.0 * time, y
        assert hear(stations, car(time, *front, 0.0, 10.0, frame=leaning), time + DELAY) == ""
    body = only(stations.step(0.1)).body
    way = 11.0
    assert (body.x, body.y) == pytest.approx((1000.0 + way * math.cos(0.6), 500.0 + way * math.sin(0.6)), abs=0.03)
    assert body.heading == pytest.approx(0.6, abs=math.radians(0.06))


def test_a_body_does_not_jump_and_is_where_it_is_said_within_a_second() -> None:
    """A station whose second place is 2 m beside its first: the body's way there falls to 1/e within 0.3 s."""
    stations = ReceivedStations(HERE)
    for time, y in ((0.0, 0.0), (0.1, 0.0), (0.2, 2.0)):
        assert hear(stations, car(time, 0.0, y, 0.0, 0.0), time) == ""
    for later in (0.0, 0.1, 0.3, 0.6):
        y = only(stations.step(0.2 + later)).body.y
        assert y == pytest.approx(2.0 * (1.0 - math.exp(-later / CATCH_UP)), abs=0.03)


def test_a_body_that_is_far_off_is_placed_anew() -> None:
    stations = ReceivedStations(HERE)
    off = MAX_OFFSET + 1.0
    for time, y in ((0.0, 0.0), (0.1, 0.0)):
        assert hear(stations, car(time, 0.0, y, 0.0, 0.0), time) == ""
    assert hear(stations, car(0.9, 0.0, off, 0.0, 0.0), 0.9) == ""
    assert only(stations.step(0.9)).body.y == pytest.approx(off, abs=0.03)


def test_a_station_that_falls_silent_goes_on_then_stands_then_is_gone() -> None:
    stations = ReceivedStations(HERE)
    for time in (0.0, 0.1):
        hear(stations, car(time, 10.0 * time), time + DELAY)
    assert only(stations.step(1.0)).body.x == pytest.approx(10.0 - 2.25, abs=0.03)
    last = only(stations.step(2.05)).body
    assert (last.x, last.speed) == (pytest.approx(1.0 + 10.0 * EXTRAPOLATION - 2.25, abs=0.03), 0.0)
    assert len(stations.step(2.09)) == 1
    assert stations.step(2.11) == ()


def test_a_person_who_stands_is_there_for_ten_seconds_and_faces_as_before() -> None:
    stations = ReceivedStations(HERE)
    hear(stations, walker(0.0, 5.0, 2.0, 1.2, 1.4), 0.0)
    hear(stations, walker(0.5, 5.0, 2.0, None, 0.0), 0.5)
    body = only(stations.step(10.4)).body
    assert (body.kind, body.speed) == ("pedestrian", 0.0)
    assert body.heading == pytest.approx(1.2, abs=math.radians(0.06))
    assert stations.step(10.6) == ()


def test_a_refused_report_changes_nothing_of_the_body() -> None:
    one, other = ReceivedStations(HERE), ReceivedStations(HERE)
    for time in (0.0, 0.1, 0.2):
        for stations in (one, other):
            assert hear(stations, car(time, 10.0 * time), time + DELAY) == ""
    for spoof, reason in (
        (car(0.25, 60.0), "jumped"),
        (car(-0.05, 0.0), "out_of_order"),
        (car(0.25, 2.5, confidence=None), "inaccurate"),
        (car(0.25, 2.5, speed=69.0), "jumped"),
        (car(5.0, 2.5), "from_future"),
    ):
        assert hear(other, spoof, 0.28) == reason
    assert one.step(0.3) == other.step(0.3)


def test_a_thousand_hostile_datagrams_leave_bodies_that_are_sound() -> None:
    """Real and forged stations, forged numbers, jumps, old and future times, bits flipped: 50 s of it."""
    random, stations = Random(3), ReceivedStations(HERE)
    reasons = set()
    for number in range(2000):
        now = 0.025 * number
        kind = random.randrange(4)
        datagram = (
            car(now, 5.0 * now % 80.0, 0.0, 0.0, 5.0, station=7)
            if kind == 0
            else car(
                now + random.uniform(-3.0, 3.0), random.uniform(-900.0, 900.0), random.uniform(-900.0, 900.0),
                random.uniform(-4.0, 4.0), random.uniform(0.0, 160.0), station=random.randrange(2**32),
            )
            if kind == 1
            else walker(now, random.uniform(-9.0, 9.0), 1.0, random.uniform(-3.0, 3.0), random.uniform(0.0, 20.0))
        )  # fmt: skip
        if kind == 3:
            spoilt = bytearray(datagram)
            spoilt[random.randrange(len(spoilt))] ^= 1 << random.randrange(8)
            datagram = bytes(spoilt)
        reasons.add(hear(stations, datagram, now))
        states = stations.step(now + 0.02)
        assert len(states) <= 32
        assert len({state.station for state in states}) == len(states)
        for state in states:
            body = state.body
            assert all(map(math.isfinite, (body.x, body.y, body.heading, body.speed, body.length, body.width)))
            assert math.hypot(body.x, body.y) <= 500.0 + 70.0 * EXTRAPOLATION + MAX_OFFSET + 5.0
            assert 0.0 <= body.speed <= 70.0
    assert {"", "jumped", "old", "from_future", "elsewhere", "too_fast", "churn"} <= reasons <= {"", *REASONS}


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 0.5),
            st.builds(
                StationReport, st.integers(0, 3), st.sampled_from((2, 16)), st.sampled_from(("car", "child")),
                *(st.floats() | st.floats(-2.0, 2.0),) * 10,
            ),
        ),
        max_size=12,
    )
)  # fmt: skip
def test_no_report_raises_anything(reports: list[tuple[float, StationReport]]) -> None:
    stations, now = ReceivedStations(HERE), 0.0
    for elapsed, report in reports:
        now += elapsed
        assert stations.receive(now, report) in {"", *REASONS}
        for state in stations.step(now):
            assert all(map(math.isfinite, (state.body.x, state.body.y, state.body.heading, state.body.speed)))


def test_a_setup_survives_its_record() -> None:
    setup = StationsSetup("+proj=utm +zone=17", (1.0, 2.0), Alignment(0.1, 2.0, 3.0), (4.0, 5.0), 6.0,
                          GateLimits(100.0, 3.0, 5, frozenset({1, 9})))  # fmt: skip
    assert StationsSetup.from_dict(json.loads(json.dumps(setup.to_dict()))) == setup
    with pytest.raises(ConfigError, match="stations: none of this version"):
        StationsSetup.from_dict({"projection": "+proj=utm"})
