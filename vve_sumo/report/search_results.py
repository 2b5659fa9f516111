"""The result of a search, as a sentence and as a table: where a criterion flips, or the worst case.

Knows the content of `search.json`; neither the rows nor the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vve_sumo.metrics.contacts import BEYOND
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import NONE, SPACE, count, figure, short
from vve_sumo.report.tables import Cell, Column, ReportTable, Row, head_of

#: combinations that the page shows at most
MAX_ROWS = 200
SearchResult = Mapping[str, Any]
#: of parameters, by their names
Units = Mapping[str, str]


def sentence(result: SearchResult, units: Units) -> str:
    """Return the result as a sentence; `units` are those of the parameters."""
    return _boundary_sentence(result, units) if result["search"] == "boundary" else _worst_sentence(result, units)


def _boundary_sentence(result: SearchResult, units: Units) -> str:
    unit = _unit(result["along"], units)
    lines, along, criterion = result["boundaries"], result["along"], _criterion(result["criterion"])
    flips = [flip for line in lines for flip in line["flips"]]
    if not flips:
        return f"Along {along}, “{criterion}” flips nowhere."
    if len(lines) == 1 and len(flips) == 1:
        (flip,) = flips
        met = f"“{criterion}” is met at {along} = {short(flip['meets'])} and no longer at {short(flip['fails'])}{unit}"
        return f"{met}{_seed_by_seed(lines[0], unit)}."
    low, high = min(flip["meets"] for flip in flips), max(flip["meets"] for flip in flips)
    many = f"{count(len(flips), 'time')} in {count(len(lines), 'combination')}"
    return f"Along {along}, “{criterion}” flips {many}: last met between {short(low)} and {short(high)}{unit}."


def _seed_by_seed(line: SearchResult, unit: str) -> str:
    """Return the results of the single seeds where there are several: the verdict is that of their majority."""
    fails = _fails(line)
    if len(line["seeds"]) < 2 or not fails:
        return ""
    return f", by the majority of {len(line['seeds'])} seeds; the single seeds fail first at {_range(fails)}{unit}"


def _fails(line: SearchResult) -> list[float]:
    return [flip["fails"] for seed in line["seeds"] for flip in seed["flips"]]


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return short(low) if low == high else f"{short(low)} to {short(high)}"


def _unit(name: str, units: Units) -> str:
    unit = units.get(name) or unit_of(name)
    return f"{SPACE}{unit}" if unit else ""


def _criterion(name: str) -> str:
    return {"collision": "no collision", "passed": "every criterion"}.get(name, label_of(name))


def _goal(result: SearchResult) -> str:
    return "highest" if "highest" in result else "lowest"


def _worst_sentence(result: SearchResult, units: Units) -> str:
    goal = _goal(result)
    sought, case = result[goal], result["worst"]
    if not case:
        return f"No run has the figure that was sought, {label_of(sought)}."
    where = ", ".join(f"{name} = {short(value)}{_unit(name, units)}" for name, value in case["values"].items())
    if _is_contact(sought, case):
        return f"The worst case found for the {goal} {label_of(sought)} is {_contact(case)}, at {where}."
    return f"The {goal} {label_of(sought)} found is {figure(sought, case[sought])}, at {where}."


def _is_contact(sought: str, case: SearchResult) -> bool:
    return sought in BEYOND and case.get("collision") is True


def _contact(case: SearchResult) -> str:
    return f"a contact at {figure('impact_speed_mps', case.get('impact_speed_mps'))}"


def table_of(result: SearchResult, units: Units) -> ReportTable:
    """Return the result as a table; `units` are those of the parameters."""
    return _boundaries(result, units) if result["search"] == "boundary" else _worst_case(result, units)


def _boundaries(result: SearchResult, units: Units) -> ReportTable:
    lines: Sequence[SearchResult] = result["boundaries"]
    names = list(dict.fromkeys(name for line in lines for name in line["values"]))
    ends = (f"{head_of(result['along'], units)}, last met", "first not met", "first not met by the single seeds")
    heads = [*(head_of(name, units) for name in names), *ends]
    columns = [*(Column(head, True) for head in heads), Column("a run that fails")]
    rows = [row for line in lines for row in _boundary(line, names)]
    return ReportTable("boundaries", columns, rows[:MAX_ROWS], len(rows))


def _boundary(line: SearchResult, names: Sequence[str]) -> list[Row]:
    values = [short(line["values"].get(name)) for name in names]
    fails = _fails(line)
    seeds = _range(fails) if fails else NONE
    keys = (flip["key_fails"] for seed in line["seeds"] for flip in seed["flips"])
    key = next((Cell(key, kind="code") for key in keys), "")
    if not line["flips"]:
        ends = ("throughout", NONE) if line["meets_first"] else (NONE, "throughout")
        return [[*values, *ends, seeds, key]]
    return [[*values, short(flip["meets"]), short(flip["fails"]), seeds, key] for flip in line["flips"]]


def _worst_case(result: SearchResult, units: Units) -> ReportTable:
    case, goal = result["worst"], result[_goal(result)]
    rows: list[Row] = []
    if case:
        rows += [(head_of(name, units), short(value)) for name, value in case["values"].items()]
        value = _contact(case) if _is_contact(goal, case) else short(case[goal])
        rows += [("seed", short(case["seed"])), (head_of(goal), value), ("outcome", str(case["outcome"]))]
        rows += [
            ("passed", "yes" if case["passed"] else f"no: {case['failed']}"),
            ("key", Cell(case["key"], kind="code")),
        ]
    return ReportTable("worst case", ("what", "worst case"), rows)
