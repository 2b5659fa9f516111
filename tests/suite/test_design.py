"""What a suite has driven is found again in its dataset; a dataset of anything else is refused, and nothing changed."""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import REPOSITORY
from tests.sweep.test_controllers import TOY
from tests.sweep.test_dataset import content
from tests.vehicles import FUSION
from vve_sumo.analysis import load
from vve_sumo.cli import main
from vve_sumo.drive import provenance
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError
from vve_sumo.report.write import report_of
from vve_sumo.suite import catalogue
from vve_sumo.suite.design import ROW, SuiteDesign, design_of, key
from vve_sumo.suite.judge import STORED, columns_of, outcome_of
from vve_sumo.suite.query import with_controller
from vve_sumo.suite.row import RowOutcome, RowVerdict, SuiteRow
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.fill import _tally
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.view.library import Library

#: a controller of one's own
OWN = TOY % ("ease", "ease", "ease")
ROWS = catalogue.rows("pass_through", FUSION)
DRIVEN = [row for row in ROWS if row.scenario is not None]
NUMBERS = st.none() | st.floats(allow_nan=False, allow_infinity=False)
OUTCOMES = st.builds(
    RowOutcome,
    row=st.sampled_from(DRIVEN),
    seed=st.integers(1, 3),
    verdict=st.sampled_from(RowVerdict),
    why=st.text(st.characters(codec="utf-8")),
    **dict.fromkeys(STORED[1:], NUMBERS),
)


@pytest.fixture(scope="module")
def design() -> SuiteDesign:
    return design_of("pass_through", "a title", ROWS, 3, REPOSITORY)


def again(design: SuiteDesign, **changes: object) -> SuiteDesign:
    return SuiteDesign(replace(design.plan, **changes), ROWS)


def stored(dataset: Dataset, design: SuiteDesign, outcomes: Sequence[RowOutcome]) -> None:
    """Store drives with given outcomes."""
    runs = {run.key: run for run in design._every()}
    for outcome in outcomes:
        run = runs[key(outcome.row.id, outcome.seed)]
        dataset.add(run, RunResult(run.key, columns_of(outcome)))


def every(design: SuiteDesign, seeds: int) -> list[RowOutcome]:
    return [RowOutcome(row, seed, RowVerdict.PASSED) for seed in range(1, seeds + 1) for row in DRIVEN]


@pytest.mark.thorough
@given(outcomes=st.lists(OUTCOMES, max_size=4, unique_by=lambda one: (one.row.id, one.seed)), torn=st.integers(1, 60))
def test_what_was_written_is_read_again_but_for_a_torn_line(tmp_path_factory, design, outcomes, torn):
    folder = tmp_path_factory.mktemp("suite")
    dataset = Dataset(folder, design.plan, resume=False)
    stored(dataset, design, outcomes)
    dataset.close()
    if len(outcomes) < design.plan.cells:
        file = folder / "journal.jsonl"
        file.write_bytes(file.read_bytes() + b'{"number": 1'[:torn])
    dataset = Dataset(folder, design.plan, resume=True)
    rows = {row["key"]: row for row in dataset.rows()}
    dataset.close()
    assert len(rows) == len(outcomes)
    for outcome in outcomes:
        assert outcome_of(outcome.row, rows[key(outcome.row.id, outcome.seed)], folder / "none") == outcome


@pytest.mark.parametrize(
    ("verdict", "passed"),
    [
        (RowVerdict.PASSED, True),
        (RowVerdict.FAILED, False),
        (RowVerdict.INVALID, False),
        (RowVerdict.UNAVOIDABLE, None),
    ],
)
def test_a_drive_that_no_brakes_could_pass_counts_neither_as_passed_nor_as_failed(verdict, passed):
    assert columns_of(RowOutcome(DRIVEN[0], 1, verdict))["passed"] is passed


def test_a_drive_with_an_error_is_counted_once(design: SuiteDesign, tmp_path: Path) -> None:
    run = next(run for run in design._every())
    judged = design.judged(run, design.job(run, tmp_path / "record"), RunResult(run.key, error="crashed: SIGSEGV"))
    assert (judged.figures["passed"], judged.figures["verdict"]) == (None, RowVerdict.FAILED.value)
    dataset = Dataset(tmp_path / "suite", design.plan, resume=False)
    dataset.add(run, judged)
    tally = _tally(design, dataset)
    dataset.close()
    assert (tally.finished, tally.failed, tally.errors) == (1, 0, 1)


def test_more_seeds_are_driven_beside_those_that_there_are(design: SuiteDesign, tmp_path: Path) -> None:
    """Two seeds are whole and sealed; the third's rows join them, and the files are those of a suite of three."""
    two = again(design, spec=design.plan.spec | {"seeds": 2}, cells=2 * len(DRIVEN))
    dataset = Dataset(tmp_path / "grown", two.plan, resume=False)
    stored(dataset, two, every(two, 2))
    dataset.close()
    assert not (tmp_path / "grown" / "journal.jsonl").exists()
    dataset = Dataset(tmp_path / "grown", design.plan, resume=True)
    assert [run.key for run in design.runs(dataset) if isinstance(run, RunSpec)] == [key(row.id, 3) for row in DRIVEN]
    stored(dataset, design, every(design, 3)[-len(DRIVEN) :])
    dataset.close()
    dataset = Dataset(tmp_path / "whole", design.plan, resume=False)
    stored(dataset, design, every(design, 3))
    dataset.close()
    assert content(tmp_path / "grown") == content(tmp_path / "whole")
    with pytest.raises(ConfigError, match="holds 3 seeds, expected as many or more"):
        Dataset(tmp_path / "grown", two.plan, resume=True)


