"""Prints a suite's outcomes as a table, and writes them as CSV and JSON.

Knows outcomes; nothing of how they came about.
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from vve_sumo.suite.row import Outcome, Verdict

IN_KMH = 3.6  #: km/h in a m/s

COLOURS = {
    Verdict.PASSED: "green",
    Verdict.FAILED: "red",
    Verdict.UNAVOIDABLE: "yellow",
    Verdict.INVALID: "red",
    Verdict.NOT_APPLICABLE: "dim",
}


def record_of(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome as one flat row of plain values; None where there is nothing to say."""
    row, need = outcome.row, outcome.row.need
    low, high = outcome.approach_mps or (None, None)
    return {
        "id": row.id,
        "what": row.what,
        "required": row.required,
        "verdict": outcome.verdict.value,
        "why": outcome.why,
        "impact_kmh": _scaled(outcome.impact_mps),
        "least_gap_m": _rounded(outcome.least_gap_m),
        "max_deceleration_mps2": _rounded(outcome.deceleration_mps2),
        "approach_least_kmh": _scaled(low),
        "approach_greatest_kmh": _scaled(high),
        "cut_in_ttc_s": _rounded(outcome.cut_in_ttc_s),
        "needed_m": None if need is None else _rounded(need.way),
        "there_m": None if need is None else _rounded(need.there),
        "avoidable": None if need is None else need.avoidable,
        "record": None if outcome.record is None else str(outcome.record),
    }


def _scaled(speed: float | None) -> float | None:
    return None if speed is None else _rounded(IN_KMH * speed)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def cells(outcome: Outcome) -> tuple[str, ...]:
    """Return an outcome's cells, in the order of HEADINGS."""
    row, need = outcome.row, outcome.row.need
    impact = None if outcome.impact_mps is None else IN_KMH * outcome.impact_mps
    numbers = (impact, outcome.least_gap_m, outcome.deceleration_mps2)
    way = ("", "") if need is None else (f"{need.way:.1f}", f"{need.there:.1f}")
    return (row.what, row.required, *(_cell(number) for number in numbers), *way, outcome.verdict.value)


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


#: the last two numbers: the way that full braking needs by closed form, and the gap that there is to begin with
HEADINGS = ("test", "required", "impact km/h", "least gap m", "braked m/s²", "needs m", "there m", "verdict")
NUMBERS = range(2, 7)  #: of the cells, those with numbers


def table(title: str, outcomes: Sequence[Outcome]) -> Table:
    """Return the outcomes as a table for the screen."""
    drawn = Table(title=Text(title), title_justify="left")
    for number, heading in enumerate(HEADINGS):
        drawn.add_column(heading, justify="right" if number in NUMBERS else "left")
    for outcome in outcomes:
        *others, verdict = (Text(cell) for cell in cells(outcome))
        verdict.stylize(COLOURS[outcome.verdict])
        drawn.add_row(*others, verdict)
    return drawn


def whys(outcomes: Sequence[Outcome]) -> list[str]:
    """Say why rows were not passed, in a line for each reason."""
    named: dict[str, list[str]] = {}
    for outcome in outcomes:
        if outcome.why:
            named.setdefault(f"{outcome.verdict}: {outcome.why}", []).append(outcome.row.id)
    return [f"{', '.join(ids)}: {why}" for why, ids in named.items()]


def markdown(outcomes: Sequence[Outcome]) -> str:
    """Return the outcomes as a table of a document, what is to be said of them below it."""
    rule = "|".join("---:" if number in NUMBERS else "---" for number in range(len(HEADINGS)))
    rows = [f"| {' | '.join(cells(outcome))} |" for outcome in outcomes]
    reasons = [f"* {why}" for why in whys(outcomes)]
    return "\n".join([f"| {' | '.join(HEADINGS)} |", f"|{rule}|", *rows, "", f"{counted(outcomes)}.", "", *reasons])


def counted(outcomes: Sequence[Outcome]) -> str:
    """Say how many rows came to which verdict."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    said = (f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])
    return f"{len(outcomes)} rows: {', '.join(said)}"


def write(name: str, outcomes: Sequence[Outcome], folder: Path) -> tuple[Path, ...]:
    """Write NAME.csv, NAME.json and NAME.md into `folder` and return their places."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [record_of(outcome) for outcome in outcomes]
    files = tuple(folder / f"{name}.{ending}" for ending in ("csv", "json", "md"))
    with files[0].open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    files[1].write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    files[2].write_text(markdown(outcomes).rstrip() + "\n", encoding="utf-8")
    return files
