"""The suites are driven: R152, FMVSS 127 and pass-through whole, of the others some rows; and what fails, says why."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo import laws
from vve_sumo.suite import catalogue, sheet
from vve_sumo.suite.command import driven_by, suite
from vve_sumo.suite.physics import DETECTION, TICK, Need
from vve_sumo.suite.row import Approach, CutIn, Outcome, Row, Verdict
from vve_sumo.suite.run import invalidity, judge, run
from vve_sumo.suite.track import AEB, CAR, scenario, target
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.job import Result

KMH = 1.0 / 3.6


def driven(name: str, rows: list[Row], records: Path | None = None, workers: int = 2) -> dict[str, Outcome]:
    outcomes = run(name, rows, Local(workers), REPOSITORY, records)
    assert [outcome.row for outcome in outcomes] == rows
    return {outcome.row.id: outcome for outcome in outcomes}


@pytest.mark.parametrize("name", ["r152", "fmvss127", "pass_through"])
def test_the_shipped_controller_passes(name):
    outcomes = driven(name, catalogue.rows(name))
    assert [f"{outcome.row.id}: {outcome.verdict}" for outcome in outcomes.values() if outcome.why] == [
        f"{row.id}: not applicable" for row in catalogue.rows(name) if row.scenario is None
    ]
    for outcome in outcomes.values():
        if outcome.verdict is Verdict.PASSED and outcome.row.required == "no contact":
            assert outcome.least_gap_m > 0.0
            assert outcome.impact_mps == 0.0


SAMPLE = {
    "euroncap": ("CCRs_50_-50", "CCRm_40_75", "CCRb_12m_6"),
    "following": ("following_7.2", "following_40"),
}


@pytest.mark.parametrize("name", sorted(SAMPLE))
def test_some_rows_of_the_longer_suites(name):
    rows = [row for row in catalogue.rows(name) if row.id in SAMPLE[name]]
    assert len(rows) == len(SAMPLE[name])
    verdicts = {key: outcome.verdict for key, outcome in driven(name, rows, workers=1).items()}
    assert verdicts == dict.fromkeys(SAMPLE[name], Verdict.PASSED)


def test_what_goes_wrong_is_told_apart(tmp_path):
    """One stationary car at 40 km/h: nobody brakes; it appears too late; the speed is not the one wanted; no driver."""
    good = next(row for row in catalogue.rows("r152") if row.id == "stationary_40_unladen")
    nothing = good.scenario.controller.model_copy(update={"tuning": {"comfort": False, "emergency": False}})
    speed, ahead = good.scenario.ego.speed_mps, 5.0
    late = scenario(
        "late",
        speed,
        lasts=10.0,
        controller={"tuning": AEB},
        actors=[target(speed, ahead)],
        abort={"contact": True},
    )
    rows = [
        replace(good, id="blind", scenario=good.scenario.model_copy(update={"controller": nothing})),
        replace(good, id="late", scenario=late, need=Need(good.need.way, ahead)),
        replace(good, id="fast", approach=good.approach._replace(speed=good.approach.speed + 3.0 * KMH)),
        driven_by(replace(good, id="nobody"), "nobody"),
    ]
    outcomes = driven("spoilt", rows, tmp_path / "records", workers=1)

    blind = outcomes["blind"]
    assert blind.verdict is Verdict.FAILED
    assert blind.impact_mps == pytest.approx(blind.approach_mps[1], abs=0.05)
    assert "collision is True" in blind.why
    assert (blind.record / "summary.json").is_file()

    late = outcomes["late"]
    assert late.verdict is Verdict.UNAVOIDABLE
    # No car comes to less than with its brakes on from the first moment.
    least = laws.impact_speed(late.approach_mps[0], ahead, 1.05 * CAR.deceleration_limit, TICK + CAR.brake_delay)
    latest = laws.impact_speed(late.approach_mps[1], ahead, CAR.deceleration_limit, DETECTION + 0.25)
    assert least < late.impact_mps < latest

    assert outcomes["fast"].verdict is Verdict.INVALID
    assert outcomes["fast"].why.startswith("approached at 39.")
    assert outcomes["nobody"].verdict is Verdict.FAILED
    assert "controller nobody: unknown" in outcomes["nobody"].why


@pytest.mark.parametrize(
    ("figures", "avoidable", "verdict"),
    [
        ({"outcome": "stopped", "passed": True}, True, Verdict.PASSED),
        ({"outcome": "stopped", "passed": False}, True, Verdict.FAILED),
        ({"outcome": "contact", "passed": False}, False, Verdict.UNAVOIDABLE),
        ({"outcome": "stopped", "passed": None}, True, Verdict.FAILED),
        ({"outcome": "fault", "passed": True}, True, Verdict.FAILED),
        ({}, True, Verdict.FAILED),
    ],
)
def test_verdicts(figures, avoidable, verdict, tmp_path):
    row = Row("row", "a row", "no contact", None, need=Need(10.0, 11.0 if avoidable else 9.0))
    assert judge(row, Result("row", figures), tmp_path).verdict is verdict
    assert judge(row, Result("row", figures, fault="crashed: SIGSEGV"), tmp_path).verdict is Verdict.FAILED


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
    row = Row("row", "", "", None, approach=Approach("a", 10.0, 0.5, 0.0), cut_in=CutIn("a", 2.0, 1.0, 0.1))
    assert (invalidity(row, approach, ttc) == "") is good


def test_the_tables_hold_every_row(tmp_path):
    row = Row("one", "a row", "no contact", None, need=Need(10.0, 11.0))
    outcomes = [
        Outcome(row, Verdict.FAILED, "collision", (9.0, 10.0), impact_mps=5.0, least_gap_m=-0.02),
        Outcome(replace(row, id="two"), Verdict.UNAVOIDABLE, "collision"),
        Outcome(replace(row, id="three"), Verdict.FAILED, "collision"),
        Outcome(replace(row, id="none", need=None), Verdict.NOT_APPLICABLE, "why not"),
    ]
    files = sheet.write("spoilt", outcomes, tmp_path / "out")
    with files[0].open(encoding="utf-8", newline="") as file:
        written = list(csv.DictReader(file))
    read = json.loads(files[1].read_text(encoding="utf-8"))
    assert [row["verdict"] for row in written] == [row["verdict"] for row in read]
    assert [row["impact_kmh"] for row in read] == [18.0, None, None, None]
    assert (written[0]["approach_least_kmh"], written[0]["there_m"], written[0]["avoidable"]) == (
        "32.4",
        "11.0",
        "True",
    )
    lines = files[2].read_text(encoding="utf-8").splitlines()
    assert {line.count("|") for line in lines[: 2 + len(outcomes)]} == {len(sheet.HEADINGS) + 1}
    assert "| 18.00 | -0.02 |" in lines[2]
    assert "4 rows: 2 failed, 1 failed, not avoidable by closed form, 1 not applicable." in lines
    assert lines[-3:] == [
        "* one, three: failed: collision",
        "* two: failed, not avoidable by closed form: collision",
        "* none: not applicable: why not",
    ]


def test_the_command_lists_the_suites_and_refuses_in_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert suite(None, out=None, workers=None, controller=None, keep=False) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(catalogue.names())
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine").touch()
    asked = {"out": None, "workers": None, "controller": None, "keep": False}
    for name, wish, said in [
        ("r153", {}, "no suite named 'r153'"),
        ("r152", {"keep": True}, "--keep: expected --out"),
        ("r152", {"out": full}, "is not empty"),
        ("r152", {"workers": 0}, "--workers: expected 1 or more, got 0"),
        ("r152", {"controller": "nobody"}, "controller nobody: unknown"),
    ]:
        with pytest.raises(Exception, match=said):
            suite(name, **(asked | wish))


def test_the_command_drives_prints_and_keeps(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    few = catalogue.Suite("two rows", lambda: iter(row for row in catalogue.rows("pass_through")[1:]))
    monkeypatch.setitem(catalogue.SUITES, "few", few)
    assert suite("few", out=tmp_path / "out", workers=1, controller=None, keep=True) == 0
    assert "2 rows: 1 passed, 1 not applicable" in capsys.readouterr().out
    assert (tmp_path / "out" / "records" / "between_two_cars_whole" / "summary.json").is_file()
