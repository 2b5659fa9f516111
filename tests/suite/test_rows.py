"""Rows are laid out as the standards say, by closed forms of our own; what the brakes need agrees with other sums."""

from __future__ import annotations

import math
from itertools import count

import numpy as np
import pytest

from tests import vehicles
from vve_sumo import laws
from vve_sumo.body_kinds import TYPICAL
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.proving_ground import TEST_TRACK
from vve_sumo.scenario.road_users import Actor
from vve_sumo.scenario.schema import Scenario
from vve_sumo.suite import catalogue, requirements
from vve_sumo.suite.physics import DETECTION, BrakedMotion, full_braking, gap_used, reaction_time
from vve_sumo.suite.row import SuiteRow
from vve_sumo.suite.track import loads
from vve_sumo.timing import PERIOD

KMH = 1.0 / 3.6
CAR, LOADS = vehicles.FUSION.vehicle, loads(vehicles.FUSION)
ALL = {name: {row.id: row for row in catalogue.rows(name, vehicles.FUSION)} for name in catalogue.names()}
DRIVEN = [row for rows in ALL.values() for row in rows.values() if row.scenario is not None]


def scene(row: SuiteRow) -> tuple[Scenario, Actor]:
    assert row.scenario is not None
    return row.scenario, row.scenario.actors[0]


def named(name: str, *starts: str) -> list[SuiteRow]:
    rows = [row for row in ALL[name].values() if row.id.startswith(starts or ("",)) and row.scenario is not None]
    assert rows
    return rows


def test_every_row_of_the_tables_is_there():
    r152 = [*requirements.R152_STATIONARY, *requirements.R152_MOVING, *requirements.R152_PEDESTRIAN]
    impacts = sum((row.laden is not None) + (row.unladen is not None) for row in r152)
    assert len(ALL["r152"]) == impacts + len(requirements.R152_TEST_SPEEDS) + 2
    assert len(ALL["r152_01"]) == len(ALL["r152_02"]) == 2 * len(requirements.R152_PEDESTRIAN_01)
    walks = [row.id for row in ALL["fmvss127_pedestrian"].values() if row.scenario is not None]
    assert len(walks) == 6 + 6 + 6 + 5 + 6 + 7
    assert {"stationary_right_25_55", "along_path_right_25_65", "obstructed_crossing_right_50_50"} <= set(walks)
    assert len(ALL["euroncap"]) == len(requirements.EURO_NCAP_CCRS) + len(requirements.EURO_NCAP_CCRM) + 4 + 1
    assert sum(row.scenario is None for row in ALL["fmvss127"].values()) == 4
    assert all(row.not_applicable for rows in ALL.values() for row in rows.values() if row.scenario is None)
    with pytest.raises(ConfigError, match="no suite named 'r153'"):
        catalogue.rows("r153", vehicles.FUSION)


@pytest.mark.parametrize(
    "row", [row for row in DRIVEN if not row.scenario.egos and row.evasion is None], ids=lambda row: row.id
)
def test_a_row_fits_the_track_and_its_target_enters_when_the_car_is_steady(row):
    scenario, actor = scene(row)
    speed, entry = scenario.ego.speed_mps, actor.enters.ego_at_m
    assert actor.ahead_m is not None
    assert entry is not None
    # The shipped controller speeds up at 1.5 m/s2 and needs 3 s more to come within 0.1 km/h.
    assert entry > speed * speed / 3.0 + 3.0 * speed
    lead = actor.speed_mps if abs(actor.turned_deg) < 1.0 else 0.0
    ends = entry + max(actor.ahead_m, 0.0) + (lead + 5.0) * (scenario.duration_s - speed / 1.5) + 60.0
    assert min(ends, entry + speed * scenario.duration_s) < TEST_TRACK.path_length - 50.0


def test_r152_begins_four_seconds_before_contact():
    for row in [*named("r152"), *named("r152_01"), *named("r152_02")]:
        scenario, actor = scene(row)
        lead = actor.speed_mps if actor.kind == "car" else 0.0
        assert actor.ahead_m / (scenario.ego.speed_mps - lead) >= requirements.R152_MIN_TTC
        assert row.approach.above == 0.0
        assert row.approach.speed - row.approach.below < scenario.ego.speed_mps < row.approach.speed
        assert scenario.ego.car.mass_factor == LOADS.get(row.id.rsplit("_", 1)[1], 1.0)


def test_r152_demands_its_braking_wherever_something_is_in_the_way():
    for name in ("r152", "r152_01", "r152_02"):
        for row in named(name):
            free = row.id.startswith("between")
            assert row.demand == (0.0 if free else requirements.R152_BRAKING_DEMAND)
            assert ("demand >= 5" in row.required) is not free
            assert row.scenario.criteria.emergency_used is (False if free else None)


