"""What a search found, as words and as a table: where a criterion flips, or how bad it can get.

Knows the content of `search.json`; neither the rows nor the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vve_sumo.analysis.report.html import Column, Html, sub, table, tag
from vve_sumo.analysis.report.tables import head_of
from vve_sumo.analysis.report.words import NONE, count, figure_of, said, short

#: combinations that are shown
MOST = 200
Found = Mapping[str, Any]


def sentence(found: Found) -> str:
    """Return what was found, in plain words."""
    return _flipped(found) if found["search"] == "boundary" else _worst(found)


def _flipped(found: Found) -> str:
    lines, along, what = found["boundaries"], found["along"], _said(found["criterion"])
    flips = [flip for line in lines for flip in line["flips"]]
    if not flips:
        return f"Along {along}, “{what}” flips nowhere."
    if len(lines) == 1 and len(flips) == 1:
        (flip,) = flips
        return f"“{what}” is met at {along} = {short(flip['meets'])} and no longer at {short(flip['fails'])}."
    low, high = min(flip["meets"] for flip in flips), max(flip["meets"] for flip in flips)
    many = f"{count(len(flips), 'time')} in {count(len(lines), 'combination')}"
    return f"Along {along}, “{what}” flips {many}: last met between {short(low)} and {short(high)}."


def _said(criterion: str) -> str:
    return {"collision": "no collision", "passed": "every criterion"}.get(criterion, figure_of(criterion).name)


def _worst(found: Found) -> str:
    goal = "highest" if "highest" in found else "lowest"
    case = found["worst"]
    if not case:
        return f"No run has the figure that was sought, {figure_of(found[goal]).name}."
    where = ", ".join(f"{name} = {short(value)}" for name, value in case["values"].items())
    return f"The {goal} {figure_of(found[goal]).name} found is {said(found[goal], case[found[goal]])}, at {where}."


def shown(found: Found) -> Html:
    """Return what was found as a table."""
    return sub(
        "What the search found",
        tag("p", sentence(found)),
        _boundaries(found) if found["search"] == "boundary" else _case(found),
    )


def _boundaries(found: Found) -> Html:
    lines: Sequence[Found] = found["boundaries"][:MOST]
    names = list(lines[0]["values"]) if lines else []
    ends = (f"{found['along']}, last met", "first not met", "over the seeds")
    columns = [*(Column(head, True) for head in (*map(head_of, names), *ends)), Column("a run that fails")]
    rows = [row for line in lines for row in _boundary(line, names)]
    return table(columns, rows, "boundaries")


def _boundary(line: Found, names: Sequence[str]) -> list[list[str]]:
    values = [short(line["values"][name]) for name in names]
    own = [flip for seed in line["seeds"] for flip in seed["flips"]]
    fails = [flip["fails"] for flip in own]
    over = f"{short(min(fails))} to {short(max(fails))}" if fails else NONE
    key = next((tag("code", flip["key_fails"]) for flip in own), "")
    if not line["flips"]:
        ends = ("throughout", NONE) if line["meets_first"] else (NONE, "throughout")
        return [[*values, *ends, over, key]]
    return [[*values, short(flip["meets"]), short(flip["fails"]), over, key] for flip in line["flips"]]


def _case(found: Found) -> Html:
    case = found["worst"]
    if not case:
        return Html("")
    goal = found["highest"] if "highest" in found else found["lowest"]
    rows = [(head_of(name), short(value)) for name, value in case["values"].items()]
    rows += [("seed", short(case["seed"])), (head_of(goal), short(case[goal])), ("outcome", str(case["outcome"]))]
    rows += [("passed", "yes" if case["passed"] else f"no: {case['failed']}"), ("key", tag("code", case["key"]))]
    return table(("what", "worst case"), rows, "worst case")
