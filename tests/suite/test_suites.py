"""Some rows of every suite are driven; and what fails, says why."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pytest

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from vve_sumo import laws
from vve_sumo.analysis import load
from vve_sumo.cli import main
from vve_sumo.cli.suite import drive
from vve_sumo.errors import ConfigError
from vve_sumo.record.reader import read_table
from vve_sumo.suite import catalogue, euroncap, requirements, table
from vve_sumo.suite.design import design_of
from vve_sumo.suite.judge import invalidity, judge
from vve_sumo.suite.physics import DETECTION, Need
from vve_sumo.suite.query import SuiteQuery, car_of, rows_of
from vve_sumo.suite.row import CutIn, JudgedRow, RequiredApproach, RowOutcome, RowVerdict, SuiteRow
from vve_sumo.suite.track import AEB, scenario, target
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.fill import drive_into
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.rerun import rerun
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.spec import Keep
from vve_sumo.timing import PERIOD

KMH = 1.0 / 3.6
CAR = vehicles.FUSION.vehicle


def suite_rows(name: str) -> list[SuiteRow]:
    return catalogue.rows(name, vehicles.FUSION)


def driven(
    name: str, rows: list[SuiteRow], out: Path, *, seeds: int = 1, workers: int = 2, keep: bool = False
) -> list[JudgedRow]:
    """Drive rows into a new folder."""
    design = design_of(name, "", rows, seeds, REPOSITORY)
    kept: Keep = "all" if keep else "none"
    drive_into(out, design, Local(workers), kept, resume=False, resume_command="", progress=lambda tally: None)
    judged = design.outcomes(out)
    assert [each.row for each in judged] == rows
    return judged


def driven_once(name: str, rows: list[SuiteRow], out: Path, **options: Any) -> dict[str, RowOutcome]:
    return {drive.row.id: drive for each in driven(name, rows, out, **options) for drive in each.drives}


SAMPLE = {
    "euroncap": ("CCRs_50", "CCRm_40", "CCRb_12m_6"),
    "following": ("following_7.2", "following_40"),
    "fmvss127": ("stopped_10", "stopped_80", "slower_60", "decelerating_80_12m_0.5g"),
    "fmvss127_pedestrian": (
        "crossing_right_25_20",
        "crossing_left_50_30",
        "stationary_right_25_55",
        "along_path_right_25_65",
    ),
    "pass_through": ("between_two_cars_aeb", "between_two_cars_whole"),
    "r152": (
        "stationary_10_laden",
        "stationary_42_unladen",
        "moving_30_laden",
        "child_60_laden",
        "between_two_cars_60",
    ),
    "r152_01": ("child_40_unladen",),
    "r152_02": ("bicycle_20_unladen",),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", with_slow(sorted(SAMPLE), lambda name: name == "r152_02"))
def test_the_shipped_controller_passes_some_rows_of_every_suite(name, tmp_path):
    rows = [row for row in suite_rows(name) if row.id in SAMPLE[name]]
    assert len(rows) == len(SAMPLE[name])
    outcomes = driven_once(name, rows, tmp_path)
    assert {key: outcome.verdict for key, outcome in outcomes.items()} == dict.fromkeys(SAMPLE[name], RowVerdict.PASSED)
    for outcome in outcomes.values():
        if outcome.row.required.startswith("no contact"):
            assert outcome.min_gap_m > 0.0
            assert outcome.impact_speed_mps == 0.0
        if outcome.row.demand:
            # What is asked for is what the declared brakes give at most, whatever the load makes of it.
            assert outcome.demand_mps2 == pytest.approx(CAR.deceleration_limit, rel=0.03)


@pytest.mark.slow
def test_one_overlap_stands_for_all_since_the_radar_tells_none_from_another(tmp_path):
    rows = [
        replace(euroncap.closing(vehicles.FUSION, "CCRs", 30.0, 0.0, overlap), id=f"{overlap:g}")
        for overlap in requirements.EURO_NCAP_OVERLAPS
    ]
    outcomes = driven_once("overlaps", rows, tmp_path).values()
    first = next(iter(outcomes))
    for outcome in outcomes:
        assert outcome.min_gap_m == pytest.approx(first.min_gap_m, abs=1e-4)
        assert outcome.max_deceleration_mps2 == pytest.approx(first.max_deceleration_mps2, abs=1e-4)


@pytest.mark.thorough
def test_a_hidden_child_is_seen_where_the_closed_form_says(tmp_path):
    """First echo of the child in the record, against the geometry of the row; a scan comes every 50 ms."""
    row = next(row for row in suite_rows("fmvss127_pedestrian") if row.id == "obstructed_crossing_right_50_30")
    outcome = driven_once("hidden", [row], tmp_path, workers=1, keep=True)[row.id]
    assert outcome.verdict is RowVerdict.PASSED
    seen_at = read_table(outcome.record, "sensor_radar").filter(pc.field("actor") == "target")["tick"][0].as_py()
    ticks = read_table(outcome.record, "ticks")
    scan = read_table(outcome.record, "readings").filter(pc.field("tick") == seen_at)
    seen = round(scan["measured_s"][0].as_py() / PERIOD)
    (ego,) = ticks.filter(pc.field("tick") == seen).to_pylist()
    here = (pc.field("tick") == seen) & (pc.field("actor") == "target")
    (child,) = read_table(outcome.record, "actors").filter(here).to_pylist()
    along = (child["x_m"] - ego["true_x_m"]) * math.cos(ego["true_heading_rad"])
    along += (child["y_m"] - ego["true_y_m"]) * math.sin(ego["true_heading_rad"])
    speed = row.scenario.ego.speed_mps
    assert along - CAR.rear_axle_to_bumper == pytest.approx(row.need.available, abs=0.05 * speed + 0.1)


@pytest.mark.slow
def test_seeds_are_drives_of_their_own_and_the_same_each_time(tmp_path):
    row = next(row for row in suite_rows("fmvss127") if row.id == "stopped_20")
    (first,), (again,) = (driven("seeds", [row], tmp_path / name, seeds=2) for name in ("first", "again"))
    assert [drive.seed for drive in first.drives] == [1, 2]
    assert first.drives[0].min_gap_m != first.drives[1].min_gap_m
    assert first.drives == again.drives
    (one,) = driven("seeds", [row], tmp_path / "one", workers=1)
    assert one.drives[0].min_gap_m == first.drives[0].min_gap_m


@pytest.mark.thorough
def test_braking_that_is_too_gentle_is_a_failure_without_a_contact(tmp_path):
    """The comfort layer alone stops for a car ahead well before it, and never asks for 5 m/s2."""
    row = next(row for row in suite_rows("r152") if row.id == "stationary_20_unladen")
    gentle = row.scenario.controller.model_copy(update={"tuning": {"emergency": False}})
    scenario = row.scenario.model_copy(update={"controller": gentle})
    # It slows down so gently that this counts as approach, long before it brakes.
    rows = [replace(row, id="gentle", scenario=scenario, approach=row.approach._replace(below=row.approach.speed))]
    outcome = driven_once("spoilt", rows, tmp_path, workers=1)["gentle"]
    assert (outcome.verdict, outcome.impact_speed_mps) == (RowVerdict.FAILED, 0.0)
    assert 1.0 < outcome.demand_mps2 < 5.0
    assert outcome.why == f"braking demand {outcome.demand_mps2:.2f} m/s2, expected 5 or more"


@pytest.mark.thorough
def test_what_goes_wrong_is_told_apart(tmp_path):
    """One stationary car at 40 km/h: nobody brakes; it appears too late; the speed is not the one wanted."""
    good = next(row for row in suite_rows("r152") if row.id == "stationary_40_unladen")
    nothing = good.scenario.controller.model_copy(update={"tuning": {"comfort": False, "emergency": False}})
    speed, ahead = good.scenario.ego.speed_mps, 5.0
    late = scenario(
        "late",
        speed,
        lasts=10.0,
        controller={"tuning": AEB},
        actors=[target(speed, ahead)],
        end_trigger={"contact": True},
    )
    rows = [
        replace(good, id="blind", scenario=good.scenario.model_copy(update={"controller": nothing})),
        replace(good, id="late", scenario=late, need=Need(good.need.needed, ahead)),
        replace(good, id="fast", approach=good.approach._replace(speed=good.approach.speed + 3.0 * KMH)),
    ]
    outcomes = driven_once("spoilt", rows, tmp_path, workers=1, keep=True)

    blind = outcomes["blind"]
    assert blind.verdict is RowVerdict.FAILED
    assert blind.impact_speed_mps == pytest.approx(blind.approach_greatest_mps, abs=0.05)
    assert "collision is True" in blind.why
    assert (blind.record / "summary.json").is_file()

    late = outcomes["late"]
    assert late.verdict is RowVerdict.UNAVOIDABLE
    # No car comes to less than with its brakes on from the first moment.
    least = laws.impact_speed(late.approach_least_mps, ahead, 1.05 * CAR.deceleration_limit, PERIOD + CAR.brake_delay)
    latest = laws.impact_speed(late.approach_greatest_mps, ahead, CAR.deceleration_limit, DETECTION + 0.25)
    assert least < late.impact_speed_mps < latest

    assert outcomes["fast"].verdict is RowVerdict.INVALID
    assert outcomes["fast"].why.startswith("approached at 39.")


@pytest.mark.parametrize(
    ("figures", "avoidable", "verdict"),
    [
        ({"outcome": "stopped", "passed": True}, True, RowVerdict.PASSED),
        ({"outcome": "stopped", "passed": False}, True, RowVerdict.FAILED),
        ({"outcome": "contact", "passed": False}, False, RowVerdict.UNAVOIDABLE),
        ({"outcome": "stopped", "passed": None}, True, RowVerdict.FAILED),
        ({"outcome": "fault", "passed": True}, True, RowVerdict.FAILED),
        ({}, True, RowVerdict.FAILED),
    ],
)
def test_verdicts(figures, avoidable, verdict, tmp_path):
    row = SuiteRow("row", "a row", "no contact", None, need=Need(10.0, 11.0 if avoidable else 9.0))
    assert judge(row, 1, RunResult("row", figures), tmp_path).verdict is verdict
    assert judge(row, 1, RunResult("row", figures, error="crashed: SIGSEGV"), tmp_path).verdict is RowVerdict.FAILED
    # Nothing was asked of the brakes: no lack of way excuses that.
    demanding = judge(replace(row, demand=5.0), 1, RunResult("row", figures), tmp_path)
    assert demanding.verdict is RowVerdict.FAILED


@pytest.mark.parametrize(
    ("came", "verdict", "why"),
    [
        ([RowVerdict.PASSED] * 3, RowVerdict.PASSED, ""),
        (
            [RowVerdict.PASSED, RowVerdict.FAILED, RowVerdict.PASSED],
            RowVerdict.FAILED,
            "seed 2; 2 of 3 drives passed (95 %: 0.21 to ",
        ),
        ([RowVerdict.UNAVOIDABLE, RowVerdict.FAILED], RowVerdict.FAILED, "seed 2; 0 of 2 drives passed"),
        ([RowVerdict.UNAVOIDABLE, RowVerdict.PASSED], RowVerdict.UNAVOIDABLE, "seed 1; 1 of 2 drives passed"),
        ([RowVerdict.FAILED, RowVerdict.INVALID], RowVerdict.INVALID, "seed 2; 0 of 2 drives passed"),
        ([RowVerdict.FAILED], RowVerdict.FAILED, "seed 1"),
        ([], RowVerdict.NOT_APPLICABLE, "the reason"),
    ],
)
def test_a_row_is_passed_where_all_of_its_drives_are(came, verdict, why):
    row = SuiteRow("row", "a row", "no contact", None, not_applicable="the reason")
    drives = tuple(
        RowOutcome(row, seed, each, why="" if each is RowVerdict.PASSED else f"seed {seed}")
        for seed, each in enumerate(came, 1)
    )
    judged = JudgedRow(row, drives)
    assert judged.verdict is verdict
    assert judged.why.startswith(why)
    assert bool(judged.why) is bool(why)


@pytest.mark.parametrize(
    ("approach", "ttc", "good"),
    [
        ((9.8, 10.0), 1.0, True),
        ((9.4, 10.0), 1.0, False),
        ((9.8, 10.01), 1.0, False),
        ((float("nan"), 10.0), 1.0, False),
        (None, 1.0, False),
        ((9.8, 10.0), 1.2, False),
        ((9.8, 10.0), float("nan"), False),
        ((9.8, 10.0), None, False),
    ],
)
def test_a_test_that_was_not_driven_as_it_must_be_is_invalid(approach, ttc, good):
    row = SuiteRow(
        "row", "", "", None, approach=RequiredApproach("a", 10.0, 0.5, 0.0), cut_in=CutIn("a", 2.0, 1.0, 0.1)
    )
    assert (invalidity(row, approach, ttc) == "") is good


def test_the_tables_hold_every_row_and_the_worst_of_its_drives(tmp_path):
    row = SuiteRow("one", "a row", "no contact", None, need=Need(10.0, 11.0))
    none = replace(row, id="none", need=None, not_applicable="why not")
    rows = [
        JudgedRow(
            row,
            (
                RowOutcome(
                    row, 1, RowVerdict.FAILED, None, "collision", 9.0, 10.0, impact_speed_mps=5.0, min_gap_m=0.0
                ),
                RowOutcome(
                    row,
                    2,
                    RowVerdict.PASSED,
                    None,
                    "",
                    8.0,
                    9.5,
                    impact_speed_mps=0.0,
                    min_gap_m=-0.02,
                    demand_mps2=5.5,
                ),
                RowOutcome(row, 3, RowVerdict.PASSED, None, "", 9.0, 9.5, max_deceleration_mps2=6.0, demand_mps2=5.4),
            ),
        ),
        *(
            JudgedRow(replace(row, id=id), (RowOutcome(replace(row, id=id), 1, verdict, why="collision"),))
            for id, verdict in (("two", RowVerdict.UNAVOIDABLE), ("three", RowVerdict.UNAVOIDABLE))
        ),
        JudgedRow(none),
    ]
    files = table.write("spoilt", rows, tmp_path / "out")
    with files[0].open(encoding="utf-8", newline="") as file:
        written = list(csv.DictReader(file))
    read = json.loads(files[1].read_text(encoding="utf-8"))
    assert [row["verdict"] for row in written] == [row["verdict"] for row in read]
    assert [row["impact_kmh"] for row in read] == [18.0, None, None, None]
    assert [(row["passed"], row["driven"]) for row in read] == [(2, 3), (0, 1), (0, 1), (0, 0)]
    assert (read[0]["max_deceleration_mps2"], read[0]["least_demand_mps2"]) == (6.0, 5.4)
    assert (read[0]["approach_least_kmh"], read[0]["approach_greatest_kmh"]) == (28.8, 36.0)
    assert (written[0]["there_m"], written[0]["avoidable"]) == ("11.0", "True")
    lines = files[2].read_text(encoding="utf-8").splitlines()
    assert {line.count("|") for line in lines[: 2 + len(rows)]} == {len(table.HEADINGS) + 1}
    assert "| 2/3 | 18.00 | -0.02 | 6.00 | 5.40 |" in lines[2]
    assert "4 rows: 1 failed, 2 failed, not avoidable by closed form, 1 not applicable; 2 of 5 drives passed." in lines
    assert lines[-3:] == [
        "* one: failed: collision; 2 of 3 drives passed (95 %: 0.21 to 0.94)",
        "* two, three: failed, not avoidable by closed form: collision",
        "* none: not applicable: why not",
    ]


@pytest.mark.thorough
def test_the_command_lists_the_suites_and_refuses_in_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["suite"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(catalogue.names())
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine").touch()
    for name, asked, said in [
        ("r153", SuiteQuery(), "no suite named 'r153'"),
        ("r152", SuiteQuery(keep=True), "--keep-records: expected --out"),
        ("r152", SuiteQuery(resume=True), "--resume: expected --out"),
        ("r152", SuiteQuery(out=full), "holds something else"),
        ("r152", SuiteQuery(out=full, resume=True), "has no sweep.json"),
        ("r152", SuiteQuery(workers=0), "workers: expected 1 or more, got 0"),
        ("r152", SuiteQuery(seeds=0), "--seeds: expected 1 or more, got 0"),
        ("r152", SuiteQuery(controller="nobody"), "controller nobody: unknown"),
    ]:
        with pytest.raises(ConfigError, match=said):
            drive(name, asked)


@pytest.mark.thorough
def test_the_command_drives_prints_keeps_and_goes_on(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    few = catalogue.Suite("two rows", lambda car: iter(catalogue.rows("pass_through", car)[1:]))
    monkeypatch.setitem(catalogue.SUITES, "few", few)
    out = tmp_path / "out"
    assert drive("few", SuiteQuery(out=out, workers=1, keep=True)) == 0
    assert "2 rows: 1 passed, 1 not applicable; 1 of 1 drives passed" in capsys.readouterr().out
    record = out / "records" / "between_two_cars_whole_seed_1"
    assert (record / "summary.json").is_file()
    driven_at = record.stat().st_mtime_ns
    torn = record.with_name("between_two_cars_whole_seed_2")
    # Of drives that were killed: one under way, and one between its end and its row.
    for left in (torn.with_name(f"{torn.name}.part"), torn):
        left.mkdir()
        for name in ("scenario.json", "half.parquet"):
            (left / name).write_text("half a", encoding="utf-8")
    assert drive("few", SuiteQuery(out=out, workers=1, keep=True, resume=True, seeds=2)) == 0
    assert "2 rows: 1 passed, 1 not applicable; 2 of 2 drives passed" in capsys.readouterr().out
    assert record.stat().st_mtime_ns == driven_at
    assert (torn / "summary.json").is_file()
    assert not (torn / "half.parquet").exists()
    assert {one.name for one in torn.parent.iterdir()} == {record.name, torn.name}, "nothing else is left"
    assert len(load(out).rows()) == 2
    key = torn.name
    again = rerun(out, key, tmp_path / "again", lambda line: None)
    assert again.same
    assert again.drive().summary["record_sha256"] == load(out / "records" / key).summary["record_sha256"]


@pytest.mark.thorough
def test_a_suite_is_driven_by_a_rigs_car(tmp_path):
    """Its brakes decide what physics allows: those of a brake gain that was measured, not the model's."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    file = tmp_path / "ours.toml"
    file.write_text(text.replace("[limits]\n", "[calibration]\nbrake_gain_kgm = 700.0\n\n[limits]\n"), encoding="utf-8")
    query = SuiteQuery(rig=str(file))
    car, plain = car_of(query, REPOSITORY), car_of(SuiteQuery(), REPOSITORY)
    assert car.model.vehicle.deceleration_limit == pytest.approx(3250.0 / 700.0)
    assert car.note.startswith("this car brakes with 4.64 m/s2 at most, not with the declared 5.9")
    assert (plain.model, plain.note, plain.rig) == (vehicles.FUSION, "", None)
    weaker, usual = ({row.id: row for row in rows_of("r152", SuiteQuery(), one, REPOSITORY)} for one in (car, plain))
    name = "stationary_42_unladen"
    assert weaker[name].need.needed > usual[name].need.needed
    by_rig, by_model = (
        design_of("r152", "", [each[name]], 1, REPOSITORY, one.rig) for each, one in ((weaker, car), (usual, plain))
    )
    job = by_rig.job(RunSpec(0, "key", {"row": name}, 1), None)
    assert job.rig == file
    assert resolve_job(job, InputCache()).model == car.model
    assert by_rig.plan.files_sha256.keys() - by_model.plan.files_sha256.keys() == {"rig"}
    with pytest.raises(ConfigError, match="--vehicle: a rig brings its own vehicle"):
        car_of(SuiteQuery(rig=str(file), vehicle="lincoln_mkz"), REPOSITORY)
