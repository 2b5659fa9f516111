"""The page of the suites takes in fresh tables and leaves everything else as it is."""

from __future__ import annotations

from benchmarks import suites
from vve_sumo.suite import catalogue
from vve_sumo.suite.row import RowVerdict

OLD = f"before\n\n{suites.BEGIN}\n\n### `r152`\n\nold r152\n\n* why\n\n### `r157`\n\nold r157\n\n{suites.END}\nafter\n"


def test_fresh_tables_come_in_and_the_others_stay():
    page = suites.written(OLD, {"r157": "new r157", "fmvss127": "new fmvss127"})
    assert page.startswith(
        f"before\n\n{suites.BEGIN}\n\n### `r152`\n\nold r152\n\n* why\n\n### `fmvss127`\n\nnew fmvss"
    )
    assert page.endswith(f"### `r157`\n\nnew r157\n\n{suites.END}\nafter\n")
    assert suites.written(page, {}) == page
    assert suites.written(OLD, {}) == OLD


def test_the_page_that_is_there_is_one():
    page = suites.PAGE.read_text(encoding="utf-8")
    assert suites.written(page, {}) == page
    assert set(suites.HEADING.findall(page)) == set(catalogue.names())


def test_the_table_of_vru_says_clearance_contact_and_what_was_not_driven():
    record = {"driven": 1, "passed": 1, "impact_kmh": 0.0, "clearance_m": 1.04, "off_path_m": 0.02}
    passed = record | {"id": "bicyclist_along_both_20", "verdict": "passed"}
    contact = {"impact_kmh": 33.4, "clearance_m": 0.0, "passed": 0, "verdict": "failed"}
    failed = record | contact | {"id": "bicyclist_along_both_30"}
    astray = record | {"id": "bicyclist_along_both_40", "verdict": "failed", "passed": 0, "off_path_m": 1.7}
    nowhere = failed | {"id": "bicyclist_along_both_50", "verdict": RowVerdict.UNAVOIDABLE.value}
    left_out = {"id": "bicyclist_along_both_10", "driven": 0, "passed": 0, "verdict": "not applicable"}
    lines = suites.matrix([passed, failed, astray, nowhere, left_out]).splitlines()
    (line,) = (line for line in lines if "**" in line)
    assert line == (
        "| bicyclist rides ahead | both |  | 1.0 m | **contact at 33** | **1.0 m, 1.70 m off** | "
        "contact at 33 (no way out) | not driven |"
    )
    assert lines[-1].startswith("4 rows driven: 2 failed, 1 failed, not avoidable by closed form, 1 passed; 1 of 4")
    assert {line.count("|") for line in lines if line.startswith("|")} == {9}