def test_laden_is_the_vehicle_at_its_maximum_mass():
    assert LOADS["laden"] * CAR.mass == pytest.approx(vehicles.FUSION.simulated.laden_mass)
    # A Fusion Hybrid of 3668 lb that carries 800 to 1000 lb.
    assert 4468 * 0.45359 < vehicles.FUSION.simulated.laden_mass < 4668 * 0.45359


def test_r152_allows_what_the_table_says():
    for entry in (*requirements.R152_STATIONARY, *requirements.R152_PEDESTRIAN):
        kind = "child" if entry in requirements.R152_PEDESTRIAN else "stationary"
        for load, allowed in (("laden", entry.laden), ("unladen", entry.unladen)):
            criteria = scene(ALL["r152"][f"{kind}_{entry.speed:g}_{load}"])[0].criteria
            assert criteria.impact_speed_mps.max == pytest.approx(allowed * KMH)
            assert criteria.collision is (None if allowed else False)


def test_who_crosses_would_be_in_the_middle_of_the_way_when_the_car_comes():
    for row in [*named("r152", "child"), *named("r152_01"), *named("r152_02")]:
        scenario, actor = scene(row)
        arrives = actor.ahead_m / scenario.ego.speed_mps
        assert actor.offset_m + arrives * actor.speed_mps == pytest.approx(0.0, abs=0.2)
        pace = {"child": 5.0, "bicycle": 15.0}[actor.kind]
        assert (actor.turned_deg, actor.speed_mps) == (90.0, pytest.approx(pace * KMH))


def test_a_pedestrian_of_fmvss_127_would_be_hit_at_the_overlap():
    """Walked in small steps from the kerb; the overlap is counted from the side from which he comes."""
    for row in named("fmvss127_pedestrian", "crossing", "obstructed"):
        scenario, actor = scene(row)
        arrives = actor.ahead_m / scenario.ego.speed_mps
        assert arrives == pytest.approx(requirements.FMVSS_127_WALK_START)
        (event,) = actor.events
        assert event.when.after_s > 0.0
        way, speed, step = 0.0, 0.0, 1e-4
        for _ in range(round((arrives - event.when.after_s) / step)):
            way += speed * step
            speed = min(speed + event.acceleration_mps2 * step, event.speed_mps)
        from_right = actor.offset_m < 0.0
        aside = actor.offset_m + math.copysign(way, -actor.offset_m)
        covered = 0.5 * CAR.width + aside if from_right else 0.5 * CAR.width - aside
        overlap = 25.0 if "_25_" in row.id else 50.0
        assert 100.0 * covered / CAR.width == pytest.approx(overlap, abs=0.1)
        assert actor.turned_deg == (90.0 if from_right else -90.0)
        assert event.speed_mps == pytest.approx((5.0 if from_right else 8.0) * KMH)


def test_a_pedestrian_on_the_way_begins_four_seconds_of_relative_speed_ahead():
    for row in named("fmvss127_pedestrian", "stationary", "along"):
        scenario, actor = scene(row)
        assert actor.ahead_m == pytest.approx(4.0 * (scenario.ego.speed_mps - actor.speed_mps))
        assert actor.offset_m + 0.5 * CAR.width == pytest.approx(0.25 * CAR.width)
        assert (actor.turned_deg, actor.kind) == (0.0, "pedestrian")


def test_a_hidden_child_is_first_seen_where_the_parked_cars_let_it():
    """The sight from the bumper's middle to the child's front, against the parked cars' edges, moment by moment."""
    for row in named("fmvss127_pedestrian", "obstructed"):
        scenario, child = scene(row)
        nearer, farther = scenario.actors[1:]
        speed, pace = scenario.ego.speed_mps, child.events[0].speed_mps
        edge = nearer.offset_m + 0.5 * nearer.width_m
        assert edge == farther.offset_m + 0.5 * farther.width_m == pytest.approx(-0.5 * CAR.width - 1.0)
        assert child.ahead_m - nearer.ahead_m - nearer.length_m == pytest.approx(1.0)
        assert nearer.ahead_m - farther.ahead_m - farther.length_m == pytest.approx(1.0)
        for tick in count():
            left = 3.0 - 1e-4 * tick
            front = -pace * left + 0.5 * TYPICAL["child"].length
            at_corner = front * (speed * left - 1.0) / (speed * left)
            if at_corner > edge:
                break
        assert row.need.available == pytest.approx(speed * left, abs=0.01)