@pytest.mark.thorough
def test_drives_of_two_versions_of_a_controller_are_in_no_one_dataset(tmp_path: Path) -> None:
    first = tmp_path / "controllers" / "mine.py"
    first.parent.mkdir()
    first.write_text(OWN, encoding="utf-8")
    rows = [with_controller(row, "mine") for row in ROWS]
    begun = design_of("few", "", rows, 1, tmp_path)
    Dataset(tmp_path / "out", begun.plan, resume=False).close()
    Dataset(tmp_path / "out", design_of("few", "", rows, 1, tmp_path).plan, resume=True).close()
    first.write_text(OWN + "# another\n", encoding="utf-8")
    before = content(tmp_path / "out")
    other = design_of("few", "", rows, 1, tmp_path)
    with pytest.raises(ConfigError, match=r"the file of controller\S* has changed since that suite began"):
        Dataset(tmp_path / "out", other.plan, resume=True)
    assert content(tmp_path / "out") == before


@pytest.mark.thorough
def test_another_car_under_the_same_name_is_another_test(tmp_path: Path) -> None:
    (tmp_path / "vehicles").mkdir()
    car = tmp_path / "vehicles" / "ford_fusion.toml"
    car.write_text((REPOSITORY / "vehicles" / "ford_fusion.toml").read_text(encoding="utf-8"), encoding="utf-8")
    Dataset(tmp_path / "out", design_of("few", "", ROWS, 1, tmp_path).plan, resume=False).close()
    car.write_text(car.read_text(encoding="utf-8").replace("mass_kg = 1690.0", "mass_kg = 1790.0"), encoding="utf-8")
    with pytest.raises(ConfigError, match="the file of vehicle has changed since that suite began"):
        Dataset(tmp_path / "out", design_of("few", "", ROWS, 1, tmp_path).plan, resume=True)


@pytest.mark.thorough
def test_other_code_of_this_program_is_in_no_one_dataset(design: SuiteDesign, tmp_path: Path) -> None:
    """A checkout keeps its version while its code changes: only the code's own hash tells."""
    Dataset(tmp_path, design.plan, resume=False).close()
    decisive_versions.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "code_sha256", lambda _package: "0" * 64)
        other = design_of("pass_through", "a title", ROWS, 3, REPOSITORY)
    decisive_versions.cache_clear()
    with pytest.raises(ConfigError, match="mixed versions: its rows are of code"):
        Dataset(tmp_path, other.plan, resume=True)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"demand": 5.0}, f"the test {DRIVEN[0].id} has changed"),
        ({"required": "another"}, f"the test {DRIVEN[0].id} has changed"),
        ({"id": "other"}, f"the test {DRIVEN[0].id} has changed"),
    ],
)
def test_a_row_that_demands_something_else_is_another_test(changed, said, design: SuiteDesign, tmp_path: Path) -> None:
    Dataset(tmp_path, design.plan, resume=False).close()
    rows: list[SuiteRow] = [replace(row, **changed) if row is DRIVEN[0] else row for row in ROWS]
    with pytest.raises(ConfigError, match=said):
        Dataset(tmp_path, design_of("pass_through", "a title", rows, 3, REPOSITORY).plan, resume=True)


def test_a_suite_of_an_earlier_version_is_one_line(tmp_path: Path, capsys, monkeypatch) -> None:
    (tmp_path / "journal.jsonl").write_text('{"row": "stopped_10"}\n', encoding="utf-8")
    for command in (["suite", "pass_through", "--out", str(tmp_path), "--resume"], ["report", str(tmp_path)]):
        assert main(command) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "no sweep.json: the layout that a suite of an earlier vve-sumo left" in line
    assert [file.name for file in tmp_path.iterdir()] == ["journal.jsonl"]


def test_a_suites_folder_is_read_as_a_sweeps(design: SuiteDesign, tmp_path: Path) -> None:
    bad = RowOutcome(DRIVEN[0], 1, RowVerdict.FAILED, why="braked at nothing")
    dataset = Dataset(tmp_path, design.plan, resume=False)
    stored(dataset, design, [bad, *every(design, 3)[1:]])
    dataset.close()
    sweep = load(tmp_path)
    rows = sweep.rows()
    assert (sweep.title, sweep.parameters, sweep.planned) == ("a title", [ROW], 3 * len(DRIVEN))
    assert rows["verdict"].tolist() == ["failed", *["passed"] * (3 * len(DRIVEN) - 1)]
    assert rows.attrs["units"]["demand_mps2"] == "m/s²"
    passed = sweep.grouped([ROW], ["demand_mps2"]).set_index(ROW)["passed"]
    assert passed.to_dict() == {row.id: 2 if row is DRIVEN[0] else 3 for row in DRIVEN}
    page = report_of(tmp_path)
    assert (page.kind, page.verdict.word) == ("Report of a suite", "FAILED")
    shown = Library([tmp_path])
    assert shown.contents()["title"] == "a title"
    assert json.dumps(DRIVEN[0].id).encode() in gzip.decompress(shown.table() or b"")
