"""The result of a search as a table and lines for people; `search.json` has all of it.

Knows what `search` returns; reads and writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.metrics.contacts import BEYOND

if TYPE_CHECKING:
    from rich.table import Table

SearchResult = Mapping[str, Any]

#: combinations that are shown
MAX_SHOWN = 30


def table_of(result: SearchResult, title: str) -> Table | None:
    """Return the table of a search's result; None where nothing was found."""
    if result["search"] == "boundary":
        return _boundaries(result, title)
    return _worst_case(result, title) if result["worst"] else None


def lines(result: SearchResult, folder: Path) -> Iterator[str]:
    """Return the lines to print below the table."""
    yield f"{result['runs']} runs" + (f", {result['errors']} with an error" if result["errors"] else "")
    if result["search"] == "boundary":
        several = sum(any(len(one["flips"]) > 1 for one in (line, *line["seeds"])) for line in result["boundaries"])
        if several:
            yield (
                f"{several} of {len(result['boundaries'])} combinations flip more than once: {result['criterion']} is "
                f"not monotone along {result['along']}; a larger scan may find more"
            )
        key = next((flip["key_fails"] for line in result["boundaries"] for flip in _own_flips(line)), "")
    else:
        if result["without"]:
            yield f"{result['without']} of them without that metric"
        key = result["worst"]["key"] if result["worst"] else ""
    if key:
        which = "rerun a failing run" if result["search"] == "boundary" else "rerun the worst case"
        yield f"{which}: vve-sumo sweep --rerun {folder} {key}"
    yield f"full result: {folder / 'search.json'}"


def _own_flips(line: SearchResult) -> Iterator[SearchResult]:
    return (flip for seed in line["seeds"] for flip in seed["flips"])


def _boundaries(result: SearchResult, title: str) -> Table:
    names = list(dict.fromkeys(name for line in result["boundaries"] for name in line["values"]))
    repeats = len(result["boundaries"][0]["seeds"])
    spread_head = ["over the seeds"] if repeats > 1 else []
    along = f"{result['along'].rpartition('.')[2]}"
    columns = (*(name.rpartition(".")[2] for name in names), f"{along} meets", "fails", *spread_head, "why")
    table = _empty(f"{title}: {result['criterion']} along {result['along']}", columns)
    for line in result["boundaries"][:MAX_SHOWN]:
        values = [_short(line["values"].get(name, "")) for name in names]
        for flip in line["flips"]:
            near = _near(flip, line)
            spread = [_spread([one["fails"] for one in near])] if spread_head else []
            table.add_row(
                *values, _short(flip["meets"]), _short(flip["fails"]), *spread, near[0]["why"] if near else ""
            )
        if not line["flips"]:
            ends = ("throughout", "") if line["meets_first"] else ("", "throughout")
            table.add_row(
                *values, *ends, *(_spread([one["fails"] for one in _own_flips(line)]) for _ in spread_head), ""
            )
    return table


def _near(flip: SearchResult, line: SearchResult) -> list[SearchResult]:
    """Return the flip of every seed that goes the same way as a pooled one and is nearest to it."""
    rising = flip["fails"] > flip["meets"]
    near = []
    for seed in line["seeds"]:
        alike = [one for one in seed["flips"] if (one["fails"] > one["meets"]) == rising]
        near += sorted(alike, key=lambda one: abs(one["fails"] - flip["fails"]))[:1]
    return near


def _spread(values: list[float]) -> str:
    return f"{_short(min(values))} to {_short(max(values))}" if values else "none"


def _worst_case(result: SearchResult, title: str) -> Table:
    case = result["worst"]
    goal = "highest" if "highest" in result else "lowest"
    table = _empty(f"{title}: {goal} {result[goal]}", ("", "worst case"))
    for name, value in (*case["values"].items(), ("seed", case["seed"])):
        table.add_row(name, _short(value))
    table.add_row(
        result[goal], "a contact" if result[goal] in BEYOND and case["collision"] else _short(case[result[goal]])
    )
    table.add_row("outcome", case["outcome"])
    if case["collision"]:
        table.add_row("impact_speed_mps", _short(case["impact_speed_mps"]))
    table.add_row("passed", "yes" if case["passed"] else f"no: {case['failed']}")
    return table


def _empty(title: str, columns: tuple[str, ...]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for number, name in enumerate(columns):
        last = number == len(columns) - 1
        table.add_column(name, justify="left" if last else "right", overflow="fold")
    return table


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