def test_fmvss_127_begins_five_seconds_of_relative_speed_ahead():
    for row in named("fmvss127", "stopped", "slower"):
        scenario, actor = scene(row)
        assert actor.ahead_m == pytest.approx(5.0 * (scenario.ego.speed_mps - actor.speed_mps))
    for row in named("fmvss127", "decelerating"):
        scenario, actor = scene(row)
        kmh, headway, share = (part.rstrip("mg") for part in row.id.split("_")[1:])
        (event,) = actor.events
        assert scenario.ego.speed_mps == actor.speed_mps == pytest.approx(float(kmh) * KMH)
        assert actor.ahead_m == float(headway)
        assert event.acceleration_mps2 == pytest.approx(float(share) * 9.80665)
        assert 0.0 < event.build_up_s <= requirements.FMVSS_127_LEAD_RAMP
        assert event.speed_mps == 0.0


def test_the_two_cars_leave_a_gap_of_four_and_a_half_metres():
    for row in named("pass_through", "between"):
        left, right = sorted(row.scenario.actors, key=lambda actor: -actor.offset_m)
        gap = (left.offset_m - 0.5 * left.width_m) - (right.offset_m + 0.5 * right.width_m)
        assert gap == pytest.approx(requirements.FMVSS_127_PASS_GAP)
        assert row.scenario.criteria.max_deceleration_mps2.max == pytest.approx(0.25 * 9.80665)


def test_every_case_of_vru_is_driven_by_every_means_where_the_car_is_faster():
    assert len(ALL["vru"]) == 10 * 3 * 6
    left_out = {row.id for row in ALL["vru"].values() if row.scenario is None}
    assert left_out == {
        f"bicyclist_{how}_{means}_10" for how in ("along", "turning") for means in ("braking", "steering", "both")
    }


def test_a_row_of_vru_starts_two_seconds_before_its_target_enters_and_has_road_to_come_back():
    for row in named("vru"):
        scenario, actor = scene(row)
        ego, entry = scenario.ego, actor.enters.ego_at_m
        assert ego.initial_speed_mps == ego.speed_mps
        rolled = entry - ego.initial_s_m - CAR.rear_axle_to_bumper
        assert rolled == pytest.approx(2.0 * ego.speed_mps, abs=3.0)
        assert ego.initial_s_m >= 0.0
        meets = entry + 4.0 * ego.speed_mps
        assert meets + 3.0 * ego.speed_mps < scenario.end_trigger.ego_at_m < TEST_TRACK.path_length - 50.0
        steers = scenario.controller.name == "elastic_band"
        assert [sensor.kind for sensor in scenario.sensors] == (["lidar"] if steers else [])
        braked = scenario.controller.tuning.get("emergency", True)
        assert row.id.rsplit("_", 2)[1] == ("both" if steers and braked else "steering" if steers else "braking")


def test_a_platoon_keeps_to_the_track_and_begins_in_its_order():
    for row in named("cacc"):
        scenario, leader = scene(row)
        front = scenario.ego.initial_s_m + scenario.ego.speed_mps * scenario.duration_s
        assert front + leader.ahead_m + 30.0 < TEST_TRACK.path_length
        starts = [scenario.ego.initial_s_m, *(one.initial_s_m for one in scenario.egos)]
        gaps = [-step - CAR.length for step in np.diff(starts)]
        assert gaps == pytest.approx([leader.ahead_m] * 4)
        assert starts[-1] > 2.0 * CAR.length


def test_who_cuts_into_a_platoon_comes_into_the_middle_of_a_gap():
    for row in named("cacc", "cut_in"):
        _leader, joining = row.scenario.actors
        headway = row.scenario.controller.tuning["time_headway_s"]
        gap = 5.0 + headway * joining.speed_mps
        behind_the_first = -joining.ahead_m - CAR.length
        before_the_second = gap - behind_the_first - joining.length_m
        assert behind_the_first == pytest.approx(before_the_second)
        assert behind_the_first > 3.0
        assert (joining.offset_m, joining.events[0].offset_m, joining.events[1].offset_m) == (4.0, 0.0, 4.0)


