"""What a V2X receiver knows: against the truth of the scene, the standards' rules, and the codecs' own bytes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.sensors.street import Building, Walls, walls_of
from vve_sumo.sensors.v2x import V2xConfig, V2xReceiver
from vve_sumo.sensors.v2x_messages import CAM, VAM, V2xReading
from vve_sumo.values import Actors, Pose, Stations

PERIOD = 0.02
CONFIG = V2xConfig()
IDEAL = CONFIG.ideal()
NO_WALLS = walls_of(())
#: a map whose north is not the earth's: 3 degrees east of its meridian, in Columbus
LEANING = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-86 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
COLUMBUS = LEANING.to_map(math.radians(40.0), math.radians(-83.0))


class Heard(NamedTuple):
    """A reading, when it came out, and the output beside it."""

    time: float
    reading: V2xReading
    output: Stations


def heard(
    config: V2xConfig, scene: Callable[[float], Actors], seconds: float = 2.0, *, seed: int = 1,
    ego: Callable[[float], Pose] = lambda time: rear_axle(), walls: Walls = NO_WALLS,
    frame: MapFrame | None = None,
) -> list[Heard]:  # fmt: skip
    receiver = V2xReceiver(config, FUSION, np.random.default_rng(seed), walls, frame or local_frame(0.7, -1.4))
    found = []
    for tick in range(round(seconds / PERIOD) + 1):
        time = tick * PERIOD
        assert receiver.step(time, replace(ego(time), time=time), scene(time)) is None
        reading = receiver.prepare()
        if reading is not None:
            found.append(Heard(time + PERIOD, reading, receiver.output))
    return found


def standing(*rows: tuple[float, ...], kind: str = "car") -> Callable[[float], Actors]:
    scene = actors(rows, [f"{kind}{n}" for n in range(len(rows))], kind=kind)  # type: ignore[arg-type]
    return lambda time: scene


def walker(x: float, y: float, heading: float = 0.0, speed: float = 0.0) -> tuple[float, ...]:
    return x, y, heading, speed, 0.6, 0.5, 1.0


# --- where ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5, math.pi])
@pytest.mark.parametrize("turned", [0.0, 0.7, -2.0])
def test_a_car_is_where_it_is_on_a_map_that_leans(heading: float, turned: float) -> None:
    """To the rounding of the message: 1e-7 degrees, 0.1 degree of heading at half a car's length."""
    x, y = COLUMBUS
    scene = standing(car(x + 40.0, y - 7.0, heading))
    ego = rear_axle(x, y, turned)
    output = heard(IDEAL, scene, 1.5, ego=lambda time: ego, frame=LEANING)[-1].output
    ahead, left = 40.0 * math.cos(turned) - 7.0 * math.sin(turned), -7.0 * math.cos(turned) - 40.0 * math.sin(turned)
    assert output.x.tolist() == pytest.approx([ahead - BUMPER], abs=0.02)
    assert output.y.tolist() == pytest.approx([left], abs=0.02)
    off = math.remainder(output.heading[0] - (heading - turned), math.tau)
    assert abs(off) < math.radians(0.06)
    front = LEANING.to_map(float(output.latitude[0]), float(output.longitude[0]))
    expected = (x + 40.0 + 2.25 * math.cos(heading), y - 7.0 + 2.25 * math.sin(heading))
    assert front == pytest.approx(expected, abs=0.01)
    assert (output.length.tolist(), output.width.tolist()) == ([4.5], [1.8])


def test_a_person_is_in_the_middle_and_has_the_size_that_is_usual() -> None:
    output = heard(IDEAL, standing(walker(25.0, 4.0, 1.2), kind="child"), 0.5)[-1].output
    assert output.x.tolist() == pytest.approx([25.0 - BUMPER], abs=0.01)
    assert output.y.tolist() == pytest.approx([4.0], abs=0.01)
    assert output.message.tolist() == [VAM]
    # No message tells a child from an adult.
    assert output.kind.tolist() == [number_of("pedestrian")]
    assert output.length.tolist() == [TYPICAL["pedestrian"].length]


@pytest.mark.parametrize(
    ("kind", "message"),
    [("car", CAM), ("van", CAM), ("truck", CAM), ("bus", CAM), ("motorcycle", CAM), ("bicycle", VAM)],
)
def test_kinds_survive_their_message(kind: str, message: int) -> None:
    output = heard(IDEAL, standing(car(30.0, 0.0), kind=kind), 0.5)[-1].output
    assert (output.kind.tolist(), output.message.tolist()) == ([number_of(kind)], [message])


# --- when -------------------------------------------------------------------------------------------------------------


def _approaching(speed: float, from_x: float = 150.0) -> Callable[[float], Actors]:
    return lambda time: actors([car(from_x - speed * time, 3.5, math.pi, speed)], ["oncoming"])


