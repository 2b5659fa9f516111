"""The safety case's tables for docs/safety/, from the data that the dossier uses too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from vve_sumo.safety.briefing import Conditional, Item, briefing
from vve_sumo.safety.hazard_trace import PERSON, SHOWN_BY, UnsafeAction, hazard_trace


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def losses() -> str:
    """The losses."""
    return _table(("", "loss"), ((one.id, one.text) for one in hazard_trace().losses))


def hazards() -> str:
    """The hazards, each with its losses and the actions that lead to it."""
    trace = hazard_trace()
    rows = [
        (one.id, one.text, ", ".join(one.losses), ", ".join(a.id for a in trace.actions if one.id in a.hazards))
        for one in trace.hazards
    ]
    return _table(("", "hazard", "losses", "unsafe control actions"), rows)


def constraints() -> str:
    """The constraints, each with its hazards."""
    rows = ((one.id, one.text, ", ".join(one.hazards)) for one in hazard_trace().constraints)
    return _table(("", "constraint", "hazards"), rows)


def actions() -> str:
    """The unsafe control actions, a section a controller."""
    trace, parts = hazard_trace(), []
    for controller in trace.controllers:
        who = "A person, who" if controller.kind == "person" else f"A {controller.kind}, which"
        own = [one for one in trace.actions if one.controller == controller.id]
        parts += [f"### {controller.name}", f"{who} {controller.does}.", *map(_block, own)]
    return "\n\n".join(parts)


def _block(action: UnsafeAction) -> str:
    leads = f"{', '.join(action.hazards)} ({', '.join(action.constraints)})"
    shown = [*map(_shown, action.shown), *([_drill(action.drill)] if action.drill else [])]
    lines = [
        f"**{action.id}** · {action.action}, *{action.way}*: {action.text} Leads to {leads}.",
        "",
        f"* held by {', '.join(map(_holder, action.held))}",
        f"* shown by {', '.join(shown)}",
    ]
    if action.codes:
        lines.append(f"* reason codes {', '.join(f'`{code}`' for code in action.codes)}")
    return "\n".join(lines)


def _holder(name: str) -> str:
    if name.startswith(PERSON):
        return f"[{name.removeprefix(PERSON)}](roles.md)"
    return f"`{name.removeprefix('vve_sumo.')}`"


def _shown(name: str) -> str:
    for word, page in SHOWN_BY.items():
        if name.startswith(word):
            return f"[{word.rstrip(':')}](../{page}) `{name.removeprefix(word)}`"
    return f"`{name}`"


def _drill(place: str) -> str:
    page, _, anchor = place.removeprefix("docs/").partition("#")
    page = page.removeprefix("safety/") if page.startswith("safety/") else f"../{page}"
    return f"drill: [{anchor.replace('-', ' ')}]({page}#{anchor})"


def residual_risks() -> str:
    """The residual risks."""
    rows = (
        (one.id, one.text, f"[{one.source.rpartition('/')[2]}](../{one.source.removeprefix('docs/')})", one.remains,
         ", ".join(one.hazards))
        for one in hazard_trace().residuals
    )  # fmt: skip
    return _table(("", "what is known", "from", "what remains", "hazards"), rows)


def roles() -> str:
    """The roles."""
    rows = ((f"**{one.title}**{_when(one)}", one.does, one.must_not, one.knows) for one in briefing().roles)
    return _table(("role", "does", "never", "knows"), rows)


def checklists() -> str:
    """Every checklist with all its lines."""
    return "\n\n".join(
        f"### {one.title}\n\n" + "\n".join(f"* {item.text}{_when(item)}" for item in one.items)
        for one in briefing().checklists
    )


def _when(one: Conditional | Item) -> str:
    words = [*one.if_, *(f"not {word}" for word in one.unless)]
    return f" ({', '.join(words)})" if words else ""
