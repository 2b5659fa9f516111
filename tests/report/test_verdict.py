"""The top line of a report: every outcome, every judgement, and what the record does not know."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, write
from tests.isolated import REPOSITORY
from tests.sweep.test_dataset import PLAN
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.run import Run
from vve_sumo.drive.termination import Outcome
from vve_sumo.plotting import drive_overview
from vve_sumo.report import drive, pictures, runs, search_results, settings, stops, sweep
from vve_sumo.report.sources import open_street_map
from vve_sumo.report.tables import Cell
from vve_sumo.report.verdict import ReportVerdict, figures_of, of_drive
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec

TICKS = 50
MEASURED: dict[str, Any] = {
    "outcome": "stopped",
    "passed": True,
    "collision": False,
    "max_speed_mps": 5.0,
    "stop_gap_m": 4.0,
    "min_gap_m": 3.0,
    "min_ttc_s": 2.0,
    "impact_speed_mps": 0.0,
    "duration_s": 0.98,
}


def record(folder: Path, summary: dict[str, Any] | None, contact: bool = False) -> Run:
    """A record of a standing car, 4 m from a parked one; at a contact its boxes touch at the end."""
    ticks = [{"contacts": "parked" if contact and tick > 40 else ""} for tick in range(TICKS)]
    write(folder, ticks, summary)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + 6.0}
    put(folder, "actors", [box | {"tick": tick} for tick in range(TICKS)])
    return Run(folder)


def verdict(run: Run) -> ReportVerdict:
    return of_drive(run, figures_of(run))


SAYS = {
    "stopped": "The car came to rest 4.00 m before parked.",
    "arrived": "The car drove to the end of its path and stands 4.00 m before parked.",
    "contact": "The car hit something at 0.00 m/s and then stopped.",
    "driver_has_control": "The driver took over.",
    "fault": "The gateway stopped the car: for no stated reason.",
    "timeout": "The scenario's time ran out after 0.98 s.",
    "completed": "The scenario ended the drive after 0.98 s: for no stated reason.",
    "played": "A recorded drive of 0.98 s was sent through the pipeline;",
    "interrupted": "The drive was ended from the keyboard after 0.98 s.",
    "broken": "The simulation broke after 0.98 s: it fell over ../there.",
}


@pytest.mark.thorough(witnesses=11)
@pytest.mark.parametrize("outcome", list(Outcome))
@pytest.mark.parametrize("passed", [True, False, None])
def test_the_word_is_the_summarys_and_the_sentence_that_of_the_outcome(
    tmp_path: Path, outcome: Outcome, passed: bool | None
) -> None:
    reported = verdict(
        record(
            tmp_path / "r", MEASURED | {"outcome": outcome.value, "passed": passed, "text": "it fell over ../there."}
        )
    )
    judged = {True: "passed", False: "FAILED", None: "not judged"}[passed]
    assert reported.word == ("broken off" if outcome in (Outcome.BROKEN, Outcome.INTERRUPTED) else judged)
    assert reported.line.startswith(f"{reported.word}: {SAYS[outcome.value]}")
    assert reported.line.endswith(
        "The smallest gap to an object in the car's path was 3.00 m; the minimum time to collision was 2.00 s."
    )


@pytest.mark.parametrize("outcome", ["contact", "completed", "broken", None])
@pytest.mark.parametrize("speed", [3.0, None])
def test_a_contact_is_said_however_the_drive_ended(tmp_path: Path, outcome: str | None, speed: float | None) -> None:
    reported = {"outcome": outcome, "passed": False, "collision": True, "impact_speed_mps": speed}
    line = verdict(record(tmp_path / "r", MEASURED | reported if outcome else None, contact=True)).line
    # A killed drive's impact is measured from its record: both stood.
    fast = " at 0.00 m/s" if outcome is None else (" at 3.00 m/s" if speed else "")
    assert f"hit parked{fast}{' and then stopped.' if outcome == 'contact' else '.'}" in line
    assert "none" not in line.partition("smallest gap")[0].replace("no stated reason", "")


def test_what_was_not_measured_is_not_said(tmp_path: Path) -> None:
    none = {name: None for name, value in MEASURED.items() if isinstance(value, float)}
    line = verdict(record(tmp_path / "r", MEASURED | none)).line
    assert line == "passed: The car came to rest with no object ahead. No object was ever in the car's way."


def test_an_actor_that_never_was_in_the_path_but_was_braked_for_does_not_make_the_page_contradict_itself(
    tmp_path: Path,
) -> None:
    none = {name: None for name, value in MEASURED.items() if isinstance(value, float)}
    crossed = {"outcome": "completed", "hardest_braking_for": "crosser", "max_deceleration_mps2": 3.0}
    line = verdict(record(tmp_path / "r", MEASURED | none | crossed)).line
    assert "It braked hardest, with 3.00 m/s², for crosser." in line
    assert line.endswith("The car was on a collision course with crosser, which never was in its path.")


def test_a_live_drive_whose_program_was_killed_is_told_from_its_recorders_summary(tmp_path: Path) -> None:
    """The recorder says how it ended; figures, seed and judgement are not in its summary."""
    run = record(tmp_path / "r", {"outcome": "fault", "reasons": ["pose_stale"], "ticks": TICKS})
    assert verdict(run).line.startswith("not judged: The gateway stopped the car: no trusted fix for too long.")
    assert drive_overview(run).texts[1].get_text() == "stopped by the gateway: no trusted fix for too long · not judged"


@pytest.mark.parametrize(
    ("contact", "ahead", "window"),
    [
        (True, 6.0, "beneath it the first contact, with"),
        (False, 6.0, "beneath it the moment of the least gap, with"),
        (False, 50.0, "beneath it the moment at which another actor was nearest, with"),
        (False, 90.0, "beneath it the place where the drive ended, with"),
    ],
)
def test_the_caption_says_what_the_picture_shows(tmp_path: Path, contact: bool, ahead: float, window: str) -> None:
    run = record(tmp_path / "r", MEASURED, contact)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + ahead}
    put(run.folder, "actors", [box | {"tick": tick} for tick in range(TICKS)])
    assert window in pictures.caption_of(Run(run.folder))


@pytest.mark.thorough
def test_the_page_calls_metrics_by_their_labels_and_tells_the_jerk_of_the_stop_from_that_of_the_drive(
    tmp_path: Path,
) -> None:
    time = np.arange(0.0, 6.0, PERIOD)
    braked = np.clip(time - 1.0, 0.0, 2.0)
    rows = moving(time, 5.0 * np.minimum(time, 1.0) + 5.0 * braked - 1.25 * braked**2, 5.0 - 2.5 * braked)
    for row, at in zip(rows, time.tolist(), strict=True):
        row |= {"granted_acceleration_mps2": -2.5 if at >= 1.0 else 0.0, "state": "engaged"}
        row |= {"true_acceleration_mps2": -2.5 if 1.0 <= at < 3.0 else 0.0}
    write(tmp_path / "r", rows, MEASURED)
    page = drive.report(Run(tmp_path / "r")).page()
    assert "RMS jerk of the stop" in page
    assert "of the whole drive" in page
    assert "on the car was at rest, which is slower than 0.05" in page
    meanings = re.findall(r'<div class="about">(.*?)</div>|<dd>(.*?)</dd>', page)
    assert len(meanings) > 20
    assert not [text for pair in meanings for text in pair if re.search(r"\b(ttc_s|min_ttc_s|jerk_mps3|gap_m)\b", text)]


def test_the_car_rests_before_what_its_gap_is_to(tmp_path: Path) -> None:
    """What it followed has gone; one who crosses, whom it would not have met, is nearest when it stands."""
    run = record(tmp_path / "r", MEASURED)
    walker = BOX | {"actor": "walker", "x_m": CAR.rear_axle_to_bumper + 6.0, "heading_rad": 0.5 * math.pi}
    boxes = [BOX | {"actor": "gone", "x_m": CAR.rear_axle_to_bumper + 6.0, "tick": tick} for tick in range(TICKS - 1)]
    put(run.folder, "actors", [*boxes, walker | {"speed_mps": 1.5, "tick": TICKS - 1}])
    found = Run(run.folder)
    assert (found.lead.actor[-1], found.data.strip_lead.actor[-1]) == ("", "walker")
    assert verdict(found).sentences[0].endswith("before walker.")


def swept(folder: Path, *results: RunResult, cells: int | None = None) -> Sweep:
    plan = replace(PLAN, cells=cells or len(results), parameters={"speed": "float"})
    dataset = Dataset(folder, plan, resume=True)
    for number, result in enumerate(results):
        dataset.add(RunSpec(number, f"{number:016x}", {"speed": float(number)}, 1), result)
    dataset.close()
    return Sweep(folder)


def ran(passed: bool, **figures: Any) -> RunResult:
    reported = {"outcome": "stopped", "passed": passed, "collision": False, "failed": "", "stop_gap_m": 2.0}
    return RunResult("", reported | figures, "")


FAULT = RunResult("", {}, "timed_out")


@pytest.mark.parametrize(
    ("results", "cells", "line"),
    [
        ([ran(True)], None, "passed: The one judged run passed. Over all runs: smallest gap at rest 2.00 m, no coll"),
        ([ran(True), ran(False)], None, "explored: 1 of 2 judged runs met the criteria (50 %), 1 did not. Over all"),
        ([ran(True), FAULT], None, "not judged: The one judged run passed; 1 more ended with an error. Over all runs:"),
        ([ran(False), FAULT], None, "explored: 0 of 1 judged runs met the criteria (0 %), 1 did not; 1 more ended"),
        ([ran(True)], 3, "broken off: 1 of 3 runs are finished: the sweep was stopped or still runs. The one"),
        # It drove through what it hit, and has a gap to what stood behind.
        ([ran(False, collision=True, stop_gap_m=0.5), ran(True)], None,
         "explored: 1 of 2 judged runs met the criteria (50 %), 1 did not. Over all runs: 1 run with a collision."),
        ([ran(False, collision=True, stop_gap_m=-0.1)], None,
         "explored: 0 of 1 judged runs met the criteria (0 %), 1 did not. Over all runs: 1 run with a collision."),
    ],
)  # fmt: skip
def test_the_word_of_a_sweep_is_that_of_its_runs(
    tmp_path: Path, results: list[RunResult], cells: int | None, line: str
) -> None:
    of = swept(tmp_path / "s", *results, cells=cells)
    rows = runs.read(of)
    assert sweep.verdict(of, rows, runs.counts(of, rows), None).line.startswith(line)


@pytest.mark.parametrize(("results", "word"), [([ran(True), ran(False)], "FAILED"), ([ran(True)] * 2, "passed")])
def test_a_sweep_that_varies_nothing_but_the_seed_is_judged(
    tmp_path: Path, results: list[RunResult], word: str
) -> None:
    dataset = Dataset(tmp_path / "s", replace(PLAN, cells=2, parameters={}), resume=True)
    for number, result in enumerate(results):
        dataset.add(RunSpec(number, f"{number:016x}", {}, number), result)
    dataset.close()
    of = Sweep(tmp_path / "s")
    rows = runs.read(of)
    assert sweep.verdict(of, rows, runs.counts(of, rows), None).word == word


def test_of_runs_that_all_came_to_a_fault_nothing_is_known(tmp_path: Path) -> None:
    of = swept(tmp_path / "s", FAULT, FAULT)
    rows = runs.read(of)
    reported = sweep.verdict(of, rows, runs.counts(of, rows), None)
    assert reported.line == "not judged: Of 2 runs none was judged; 2 ended with an error."


def test_what_a_search_drove_is_counted_and_not_shared_out(tmp_path: Path) -> None:
    spec = PLAN.spec | {"search": {"highest": "impact_speed_mps", "points": 9}}
    dataset = Dataset(tmp_path / "s", replace(PLAN, spec=spec, cells=9, parameters={"speed": "float"}), resume=True)
    for number, result in enumerate((ran(True), ran(False), FAULT)):
        dataset.add(RunSpec(number, f"{number:016x}", {"speed": float(number)}, 1), result)
    dataset.close()
    reported = sweep.report(Sweep(tmp_path / "s"))
    said = "The search was stopped or still runs. 3 runs were driven, 1 of them ended with an error. Over all runs:"
    assert reported.verdict.line.startswith(f"broken off: {said}")
    assert [picture.name for picture in reported.pictures if "distribution" in picture.name] == []


def test_a_criterion_that_a_parameter_sets_is_not_said_to_be_the_files(tmp_path: Path) -> None:
    """Nor is its band drawn: it is another one of every run."""
    table = {
        "title": "t",
        "criteria": {"stop_gap_m": {"min": 1.25}},
        "parameters": {"least": {"sets": ["criteria.stop_gap_m.min"]}},
    }
    dataset = Dataset(tmp_path / "s", replace(PLAN, table=table, cells=2, parameters={"least": "float"}), resume=True)
    for number in range(2):
        figures = ran(True).figures | {"meets_stop_gap_m": True}
        dataset.add(RunSpec(number, f"{number:016x}", {"least": float(number)}, 1), RunResult("", figures, ""))
    dataset.close()
    page = sweep.report(Sweep(tmp_path / "s")).page()
    assert "set by a parameter" in page
    assert "at least 1.25" not in page
    assert "shaded part does not pass" not in page


@pytest.mark.thorough
def test_a_playback_is_not_said_to_be_driven_or_replayed_again(tmp_path: Path) -> None:
    """Replay takes none, for the recording is not a part of the record."""
    write(tmp_path / "r", [{}] * 3, MEASURED | {"outcome": "played", "passed": None}, files_sha256={"pose": "0"})
    page = drive.report(Run(tmp_path / "r")).page()
    assert "vve-sumo report r<" in page
    assert "vve-sumo replay" not in page
    assert "vve-sumo drive" not in page


def criteria(judged: bool) -> list[list[str]]:
    """The texts of the table of criteria, row by row."""
    wanted = {
        "outcome": "stopped",
        "collision": False,
        "stop_gap_m": {"min": 4.5, "max": 5.5},
        "min_gap_m": {"min": 1.0, "max": None},
        "duration_s": {"max": 60.0},
        "min_ttc_s": None,
    }
    failed = ["stop_gap_m is 4.499, expected 4.5 to 5.5", "collision is True, expected False"]
    figures = {"outcome": "stopped", "collision": True, "stop_gap_m": 4.4994, "min_gap_m": None, "duration_s": 59.0}
    rows = settings.criteria(wanted, figures | {"failed": failed}, judged).rows
    return [[text_of(cell).replace("\u00a0", " ") for cell in row] for row in rows]


def text_of(cell: Cell | str) -> str:
    return cell if isinstance(cell, str) else cell.text


def test_each_criterion_says_what_was_found_what_it_asks_and_whether_that_was_met() -> None:
    assert criteria(True) == [
        ["outcome", "stopped", "stopped", "✓ met"],
        ["collision", "yes", "no", "✗ not met"],
        ["gap at rest", "4.499 m", "4.5 to 5.5 m", "✗ not met"],
        ["minimum gap", "none", "at least 1 m", "✓ met"],
        ["drive time", "59.000 s", "at most 60 s", "✓ met"],
    ]
    assert {row[-1] for row in criteria(False)} == {"not judged"}


@pytest.mark.parametrize(("network", "driven", "named"), [
    ("test_track", "test_track", False),
    ("test_track", "linden", True),  # another one of that name may have been driven on
    ("linden", "linden", True),
    ("nowhere", "linden", True),
])  # fmt: skip
def test_whose_map_it_is_is_said_unless_it_is_known_to_be_ours(network: str, driven: str, named: bool) -> None:
    digest = hashlib.sha256((REPOSITORY / f"networks/{driven}.net.xml").read_bytes()).hexdigest()
    assert bool(open_street_map({"road": {"network": network}}, [digest])) == named


def test_a_flip_is_told_the_right_way_round() -> None:
    flip = {"meets": 13.1, "fails": 13.2, "key_fails": "0"}
    line = {"values": {}, "meets_first": True, "flips": [flip], "seeds": [{"flips": [flip]}]}
    result = {"search": "boundary", "along": "speed", "criterion": "collision", "boundaries": [line]}
    reported = search_results.sentence(result, {})
    assert reported.startswith("“no collision” is met at speed = 13.1 and no longer at 13.2")


def test_the_runs_that_broke_their_bound_are_listed_and_no_others() -> None:
    rows = pd.DataFrame(
        {
            "key": ["kept", "broke", "tolerated", "hunted"],
            "stop_distance_m": [10.0, 10.5, 10.5, 60.0],
            "stop_bound_m": [10.0, 10.0, 10.0, 70.0],
            "stop_tolerance_m": [0.1, 0.1, 0.6, math.nan],
            "hunting": [False, False, False, True],
        }
    )
    checks = stops.bound_checks(rows)
    assert [text_of(row[0]) for row in checks["broken_bounds"].rows] == ["broke"]
    assert checks["bound_checks"].kind == "no"
    assert checks["bound_checks"].text.startswith("3 runs braked to rest at once; 1 took longer")
    assert "1 run hunted on the approach, and is not judged." in checks["bound_checks"].text
    assert stops.bound_checks(rows.iloc[[0, 2]])["bound_checks"].kind == ""
    assert stops.bound_checks(rows.iloc[[3]])["bound_checks"].kind == "no"