def test_a_message_comes_out_after_the_latency_and_tells_its_own_age() -> None:
    for one in heard(replace(IDEAL, latency=0.1), _approaching(15.0), 6.0):
        for message in one.reading.messages:
            assert one.reading.time - message.time == pytest.approx(0.1, abs=1e-9)
            assert one.time - message.time == pytest.approx(0.12, abs=1e-9)
            # The place is that of the time that it tells of.
            assert message.x == pytest.approx(150.0 - 15.0 * message.time, abs=0.02)


def test_a_car_at_15_mps_is_heard_each_0_3_seconds() -> None:
    """Whenever it has gone more than 4 m, at a check each 0.1 s."""
    times = [message.time for one in heard(IDEAL, _approaching(15.0), 6.0) for message in one.reading.messages]
    assert np.diff(times) == pytest.approx([0.3] * (len(times) - 1), abs=0.021)
    assert len(times) >= 19


def test_a_station_stays_until_twice_the_longest_interval() -> None:
    """A car that is gone is forgotten after 2 s, a person after 10 s; nothing is heard of either meanwhile."""

    def scene(time: float) -> Actors:
        return actors([] if time > 1.0 else [car(30.0, 0.0)], [] if time > 1.0 else ["car"])

    outputs = heard(IDEAL, scene, 6.0)
    last = max(message.time for one in outputs for message in one.reading.messages)
    known = [one.output.time for one in outputs if len(one.output.number)]
    assert last + 1.5 < max(known) <= last + 2.0 + 1e-9


def test_where_nothing_is_heard_an_empty_output_comes_twice_a_second() -> None:
    outputs = heard(CONFIG, lambda time: Actors.none(time), 4.0)
    assert np.diff([one.output.time for one in outputs]) == pytest.approx([0.5] * (len(outputs) - 1))
    assert all(len(one.output.number) == 0 for one in outputs)


def test_acceleration_and_yaw_rate_are_those_of_the_motion() -> None:
    def scene(time: float) -> Actors:
        speed = 15.0 - 3.0 * time
        return actors([car(60.0 + 15.0 * time - 1.5 * time**2, 0.2, 0.1 * time, speed)], ["braking"])

    output = heard(IDEAL, scene, 3.0)[-1].output
    assert output.acceleration.tolist() == pytest.approx([-3.0], abs=0.051)
    assert output.yaw_rate.tolist() == pytest.approx([0.1], abs=0.001)
    assert output.speed.tolist() == pytest.approx([15.0 - 3.0 * (output.time - output.age[0])], abs=0.011)


# --- who is heard -----------------------------------------------------------------------------------------------------


def _names(outputs: list[Heard]) -> set[str]:
    return {message.actor for one in outputs for message in one.reading.messages}


@pytest.mark.parametrize(("share", "field"), [(0.3, "equipped"), (0.0, "equipped"), (1.0, "equipped")])
def test_so_many_of_the_vehicles_send(share: float, field: str) -> None:
    rows = [car(20.0 + 0.1 * n, 30.0) for n in range(600)]
    names = _names(heard(replace(IDEAL, **{field: share}), standing(*rows), 0.3))
    assert len(names) / 600 == pytest.approx(share, abs=0.05)


def test_people_without_a_device_are_not_heard_and_their_share_is_not_that_of_cars() -> None:
    mixed = replace(IDEAL, equipped=0.0)
    assert _names(heard(mixed, standing(walker(20.0, 0.0), kind="pedestrian"), 1.0)) == {"pedestrian0"}
    assert _names(heard(mixed, standing(car(20.0, 0.0)), 1.0)) == set()
    assert (
        _names(heard(replace(IDEAL, equipped_vulnerable=0.0), standing(walker(20.0, 0.0), kind="child"), 1.0)) == set()
    )


def test_so_many_packets_are_lost() -> None:
    rows = [car(20.0 + 0.1 * n, 30.0) for n in range(100)]
    whole = sum(len(one.reading.messages) for one in heard(IDEAL, standing(*rows), 10.0))
    some = sum(len(one.reading.messages) for one in heard(replace(IDEAL, loss=0.25), standing(*rows), 10.0))
    assert some / whole == pytest.approx(0.75, abs=0.04)


