"""From a drive's tables and figures to a judgement."""

from __future__ import annotations

import math
from typing import Any

import pytest

from vve_sumo.drive import summary
from vve_sumo.metrics.per_drive import OF_RIDE
from vve_sumo.scenario.schema import Criteria, CriterionBand
from vve_sumo.sweep.run import verdicts

GOOD = {
    "outcome": "stopped",
    "collision": False,
    "stop_gap_m": 5.1,
    "min_ttc_s": 2.0,
    "max_lateral_deviation_m": 0.1,
    "max_deceleration_mps2": 2.2,
    "duration_s": 60.0,
}


def judged(criteria: Criteria, **changes: Any) -> list[str]:
    return summary.unmet_criteria(criteria, GOOD | changes)


STRICT = Criteria(
    outcome="stopped",
    collision=False,
    stop_gap_m=CriterionBand(min=4.5, max=5.5),
    max_lateral_deviation_m=CriterionBand(max=0.15),
)


def test_a_drive_that_meets_its_criteria_passes() -> None:
    assert judged(STRICT) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outcome": "fault"}, "outcome is fault, expected stopped"),
        ({"collision": True}, "collision is True, expected False"),
        ({"stop_gap_m": 5.6}, "stop_gap_m is 5.600, expected 4.5 to 5.5"),
        ({"stop_gap_m": 4.4}, "stop_gap_m is 4.400"),
        (
            {"stop_gap_m": math.nan},
            "stop_gap_m is none (the car did not end at rest with an object ahead), expected 4.5 to 5.5",
        ),
        (
            {"outcome": "fault", "reasons": ["off_path", "pose_stale"]},
            "outcome is fault (the car is farther off its path than allowed, no trusted fix",
        ),
        ({"stop_gap_m": 5.6, "braked_for": "truck.7"}, "stop_gap_m is 5.600 (braked for truck.7), expected 4.5 to 5.5"),
        ({"max_lateral_deviation_m": 0.16}, "expected at most 0.15"),
        ({"max_lateral_deviation_m": math.nan}, "max_lateral_deviation_m is none (the car's place was never known)"),
    ],
)
def test_each_criterion_fails_by_itself(changes: dict[str, Any], words: str) -> None:
    (line,) = judged(STRICT, **changes)
    assert words in line


def test_nothing_ahead_meets_a_limit_on_the_time_to_collision_only_from_below() -> None:
    """No time to collision at all is as good as an endless one."""
    assert judged(Criteria(min_ttc_s=CriterionBand(min=1.5)), min_ttc_s=math.nan) == []
    assert judged(Criteria(min_ttc_s=CriterionBand(min=1.5)), min_ttc_s=1.2)


@pytest.mark.parametrize(
    ("name", "met", "missed"),
    [
        ("max_drac_mps2", CriterionBand(max=3.0), CriterionBand(min=0.5)),
        ("min_gap_m", CriterionBand(min=1.0), CriterionBand(max=20.0)),
        ("min_ttc_s", CriterionBand(min=1.0), CriterionBand(max=5.0)),
        ("stop_gap_m", None, CriterionBand(min=1.0)),
        ("impact_speed_mps", None, CriterionBand(max=9.0)),
    ],
)
def test_what_nothing_ahead_is_as_good_as(name: str, met: CriterionBand | None, missed: CriterionBand) -> None:
    """No need to brake, an endless gap, an endless time; a figure that is missing for another reason fails."""
    if met is not None:
        assert judged(Criteria(**{name: met}), **{name: math.nan}) == []
    assert judged(Criteria(**{name: missed}), **{name: math.nan})


def test_the_figures_of_conflicts_are_judged() -> None:
    wanted = Criteria(
        outcome="completed",
        collision=True,
        impact_speed_mps=CriterionBand(max=5.0),
        emergency_used=True,
        max_drac_mps2=CriterionBand(max=4),
    )
    good = {"outcome": "completed", "collision": True, "impact_speed_mps": 4.9, "emergency_used": True}
    assert judged(wanted, **good, max_drac_mps2=3.0) == []
    assert judged(wanted, **good | {"impact_speed_mps": 5.1}, max_drac_mps2=3.0) == [
        "impact_speed_mps is 5.100, expected at most 5"
    ]
    assert judged(wanted, **good | {"emergency_used": False}, max_drac_mps2=3.0) == [
        "emergency_used is False, expected True"
    ]
    assert len(judged(wanted, **good, max_drac_mps2=4.1)) == 1


def test_a_broken_drive_never_passes() -> None:
    for outcome in ("broken", "interrupted"):
        assert judged(Criteria(), outcome=outcome)


def test_a_drive_that_a_fault_ended_passes_only_where_that_was_asked_for() -> None:
    assert judged(Criteria(), outcome="fault") == ["a gateway fault ended the drive"]
    assert judged(Criteria(outcome="fault"), outcome="fault") == []


def test_a_band_that_nothing_can_meet_is_refused() -> None:
    with pytest.raises(ValueError, match="least 6"):
        CriterionBand(min=6.0, max=5.0)


@pytest.mark.parametrize("wanted", ["fault", "stopped", None])
@pytest.mark.parametrize("end", [{}, {"outcome": "fault"}, {"reasons": ["driver_on_brake"]}, {"outcome": "broken"}])
def test_each_criterion_of_a_run_is_judged_by_itself(wanted: Any, end: dict[str, Any]) -> None:
    """Whatever ended the drive, a gap within its band meets it; whether the drive counts is a column of its own."""
    drive = GOOD | {"passed": False} | end
    criteria = STRICT.model_copy(update={"outcome": wanted})
    found = verdicts(criteria, drive)
    alone = {name: found.pop(f"meets_{name}") for name in ("collision", "stop_gap_m", "max_lateral_deviation_m")}
    assert set(alone.values()) == {True}
    assert verdicts(criteria, drive | {"collision": True, "stop_gap_m": 4.4}) | {"undisturbed": None} == {
        "undisturbed": None,
        "meets_collision": False,
        "meets_stop_gap_m": False,
        "meets_max_lateral_deviation_m": True,
        **({} if wanted is None else {"meets_outcome": drive["outcome"] == wanted}),
    }
    assert found.pop("meets_outcome", None) == (None if wanted is None else drive["outcome"] == wanted)
    sound = end == {} or (drive["outcome"] == "fault" and wanted == "fault")
    assert found == {"undisturbed": sound}


def test_nothing_of_a_playback_is_judged() -> None:
    found = verdicts(STRICT, GOOD | {"outcome": "played", "passed": None})
    assert set(found.values()) == {None}
    assert "meets_stop_gap_m" in found


def test_a_criterion_on_comfort_judges_and_is_not_written_where_it_is_not_stated() -> None:
    """So that the `scenario.json` of drives without one, and the hash of their record, is what it was."""
    wanted = Criteria(weighted_rms_xy_mps2=CriterionBand(max=0.315))
    assert judged(wanted, weighted_rms_xy_mps2=0.2) == []
    assert judged(wanted, weighted_rms_xy_mps2=0.4) == ["weighted_rms_xy_mps2 is 0.400, expected at most 0.315"]
    (line,) = judged(wanted, weighted_rms_xy_mps2=math.nan)
    assert "the car did not drive for long enough" in line
    assert wanted.model_dump(mode="json")["weighted_rms_xy_mps2"] == {"min": None, "max": 0.315}
    assert not {*OF_RIDE} & {*Criteria().model_dump(mode="json")}
    assert "max_deceleration_mps2" in Criteria().model_dump(mode="json")
