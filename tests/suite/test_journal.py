"""What a suite has driven is found again, to the last bit; a journal of anything else is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sweep.test_controllers import TOY
from tests.vehicles import FUSION
from vve_sumo.drive import provenance
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError
from vve_sumo.suite import catalogue
from vve_sumo.suite.journal import NAME, SuiteJournal
from vve_sumo.suite.query import code_of, with_controller
from vve_sumo.suite.row import RowOutcome, RowVerdict

#: a controller of one's own
OWN = TOY % ("ease", "ease", "ease")
ROWS = catalogue.rows("pass_through", FUSION)
NUMBERS = st.none() | st.floats(allow_nan=False)
OUTCOMES = st.builds(
    RowOutcome,
    row=st.sampled_from(ROWS[:2]),
    seed=st.integers(1, 99),
    verdict=st.sampled_from(RowVerdict),
    why=st.text(),
    approach_mps=st.none() | st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)),
    cut_in_ttc_s=NUMBERS,
    impact_mps=NUMBERS,
    least_gap_m=NUMBERS,
    deceleration_mps2=NUMBERS,
    demand_mps2=NUMBERS,
    record=st.none() | st.just(Path("records/seed_1")),
    cpu_s=st.floats(0.0, 1e6),
)


@given(outcomes=st.lists(OUTCOMES, max_size=4), torn=st.integers(1, 60))
def test_what_was_written_is_read_again_but_for_a_torn_line(tmp_path_factory, outcomes, torn):
    folder = tmp_path_factory.mktemp("journal")
    with SuiteJournal(folder, ROWS, resume=False) as journal:
        for outcome in outcomes:
            journal.add(outcome)
    file = folder / NAME
    file.write_bytes(file.read_bytes() + b'{"row": "between'[:torn])
    with SuiteJournal(folder, ROWS, resume=True) as journal:
        assert journal.known == outcomes
    with SuiteJournal(folder, ROWS, resume=True) as journal:
        assert journal.known == outcomes


def test_drives_of_two_versions_of_a_controller_are_in_no_one_journal(tmp_path: Path) -> None:
    first = tmp_path / "controllers" / "mine.py"
    first.parent.mkdir()
    first.write_text(OWN, encoding="utf-8")
    rows = [with_controller(row, "mine") for row in ROWS]
    code = code_of(rows, tmp_path)
    assert code_of(rows, tmp_path) == code
    outcome = RowOutcome(row=rows[0], seed=1, verdict=RowVerdict.PASSED)
    with SuiteJournal(tmp_path / "out", rows, resume=False, code=code) as journal:
        journal.add(outcome)
    with SuiteJournal(tmp_path / "out", rows, resume=True, code=code) as journal:
        assert journal.known == [outcome]
    first.write_text(OWN + "# another\n", encoding="utf-8")
    other = code_of(rows, tmp_path)
    assert other != code
    with pytest.raises(ConfigError, match=r"line 1: row .* was driven by other code of its controller"):
        SuiteJournal(tmp_path / "out", rows, resume=True, code=other)


def test_another_car_under_the_same_name_is_another_test(tmp_path: Path) -> None:
    outcome = RowOutcome(row=ROWS[0], seed=1, verdict=RowVerdict.PASSED)
    with SuiteJournal(tmp_path, ROWS, resume=False, car=FUSION) as journal:
        journal.add(outcome)
    with SuiteJournal(tmp_path, ROWS, resume=True, car=FUSION) as journal:
        assert journal.known == [outcome]
    heavier = replace(FUSION, vehicle=replace(FUSION.vehicle, mass=1.1 * FUSION.vehicle.mass))
    with pytest.raises(ConfigError, match=f"line 1: row '{ROWS[0].id}' differs from the begun suite"):
        SuiteJournal(tmp_path, ROWS, resume=True, car=heavier)


def test_other_code_of_this_program_is_in_no_one_journal(tmp_path: Path) -> None:
    """A checkout keeps its version while its code changes: only the code's own hash tells."""
    before = code_of(ROWS, tmp_path)
    decisive_versions.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "code_sha256", lambda _package: "0" * 64)
        other = code_of(ROWS, tmp_path)
    decisive_versions.cache_clear()
    assert other != before
    assert code_of(ROWS, tmp_path) == before


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{}", "line 2: expected a finished drive"),
        ("nonsense", "line 2: expected a finished drive"),
        ("[1]", "line 2: expected a finished drive"),
        ('{"row": "stopped_10", "digest": "0"}', "line 2: row 'stopped_10' differs from the begun suite"),
    ],
)
def test_a_journal_of_something_else_is_refused(line, said, tmp_path):
    with SuiteJournal(tmp_path, ROWS, resume=False) as journal:
        journal.add(RowOutcome(ROWS[0], 1, RowVerdict.PASSED))
    file = tmp_path / NAME
    file.write_text(file.read_text(encoding="utf-8") + line + "\n", encoding="utf-8")
    before = file.read_bytes()
    with pytest.raises(ConfigError, match=said):
        SuiteJournal(tmp_path, ROWS, resume=True)
    assert file.read_bytes() == before


def test_a_row_that_demands_something_else_is_another_test(tmp_path):
    with SuiteJournal(tmp_path, ROWS, resume=False) as journal:
        journal.add(RowOutcome(ROWS[0], 1, RowVerdict.PASSED))
    with pytest.raises(ConfigError, match="differs from the begun suite"):
        SuiteJournal(tmp_path, [replace(ROWS[0], demand=5.0), *ROWS[1:]], resume=True)
