"""Drives suites with ten seeds a row and writes their tables into docs/suites.md; of `vru` one table of all speeds.

`python -m benchmarks.suites FOLDER [SUITE …]` drives into a folder of each suite under FOLDER; what was driven there
already stays, so a run that was killed goes on. `--page` drives nothing and writes the page with the tables that FOLDER
has. A suite without a table there keeps the one that the page has. `--smoke` drives a single suite once, and changes
nothing.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vve_sumo.cli import suite
from vve_sumo.suite import catalogue, vru
from vve_sumo.suite.query import SuiteQuery
from vve_sumo.suite.row import RowVerdict

PAGE = Path(__file__).parent.parent / "docs" / "suites.md"
SEEDS = 10
SHORTEST = "pass_through"
BEGIN, END = "<!-- written by benchmarks/suites.py; do not edit -->", "<!-- end of what it wrote -->"
HEADING = re.compile(r"^### `(\w+)`\n", re.MULTILINE)


def main() -> None:
    """Drive, unless only the page is wanted; then write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("suites", nargs="*", metavar="suite", help="left out: all")
    parser.add_argument("--page", action="store_true", help="write the page, drive nothing")
    parser.add_argument("--workers", type=int, help="drives at a time (default: as many as processors)")
    parser.add_argument("--smoke", action="store_true", help="a short suite with one seed, only to see that it runs")
    asked = parser.parse_args()
    page = PAGE.read_text(encoding="utf-8")
    if asked.smoke:
        with tempfile.TemporaryDirectory() as scratch:
            drive(Path(scratch), [SHORTEST], 1, asked.workers)
            print(written(page, tables(Path(scratch))))
        return
    if asked.folder is None:
        parser.error("expected a folder for the drives")
    if not asked.page:
        drive(asked.folder, asked.suites or catalogue.names(), SEEDS, asked.workers)
    PAGE.write_text(written(page, tables(asked.folder)), encoding="utf-8")


def drive(folder: Path, names: Sequence[str], seeds: int, workers: int | None) -> None:
    """Drive suites, each into a folder of its own, or go on with what is there."""
    for name in names:
        out = folder / name
        suite.drive(name, SuiteQuery(out=out, seeds=seeds, workers=workers, resume=(out / "sweep.json").is_file()))


def tables(folder: Path) -> dict[str, str]:
    """Return the tables that a folder has, by suite."""
    files = {name: folder / name / f"{name}.md" for name in catalogue.names()}
    found = {name: file.read_text(encoding="utf-8").strip() for name, file in files.items() if file.is_file()}
    if "vru" in found:
        found["vru"] = matrix(json.loads((folder / "vru" / "vru.json").read_text(encoding="utf-8")))
    return found


def matrix(records: Sequence[dict[str, Any]]) -> str:
    """Return the table of `vru`: a line for each case and means, a column for each speed.

    `records` are those of `vru.json`; a row that they lack was not driven.
    """
    known = {record["id"]: record for record in records}
    speeds = [f"{speed:g}" for speed in vru.SPEEDS]
    lines = [f"| | means | {' | '.join(f'{speed} km/h' for speed in speeds)} |", "|---" * (2 + len(speeds)) + "|"]
    for name, case in vru.CASES.items():
        for means in vru.MEANS:
            cells = [cell(known.get(f"{name}_{means}_{speed}")) for speed in speeds]
            lines.append(f"| {case.description} | {means} | {' | '.join(cells)} |")
    driven = [record for record in records if record["driven"]]
    passed, runs = (sum(record[key] for record in driven) for key in ("passed", "driven"))
    verdicts = Counter(record["verdict"] for record in driven)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    lines += ["", f"{len(driven)} rows driven: {counts}; {passed} of {runs} drives passed."]
    return "\n".join(lines)


def cell(record: dict[str, Any] | None) -> str:
    """Return what a row came to: the least clearance, or the greatest impact speed; bold where it failed."""
    if record is None:
        return "not driven"
    if not record["driven"]:
        return ""
    impact, off = record["impact_kmh"], record["off_path_m"]
    if impact:
        text = f"contact at {impact:.0f}"
    elif record["clearance_m"] is None:
        text = record["verdict"]
    else:
        text = f"{record['clearance_m']:.1f} m" + (f", {off:.2f} m off" if off > vru.BACK_WITHIN else "")
    if record["verdict"] == RowVerdict.UNAVOIDABLE:
        return f"{text} (no way out)"
    return text if record["verdict"] == RowVerdict.PASSED else f"**{text}**"


def written(page: str, fresh: dict[str, str]) -> str:
    """Return a page with fresh tables, those of other suites as they were, in the order of the list of suites."""
    head, _begin, rest = page.partition(BEGIN)
    body, _end, foot = rest.partition(END)
    pieces = HEADING.split(body)
    known = {name: text.strip() for name, text in zip(pieces[1::2], pieces[2::2], strict=True)} | fresh
    sections = [f"### `{name}`\n\n{known[name]}" for name in catalogue.names() if name in known]
    return head + "\n\n".join([BEGIN, *sections, END]) + foot


if __name__ == "__main__":
    main()
