"""The judged rows of a suite as a table: its cells and lines, and the files as CSV, JSON and Markdown.

Knows judged rows; not how they were judged.
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vve_sumo.suite.row import JudgedRow, RowVerdict

IN_KMH = 3.6  #: km/h in a m/s


def record_of(judged: JudgedRow) -> dict[str, Any]:
    """Return a judged row as a flat table of values, the worst of its drives; None for a missing value."""
    row, need = judged.row, judged.row.need
    return {
        "id": row.id,
        "what": row.description,
        "required": row.required,
        "verdict": judged.verdict.value,
        "why": judged.why,
        "driven": len(judged.drives),
        "passed": judged.passed,
        "impact_kmh": _scaled(judged.maximum("impact_speed_mps")),
        "least_gap_m": _rounded(judged.minimum("min_gap_m")),
        "max_deceleration_mps2": _rounded(judged.maximum("max_deceleration_mps2")),
        "least_demand_mps2": _rounded(judged.minimum("demand_mps2")),
        "approach_least_kmh": _scaled(judged.minimum("approach_least_mps")),
        "approach_greatest_kmh": _scaled(judged.maximum("approach_greatest_mps")),
        "cut_in_ttc_s": _rounded(judged.minimum("cut_in_ttc_s")),
        "clearance_m": _rounded(judged.minimum("clearance_m")),
        "off_path_m": _rounded(judged.maximum("off_path_m")),
        "head_to_tail_l2": _rounded(judged.maximum("head_to_tail_l2")),
        "needed_m": None if need is None else _rounded(need.needed),
        "there_m": None if need is None else _rounded(need.available),
        "avoidable": None if need is None else need.avoidable,
        "records": ";".join(str(drive.record) for drive in judged.drives if drive.record is not None) or None,
    }


def _scaled(speed: float | None) -> float | None:
    return None if speed is None else _rounded(IN_KMH * speed)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def cells(judged: JudgedRow) -> tuple[str, ...]:
    """Return a row's cells, in the order of HEADINGS."""
    row, need = judged.row, judged.row.need
    impact = judged.maximum("impact_speed_mps")
    braked, demand = judged.maximum("max_deceleration_mps2"), judged.minimum("demand_mps2")
    numbers = (None if impact is None else IN_KMH * impact, judged.minimum("min_gap_m"), braked, demand)
    way = ("", "") if need is None else (_length(need.needed, need.unit), _length(need.available, need.unit))
    share = f"{judged.passed}/{len(judged.drives)}" if judged.drives else ""
    return (row.description, row.required, share, *(_cell(number) for number in numbers), *way, judged.verdict.value)


def _length(value: float, unit: str) -> str:
    return f"{value:.1f}" if unit == "m" else f"{value:.2f} {unit}"


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


#: the last two numbers: the distance that full braking needs by closed form,
#: and the gap that is available
HEADINGS = (
    "test", "required", "passed", "impact km/h", "least gap m", "braked m/s²", "demand m/s²", "needs m", "there m",
    "verdict",
)  # fmt: skip
NUMBERS = range(2, 9)  #: of the cells, those with numbers


def reason_lines(rows: Sequence[JudgedRow]) -> list[str]:
    """Return a line for each reason why rows did not pass."""
    named: dict[str, list[str]] = {}
    for judged in rows:
        if judged.why:
            named.setdefault(f"{judged.verdict}: {judged.why}", []).append(judged.row.id)
    return [f"{', '.join(ids)}: {why}" for why, ids in named.items()]


def markdown(rows: Sequence[JudgedRow]) -> str:
    """Return the rows as a Markdown table, followed by the summary and the reasons."""
    rule = "|".join("---:" if number in NUMBERS else "---" for number in range(len(HEADINGS)))
    lines = [f"| {' | '.join(cells(judged))} |" for judged in rows]
    reasons = [f"* {why}" for why in reason_lines(rows)]
    return "\n".join([f"| {' | '.join(HEADINGS)} |", f"|{rule}|", *lines, "", f"{summary_line(rows)}.", "", *reasons])


def summary_line(rows: Sequence[JudgedRow]) -> str:
    """Return one line: the number of rows by verdict, and of passed drives."""
    counts = Counter(judged.verdict for judged in rows)
    parts = (f"{counts[verdict]} {verdict}" for verdict in RowVerdict if counts[verdict])
    driven, passed = sum(len(judged.drives) for judged in rows), sum(judged.passed for judged in rows)
    return f"{len(rows)} rows: {', '.join(parts)}; {passed} of {driven} drives passed"


def write(name: str, rows: Sequence[JudgedRow], folder: Path) -> tuple[Path, ...]:
    """Write NAME.csv, NAME.json and NAME.md into `folder` and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    records = [record_of(judged) for judged in rows]
    files = tuple(folder / f"{name}.{ending}" for ending in ("csv", "json", "md"))
    with files[0].open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    files[1].write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    files[2].write_text(markdown(rows).rstrip() + "\n", encoding="utf-8")
    return files
