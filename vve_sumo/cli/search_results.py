"""What a search found, as a table and lines for people; all of it stands in `search.json`.

Knows what `search` returns; reads and writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.metrics.contacts import BEYOND

if TYPE_CHECKING:
    from rich.table import Table

Found = Mapping[str, Any]

#: combinations that are shown
MAX_SHOWN = 30


def table_of(found: Found, title: str) -> Table | None:
    """Return the table of what was found; None where nothing was."""
    if found["search"] == "boundary":
        return _boundaries(found, title)
    return _case(found, title) if found["worst"] else None


def lines(found: Found, folder: Path) -> Iterator[str]:
    """Return what is to be said besides the table."""
    yield f"{found['runs']} runs" + (f", {found['errors']} with an error" if found["errors"] else "")
    if found["search"] == "boundary":
        several = sum(any(len(one["flips"]) > 1 for one in (line, *line["seeds"])) for line in found["boundaries"])
        if several:
            yield (
                f"{several} of {len(found['boundaries'])} combinations flip more than once: {found['criterion']} is "
                f"not monotone along {found['along']}; a greater scan may find more"
            )
        key = next((flip["key_fails"] for line in found["boundaries"] for flip in _own_flips(line)), "")
    else:
        if found["without"]:
            yield f"{found['without']} of them without that figure"
        key = found["worst"]["key"] if found["worst"] else ""
    if key:
        which = "one that fails, again" if found["search"] == "boundary" else "the same again"
        yield f"{which}: vve-sumo sweep --rerun {folder} {key}"
    yield f"all of it: {folder / 'search.json'}"


def _own_flips(line: Found) -> Iterator[Found]:
    return (flip for seed in line["seeds"] for flip in seed["flips"])


def _boundaries(found: Found, title: str) -> Table:
    names = list(dict.fromkeys(name for line in found["boundaries"] for name in line["values"]))
    repeats = len(found["boundaries"][0]["seeds"])
    apart = ["over the seeds"] if repeats > 1 else []
    along = f"{found['along'].rpartition('.')[2]}"
    columns = (*(name.rpartition(".")[2] for name in names), f"{along} meets", "fails", *apart, "why")
    table = _empty(f"{title}: {found['criterion']} along {found['along']}", columns)
    for line in found["boundaries"][:MAX_SHOWN]:
        values = [_short(line["values"].get(name, "")) for name in names]
        for flip in line["flips"]:
            near = _near(flip, line)
            spread = [_spread([one["fails"] for one in near])] if apart else []
            table.add_row(
                *values, _short(flip["meets"]), _short(flip["fails"]), *spread, near[0]["why"] if near else ""
            )
        if not line["flips"]:
            said = ("throughout", "") if line["meets_first"] else ("", "throughout")
            table.add_row(*values, *said, *(_spread([one["fails"] for one in _own_flips(line)]) for _ in apart), "")
    return table


def _near(flip: Found, line: Found) -> list[Found]:
    """Return the flip of every seed that goes the same way as a pooled one and is nearest to it."""
    rising = flip["fails"] > flip["meets"]
    near = []
    for seed in line["seeds"]:
        alike = [one for one in seed["flips"] if (one["fails"] > one["meets"]) == rising]
        near += sorted(alike, key=lambda one: abs(one["fails"] - flip["fails"]))[:1]
    return near


def _spread(values: list[float]) -> str:
    return f"{_short(min(values))} to {_short(max(values))}" if values else "none"


def _case(found: Found, title: str) -> Table:
    case = found["worst"]
    goal = "highest" if "highest" in found else "lowest"
    table = _empty(f"{title}: {goal} {found[goal]}", ("", "worst case"))
    for name, value in (*case["values"].items(), ("seed", case["seed"])):
        table.add_row(name, _short(value))
    table.add_row(
        found[goal], "a contact" if found[goal] in BEYOND and case["collision"] else _short(case[found[goal]])
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
