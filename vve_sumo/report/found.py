"""What a search found, as words and as a table: where a criterion flips, or how bad it can get.

Knows the content of `search.json`; neither the rows nor the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.html import Column, Html, sub, table, tag
from vve_sumo.report.tables import head_of
from vve_sumo.report.words import NONE, SPACE, count, said, short

#: combinations that are shown
MOST = 200
Found = Mapping[str, Any]
#: of parameters, by their names
Units = Mapping[str, str] | None


def sentence(found: Found, units: Units = None) -> str:
    """Return what was found, in plain words; `units` are those of the parameters."""
    return _flipped(found, units) if found["search"] == "boundary" else _worst(found, units)


def _flipped(found: Found, units: Units) -> str:
    unit = _unit(found["along"], units)
    lines, along, what = found["boundaries"], found["along"], _said(found["criterion"])
    flips = [flip for line in lines for flip in line["flips"]]
    if not flips:
        return f"Along {along}, “{what}” flips nowhere."
    if len(lines) == 1 and len(flips) == 1:
        (flip,) = flips
        told = f"“{what}” is met at {along} = {short(flip['meets'])} and no longer at {short(flip['fails'])}{unit}"
        return f"{told}{_seed_by_seed(lines[0], unit)}."
    low, high = min(flip["meets"] for flip in flips), max(flip["meets"] for flip in flips)
    many = f"{count(len(flips), 'time')} in {count(len(lines), 'combination')}"
    return f"Along {along}, “{what}” flips {many}: last met between {short(low)} and {short(high)}{unit}."


def _seed_by_seed(line: Found, unit: str) -> str:
    """Return what the seeds say on their own where there are several: the verdict is that of most of them."""
    fails = _fails(line)
    if len(line["seeds"]) < 2 or not fails:
        return ""
    return f", by most of {len(line['seeds'])} seeds; each on its own fails first at {_range(fails)}{unit}"


def _fails(line: Found) -> list[float]:
    return [flip["fails"] for seed in line["seeds"] for flip in seed["flips"]]


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return short(low) if low == high else f"{short(low)} to {short(high)}"


def _unit(name: str, units: Units) -> str:
    unit = (units or {}).get(name) or unit_of(name)
    return f"{SPACE}{unit}" if unit else ""


def _said(criterion: str) -> str:
    return {"collision": "no collision", "passed": "every criterion"}.get(criterion, label_of(criterion))


def _worst(found: Found, units: Units) -> str:
    goal = "highest" if "highest" in found else "lowest"
    case = found["worst"]
    if not case:
        return f"No run has the figure that was sought, {label_of(found[goal])}."
    where = ", ".join(f"{name} = {short(value)}{_unit(name, units)}" for name, value in case["values"].items())
    return f"The {goal} {label_of(found[goal])} found is {said(found[goal], case[found[goal]])}, at {where}."


def shown(found: Found, units: Units = None) -> Html:
    """Return what was found as a table; `units` are those of the parameters."""
    return sub(
        "What the search found",
        tag("p", sentence(found, units)),
        _boundaries(found, units) if found["search"] == "boundary" else _case(found, units),
    )


def _boundaries(found: Found, units: Units) -> Html:
    lines: Sequence[Found] = found["boundaries"][:MOST]
    names = list(lines[0]["values"]) if lines else []
    ends = (f"{head_of(found['along'], dict(units or {}))}, last met", "first not met", "each seed's first not met")
    heads = [*(head_of(name, dict(units or {})) for name in names), *ends]
    columns = [*(Column(head, True) for head in heads), Column("a run that fails")]
    rows = [row for line in lines for row in _boundary(line, names)]
    return table(columns, rows, "boundaries")


def _boundary(line: Found, names: Sequence[str]) -> list[list[str]]:
    values = [short(line["values"][name]) for name in names]
    own = [flip for seed in line["seeds"] for flip in seed["flips"]]
    fails = _fails(line)
    over = _range(fails) if fails else NONE
    key = next((tag("code", flip["key_fails"]) for flip in own), "")
    if not line["flips"]:
        ends = ("throughout", NONE) if line["meets_first"] else (NONE, "throughout")
        return [[*values, *ends, over, key]]
    return [[*values, short(flip["meets"]), short(flip["fails"]), over, key] for flip in line["flips"]]


def _case(found: Found, units: Units) -> Html:
    case = found["worst"]
    if not case:
        return Html("")
    goal = found["highest"] if "highest" in found else found["lowest"]
    rows = [(head_of(name, dict(units or {})), short(value)) for name, value in case["values"].items()]
    rows += [("seed", short(case["seed"])), (head_of(goal), short(case[goal])), ("outcome", str(case["outcome"]))]
    rows += [("passed", "yes" if case["passed"] else f"no: {case['failed']}"), ("key", tag("code", case["key"]))]
    return table(("what", "worst case"), rows, "worst case")