def test_a_car_around_the_corner_is_heard_from_nearer_than_one_in_sight() -> None:
    """23 dBm and -82 dBm: the tables' mean loss of 105 dB is reached behind a building at 61 m."""
    corner = walls_of([Building(((10.0, 10.0), (200.0, 10.0), (200.0, 200.0), (10.0, 200.0)), 8.0)])
    reach = 10.0 ** ((105.0 - 36.85 - 18.9 * math.log10(5.9)) / 30.0)
    assert reach == pytest.approx(61.1, abs=0.1)
    shares = []
    for distance in (0.6 * reach, 1.6 * reach):
        # The antenna is at 26 m, so that the building is in between.
        rows = [car(5.0 + 0.001 * n, math.sqrt(distance**2 - 21.0**2)) for n in range(200)]
        messages = heard(CONFIG, standing(*rows), 0.3, ego=lambda time: rear_axle(25.0, 0.0), walls=corner)
        shares.append(len(_names(messages)) / 200)
    in_sight = len(_names(heard(CONFIG, standing(*(car(200.0, 0.001 * n) for n in range(200))), 0.3))) / 200
    # 6.7 dB nearer and farther than that, less 2 % of loss, with a shadowing of 4 dB and the cars themselves between.
    assert shares[0] > 0.9
    assert shares[1] < 0.1
    assert in_sight > 0.9


def test_places_err_by_their_sigma_and_say_so() -> None:
    rows = [car(50.0, 3.0 * n) for n in range(300)]
    noisy = replace(IDEAL, position_sigma=2.0)
    scene = standing(*rows)
    messages = [message for one in heard(noisy, scene, 1.0) for message in one.reading.messages]
    off = np.array([(one.x - 50.0, one.y - 3.0 * int(one.actor[3:])) for one in messages])
    assert off.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.1)
    # The radius that is told holds 95 % of them.
    radius = messages[0].uncertainty
    assert radius == pytest.approx(2.0 * math.sqrt(-2.0 * math.log(0.05)), abs=0.011)
    assert np.mean(np.hypot(*off.T) <= radius) == pytest.approx(0.95, abs=0.03)


def test_a_stations_errors_hold_on() -> None:
    """Correlated by 0.9 from one second to the next."""
    rows = [car(50.0, 3.0 * n) for n in range(400)]
    places: dict[str, list[float]] = {}
    for one in heard(replace(IDEAL, position_sigma=2.0), standing(*rows), 2.5):
        for message in one.reading.messages:
            places.setdefault(message.actor, []).append(message.x)
    pairs = np.array([own[:2] for own in places.values()]).T
    assert np.corrcoef(pairs)[0, 1] == pytest.approx(0.9, abs=0.04)


def test_one_more_station_changes_nothing_of_the_others() -> None:
    few, more = standing(car(30.0, 0.0), car(40.0, 3.0)), standing(car(30.0, 0.0), car(40.0, 3.0), car(60.0, -6.0))
    of_few = [(m.actor, m.time, m.x, m.power) for one in heard(CONFIG, few, 5.0) for m in one.reading.messages]
    of_more = [(m.actor, m.time, m.x, m.power) for one in heard(CONFIG, more, 5.0) for m in one.reading.messages]
    assert of_few == [row for row in of_more if row[0] != "car2"]


def test_numbers_are_of_32_bits_and_of_one_station_each() -> None:
    rows = [car(20.0 + 0.1 * n, 30.0) for n in range(300)]
    messages = [m for one in heard(IDEAL, standing(*rows), 0.3) for m in one.reading.messages]
    numbers = {message.actor: message.station for message in messages}
    assert len(set(numbers.values())) == len(numbers) == 300
    assert all(0 <= number < 2**32 for number in numbers.values())


# --- what is refused --------------------------------------------------------------------------------------------------


def test_an_actor_that_is_no_number_is_counted_and_not_heard() -> None:
    receiver = V2xReceiver(IDEAL, FUSION, np.random.default_rng(1), NO_WALLS, local_frame(0.7, -1.4))
    for tick in range(20):
        receiver.step(tick * PERIOD, rear_axle(), actors([car(math.nan, 0.0), car(30.0, 0.0)], ["nan", "sound"]))
        reading = receiver.prepare()
        assert receiver.refused == 1
        assert reading is None or {message.actor for message in reading.messages} <= {"sound"}


def test_a_pose_that_is_no_number_is_refused() -> None:
    receiver = V2xReceiver(IDEAL, FUSION, np.random.default_rng(1), NO_WALLS, local_frame(0.7, -1.4))
    with pytest.raises(ValueError, match="not finite"):
        receiver.step(0.0, rear_axle(math.nan), Actors.none(0.0))


def test_a_jammed_receiver_hears_as_before_until_then_and_nothing_after() -> None:
    scene = standing(car(40.0, 0.0), car(-30.0, 3.0))
    free, jammed = heard(CONFIG, scene, 4.0), heard(replace(CONFIG, jammed_from=2.0), scene, 4.0)
    sent = [[(one.station, one.time) for one in said.reading.messages] for said in free]
    got = [[(one.station, one.time) for one in said.reading.messages] for said in jammed]
    assert [row for row in got if row] == [kept for row in sent if (kept := [one for one in row if one[1] < 2.0])]
    assert any(one[1] >= 2.0 for row in sent for one in row)