def test_a_string_of_acc_is_excused_below_twice_delay_and_lag():
    """By the greatest gain over the frequency, of the law's transfer function."""
    s = 1j * np.geomspace(1e-3, 30.0, 4000)
    delay, lag = 0.05 + 0.02 + 0.09, 0.25
    for row in named("cacc", "string_acc"):
        headway, k2 = row.need.available, 1.0 / row.need.available
        k1, late = 1e-5 * k2, np.exp(-delay * s)
        gain = np.abs(late * (k1 + k2 * s) / (s * s * (lag * s + 1.0) + late * (k1 + (k2 + k1 * headway) * s)))
        assert row.need.avoidable == (gain.max() < 1.0001), headway
        assert (row.need.unit, row.string.max_amplification) == ("s", 1.0)


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("faster", [-0.06, 0.0, 0.06])
@pytest.mark.parametrize("late", [0.0, 0.3, 0.7])
def test_a_cut_in_comes_over_the_edge_of_the_lane_just_before_the_rule_ends(faster: float, late: float) -> None:
    """Tick by tick, of a car that drives a little `faster` than it shall [m/s] and is there `late` [of a tick].

    Corner by corner, the heading from differences of places. A tick is 0.02 s; the rule's 0.05 s are far off.
    """
    for row in named("r157", "cut_in"):
        scenario, actor = scene(row)
        (event,) = actor.events
        ego, other = scenario.ego.speed_mps + faster, actor.speed_mps
        half = (0.5 * actor.length_m, 0.5 * actor.width_m)
        gap = actor.ahead_m - late * PERIOD * (ego - other)
        begins = next(tick * PERIOD for tick in count() if gap / (ego - other) - tick * PERIOD <= event.when.ttc_s)
        assert begins == pytest.approx(1.5, abs=0.2)

        def aside(time: float, start: float = begins, over: float = event.over_s) -> float:
            share = min(max((time - start) / over, 0.0), 1.0)
            return 4.0 * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share * share))

        for step in count():
            time = step * 0.001
            turned = math.atan2(aside(time + 1e-4) - aside(time), 1e-4 * other)
            signs = [(ahead, left) for ahead in (-1.0, 1.0) for left in (-1.0, 1.0)]
            corners = [
                complex(a * half[0], b * half[1]) * complex(math.cos(turned), math.sin(turned)) for a, b in signs
            ]
            if aside(time) + min(corner.imag for corner in corners) < 2.0:
                break
        rest = gap + half[0] + (other - ego) * time + min(corner.real for corner in corners)
        assert rest / (ego - other) == pytest.approx(row.cut_in.ttc, abs=0.5 * PERIOD + 0.004)
        rule = requirements.cut_in_time(ego - faster - other)
        assert row.cut_in.ttc - row.cut_in.tolerance == pytest.approx(rule)


def test_targets_are_as_wide_as_cars():
    widths = {
        actor.width_m or TYPICAL[actor.kind].width
        for row in DRIVEN
        for actor in row.scenario.actors
        if actor.kind == "car"
    }
    assert widths == {1.8, requirements.EURO_NCAP_TARGET_WIDTH}


@pytest.mark.parametrize("speed", [2.0, 5.6, 11.1, 22.2])
@pytest.mark.parametrize("lead", [0.0, 1.5])
def test_what_braking_for_a_steady_car_needs_is_the_stopping_distance(speed, lead):
    needed = gap_used(full_braking(CAR, speed), BrakedMotion(lead))
    delay = reaction_time(CAR)
    assert delay >= DETECTION + PERIOD + CAR.brake_delay
    closed = laws.stopping_distance(speed - lead, CAR.deceleration_limit, delay, 2.0 * CAR.brake_lag)
    assert needed == pytest.approx(closed, abs=1e-3)


def test_an_impact_that_is_allowed_needs_less_way():
    speed, allowed = 16.7, 9.7
    ego = full_braking(CAR, speed)._replace(build_up=0.0)
    needed = gap_used(ego, BrakedMotion(0.0), allowed)
    assert laws.impact_speed(speed, needed, ego.deceleration, ego.delay) == pytest.approx(allowed, abs=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("deceleration", [2.0, 4.9, 6.0])
@pytest.mark.parametrize("last", [0.0, 2.0 * KMH])
def test_a_course_agrees_with_small_steps(deceleration, last):
    course = BrakedMotion(13.9, deceleration, delay=0.3, build_up=0.5, last_speed=last)
    speed, way, step = 13.9, 0.0, 1e-5
    for number in range(round(9.0 / step)):
        pull = deceleration * min(max((number * step - 0.3) / 0.5, 0.0), 1.0)
        slower = max(speed - pull * step, last)
        way, speed = way + 0.5 * (speed + slower) * step, slower
    ways, speeds = course.at(np.array([9.0]))
    assert (ways[0], speeds[0]) == (pytest.approx(way, abs=0.01), pytest.approx(last, abs=1e-6))


def test_a_heavier_car_needs_more():
    light, heavy = (gap_used(full_braking(CAR, 15.0, mass), BrakedMotion(0.0)) for mass in (1.0, 1.15))
    assert heavy - light == pytest.approx(0.15 * 15.0**2 / (2.0 * CAR.deceleration_limit), rel=0.01)


def test_a_car_ahead_that_is_already_at_rest_is_as_one_that_never_moved():
    ego = full_braking(CAR, 13.9)
    stops_at_once = BrakedMotion(0.1, 100.0)
    assert gap_used(ego, stops_at_once) == pytest.approx(gap_used(ego, BrakedMotion(0.0)), abs=0.01)
    assert math.isclose(gap_used(ego, BrakedMotion(30.0)), 0.0)
