"""The page of the suites takes in fresh tables and leaves everything else as it is."""

from __future__ import annotations

from benchmarks import suites
from vve_sumo.suite import catalogue

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
