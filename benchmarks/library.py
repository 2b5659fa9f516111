"""Drives every shipped scenario with a few seeds and writes docs/library.md and its pictures.

`python -m benchmarks.library`: some ten minutes on two processors. With names of scenarios only these are driven and
drawn, and the others keep their figures. `--pictures` draws, and writes the page with the
figures that it has; nothing is driven. `--smoke` does both for one short scenario, and changes nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from vve_sumo.scenario import descriptions
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Scenario

REPOSITORY = Path(__file__).parent.parent
PAGE, PICTURES = REPOSITORY / "docs" / "library.md", REPOSITORY / "docs" / "scenarios"
SEEDS = (1, 2)
#: minutes each: their own seed will do
LONG = {"leap_loop", "rush_hour"}
SHORTEST = "leap_hard_stop"
WORKERS = 2
BEGIN, END = "<!-- written by benchmarks/library.py; do not edit -->", "<!-- end of what it wrote -->"
COLUMNS = (
    "scenario",
    "passed",
    "outcome",
    "least gap [m]",
    "least time to collision [s]",
    "greatest deceleration [m/s²]",
    "drive time [s]",
    "emergency braking",
)
FIGURES = ("min_gap_m", "min_ttc_s", "max_deceleration_mps2", "duration_s")


def drive(name: str, seed: int) -> dict[str, Any]:
    """Drive a scenario with a seed and return its summary; in a process of its own."""
    from vve_sumo.drive import run as drives

    with tempfile.TemporaryDirectory() as scratch:
        resolved = drives.resolve_by_name(name, REPOSITORY, seed=seed)
        return drives.run(resolved, Path(scratch) / "record", REPOSITORY).summary


def paint(name: str, folder: Path) -> None:
    """Draw a scenario's picture into a folder."""
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.scenario_text import special_conditions
    from vve_sumo.plotting.scenario import draw

    resolved = resolve_by_name(name, REPOSITORY)
    draw(resolved, folder / f"{name}.png", special_conditions(resolved, REPOSITORY))


def row(name: str, summaries: Sequence[dict[str, Any]]) -> str:
    """Return a line of the table of what was measured: least and greatest over the seeds."""
    outcomes = ", ".join(sorted({summary["outcome"] for summary in summaries}))
    cells = [_span([summary[figure] for summary in summaries]) for figure in FIGURES]
    braked = sum(bool(summary["emergency_used"]) for summary in summaries)
    passed = sum(summary["passed"] is True for summary in summaries)
    many = len(summaries)
    return f"| {' | '.join([f'[`{name}`](#{name})', f'{passed} of {many}', outcomes, *cells, f'{braked} of {many}'])} |"


def _span(values: Sequence[float]) -> str:
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return "none"
    low, high = f"{min(known):.1f}", f"{max(known):.1f}"
    return low if low == high else f"{low} to {high}"


def section(name: str, scenario: Scenario) -> Iterator[str]:
    """Return the lines of the page that are about one scenario."""
    yield from (f"### {name}", "", f"**{scenario.title}.** {' '.join(scenario.description.split())}", "")
    yield from (
        f"![{name}: the virtual road from above, what moves how and which trigger fires when](scenarios/{name}.png)",
        "",
    )
    yield from (f"Passes if: {descriptions.passes(scenario.criteria)}.", "")
    if scenario.parameters:
        yield from ("| parameter | from | to | meaning |", "|---|---|---|---|")
        for key, one in scenario.parameters.items():
            yield f"| `{key}` | {one.min:g} | {one.max:g} | {one.meaning} |"
        yield ""


def names() -> list[str]:
    """Return every shipped scenario's name."""
    return sorted(file.stem for file in (REPOSITORY / "scenarios").glob("*.toml"))


def seeds(name: str) -> tuple[int, ...]:
    """Return the seeds that a scenario is driven with."""
    return (load(REPOSITORY / "scenarios" / f"{name}.toml").seed,) if name in LONG else SEEDS


def sections(these: Sequence[str]) -> str:
    """Return what the page says of these scenarios."""
    return "\n".join(line for name in these for line in section(name, load(REPOSITORY / "scenarios" / f"{name}.toml")))


def measured(these: Sequence[str], seeds_of: Callable[[str], Sequence[int]]) -> str:
    """Drive these scenarios with every seed and return the table."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=spawn, max_tasks_per_child=1) as pool:
        runs = {name: [pool.submit(drive, name, seed) for seed in seeds_of(name)] for name in these}
        rows = []
        for name, drives in runs.items():
            summaries = [one.result() for one in drives]
            rows.append(row(name, summaries))
            print(rows[-1], json.dumps([summary["failed"] for summary in summaries]), flush=True)
    return "\n".join([f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|", *rows])


def written(text: str, table: str, body: str) -> str:
    """Return the page's text with this body and the rows of this table; other rows stay."""
    found = re.search(rf"(.*){BEGIN}\n(.*?)\n\n## One by one\n.*{END}(.*)", text, re.DOTALL)
    assert found is not None, f"{PAGE}: no place to write"
    rows = {name: line for line in found.group(2).splitlines() if (name := _scenario(line))}
    rows |= {name: line for line in table.splitlines() if (name := _scenario(line))}
    table = "\n".join(
        [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|", *(rows[name] for name in sorted(rows))]
    )
    return f"{found.group(1)}{BEGIN}\n\n{table}\n\n## One by one\n\n{body}\n{END}{found.group(3)}"


def _scenario(line: str) -> str:
    """Return whose row of the table a line is; empty for another line."""
    found = re.match(r"\| \[`(\w+)`\]", line)
    return found.group(1) if found else ""


def smoke() -> None:
    """Draw, drive and write of a single scenario; the page and the pictures stay as they are."""
    with tempfile.TemporaryDirectory() as scratch:
        paint(SHORTEST, Path(scratch))
        table = measured([SHORTEST], lambda _name: SEEDS[:1])
        print(written(PAGE.read_text(encoding="utf-8"), table, sections([SHORTEST])))


def main() -> None:
    """Draw, drive, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="scenario", help="left out: all")
    parser.add_argument("--pictures", action="store_true", help="draw and write, do not drive")
    parser.add_argument("--smoke", action="store_true", help="of one scenario, only to see that it runs")
    asked = parser.parse_args()
    if asked.smoke:
        smoke()
        return
    PICTURES.mkdir(exist_ok=True)
    for name in asked.names or names():
        paint(name, PICTURES)
    table = "" if asked.pictures else measured(asked.names or names(), seeds)
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), table, sections(names())), encoding="utf-8")


if __name__ == "__main__":
    main()
