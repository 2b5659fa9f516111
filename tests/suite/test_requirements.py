"""The tables of the standards are those of the machine-readable transcription, value by value."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from vve_sumo.suite import requirements
from vve_sumo.suite.euroncap import lateral_offset


@pytest.fixture(scope="module")
def printed(shared_data: Path) -> dict[str, Any]:
    return json.loads((shared_data / "standards" / "regulatory_tables.json").read_text(encoding="utf-8"))


def test_r152_cars(printed):
    table = printed["UN_R152_M1_car_to_car_max_impact_kmh"]
    assert table["columns"] == [
        "rel_speed_kmh",
        "stationary_laden",
        "stationary_unladen",
        "moving_laden",
        "moving_unladen",
    ]
    assert [list(row) for row in requirements.R152_STATIONARY] == [row[:3] for row in table["rows"]]
    moving = [[row[0], *row[3:]] for row in table["rows"] if row[3:] != [None, None]]
    assert [list(row) for row in requirements.R152_MOVING] == moving


def test_r152_pedestrians(printed):
    table = printed["UN_R152_M1_pedestrian_max_impact_kmh_00series"]
    assert [list(row) for row in requirements.R152_PEDESTRIAN] == table["rows"]
    assert table["pedestrian_speed_kmh"] == requirements.R152_PEDESTRIAN_SPEED
    draft = printed["UN_R152_M1_pedestrian_max_impact_kmh_step2_draft"]
    assert [[row.speed, row.laden] for row in requirements.R152_PEDESTRIAN_01] == draft["rows"]
    assert all(row.unladen <= row.laden for row in requirements.R152_PEDESTRIAN_01)
    other = printed["UN_R152_other"]
    assert other["min_brake_demand_mps2"] == requirements.R152_BRAKING_DEMAND
    assert other["test_speeds_stationary_kmh"] == list(requirements.R152_TEST_SPEEDS)
    assert other["functional_part_starts_at_TTC_s_min"] == requirements.R152_MIN_TTC
    assert {row[1] for row in other["test_speeds_moving"]} == {requirements.R152_MOVING_TARGET_SPEED}


def test_fmvss_127(printed):
    table = printed["FMVSS_127_lead"]
    rows = [
        [row.kind, row.subject, row.lead, row.headway, row.deceleration, row.manual_brake]
        for row in requirements.FMVSS_127_LEAD
    ]
    assert rows == [
        [kind, tuple(_range(subject)), lead, _maybe(headway), _maybe(deceleration), manual]
        for kind, subject, lead, headway, deceleration, manual in table["rows"]
    ]
    assert table["L0"] == f"{requirements.FMVSS_127_START} s * (VSV-VLV)"
    assert table["speed_tol_kmh"] == requirements.FMVSS_127_SPEED_TOLERANCE
    assert table["lead_decel_reached_s"] == requirements.FMVSS_127_LEAD_RAMP
    assert table["pass"] == "no contact"
    false = printed["FMVSS_127_false_activation"]
    assert false["limit_g"] == requirements.FMVSS_127_FALSE_ACTIVATION
    assert (
        false["pass_through"]["speed_kmh"]
        == false["steel_trench_plate"]["speed_kmh"]
        == requirements.FMVSS_127_PASS_SPEED
    )
    assert false["pass_through"]["gap_between_front_wheels_m"] == requirements.FMVSS_127_PASS_GAP


def test_fmvss_127_pedestrians(printed):
    table = printed["FMVSS_127_ped"]
    assert table["columns"] == ["case", "overlap_pct", "obstructed", "VSV_kmh", "VP_kmh"]
    rows = [
        [f"{walk.kind} {walk.side}", walk.overlap, walk.obstructed, list(walk.subject), walk.speed]
        for walk in requirements.FMVSS_127_WALKS
    ]
    assert rows == table["rows"]
    assert table["L0"] == f"{requirements.FMVSS_127_WALK_START} s * (VSV-VPy)"


def _range(value: Any) -> list[float]:
    return value if isinstance(value, list) else [value, value]


def _maybe(value: Any) -> tuple[float, ...] | None:
    return None if value is None else tuple(value)


def test_euro_ncap(printed):
    table = printed["EuroNCAP_2023_AEB_C2C"]
    overlaps = list(requirements.EURO_NCAP_OVERLAPS)
    for kind, speeds in {
        "CCRs_AEB": requirements.EURO_NCAP_CCRS,
        "CCRs_FCW": requirements.EURO_NCAP_CCRS_FCW,
        "CCRm": requirements.EURO_NCAP_CCRM,
    }.items():
        assert (list(speeds), overlaps) == (table[kind]["v_kmh"], table[kind]["overlap_pct"])
    assert table["CCRm"]["target_kmh"] == requirements.EURO_NCAP_CCRM_TARGET
    braking = table["CCRb"]
    assert braking["v_kmh"] == braking["target_kmh"] == requirements.EURO_NCAP_CCRB
    assert braking["headway_m"] == list(requirements.EURO_NCAP_CCRB_HEADWAY)
    assert braking["decel_mps2"] == list(requirements.EURO_NCAP_CCRB_DECELERATION)
    assert braking["target_final_kmh"] == requirements.EURO_NCAP_CCRB_END
    assert table["w_GVT_m"] == requirements.EURO_NCAP_TARGET_WIDTH


@pytest.mark.parametrize("overlap", requirements.EURO_NCAP_OVERLAPS)
def test_an_overlap_is_what_the_target_covers_of_the_car(overlap):
    """At 50 % the target's edge is on the middle line; on whichever side, it covers so much of the car's width."""
    width, target = 1.852, requirements.EURO_NCAP_TARGET_WIDTH
    offset = lateral_offset(overlap, width)
    covered = min(width / 2, offset + target / 2) - max(-width / 2, offset - target / 2)
    # The target is narrower than the car: at 100 % it is what is covered.
    assert covered == pytest.approx(target if overlap == 100.0 else width * abs(overlap) / 100.0)
    assert offset == 0.0 if overlap == 100.0 else offset * overlap > 0.0


def test_r157_cut_in(printed):
    table = printed["UN_R157_cut_in"]
    assert {f"{speed:g}" for speed in requirements.R157_CUT_IN_SPEEDS} == set(table["examples_s"])
    for speed, time in table["examples_s"].items():
        assert requirements.cut_in_time(float(speed) / 3.6) == pytest.approx(time, abs=5e-4)
    kba = printed["EU_2022_1426_cut_in_KBA_table"]["seated_TTC_s"]
    assert all(requirements.cut_in_time(float(speed) / 3.6) > time for speed, time in kba.items()), (
        "another regulation's"
    )


def test_following(printed):
    assert [list(row) for row in requirements.R157_FOLLOWING] == printed["UN_R157_min_following"]["rows_kmh_s_m"]
    for row in requirements.R157_FOLLOWING:
        assert row.distance == pytest.approx(row.headway * row.speed / 3.6, abs=0.06)
