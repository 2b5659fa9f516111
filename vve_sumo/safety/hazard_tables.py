"""The hazard analysis as tables of a report's page.

Knows cells and columns; reads no rig.
"""

from __future__ import annotations

from vve_sumo.report.tables import Cell, ReportTable
from vve_sumo.safety.hazard_trace import PERSON, UnsafeAction, hazard_trace


def hazards() -> ReportTable:
    """Return the hazards with the losses that they lead to, and the constraints that hold against them."""
    trace = hazard_trace()
    losses = {one.id: one.text for one in trace.losses}
    rows = [
        (
            hazard.id,
            hazard.text,
            " ".join(losses[name] for name in hazard.losses),
            ", ".join(one.id for one in trace.constraints if hazard.id in one.hazards),
        )
        for hazard in trace.hazards
    ]
    return ReportTable("hazards", ("", "hazard", "may come to", "held by"), rows)


def constraints() -> ReportTable:
    """Return what the whole system has to hold."""
    rows = [(one.id, one.text, ", ".join(one.hazards)) for one in hazard_trace().constraints]
    return ReportTable("constraints", ("", "what has to hold", "against"), rows)


def actions() -> ReportTable:
    """Return every unsafe control action with what holds it and what shows that."""
    trace = hazard_trace()
    rows = [
        (
            Cell(one.id, kind="code"),
            trace.name_of(one.controller),
            f"{one.action}, {one.way}: {one.text}",
            ", ".join(one.hazards),
            ", ".join(map(_holder, one.held)),
            _shown(one),
        )
        for one in trace.actions
    ]
    heads = ("", "who", "unsafe control action", "leads to", "held by", "shown by")
    return ReportTable("unsafe control actions", heads, rows)


def _holder(name: str) -> str:
    return f"the {name.removeprefix(PERSON)}" if name.startswith(PERSON) else name.removeprefix("vve_sumo.")


def _shown(action: UnsafeAction) -> str:
    """Return how many tests show it, and what else does: the page of the documentation names each."""
    tests = [name for name in action.shown if "::" in name]
    others = [name.replace(":", " ", 1) for name in action.shown if "::" not in name]
    words = [f"{len(tests)} {'test' if len(tests) == 1 else 'tests'}"] if tests else []
    return ", ".join([*words, *others, *(["a drill"] if action.drill else [])])


def residual_risks() -> ReportTable:
    """Return the residual risks."""
    rows = [(one.id, _plain(one.text), _plain(one.remains)) for one in hazard_trace().residuals]
    return ReportTable("residual risks", ("", "what is known", "what remains"), rows)


def _plain(markdown: str) -> str:
    """Return a text without the targets of its links and without backticks."""
    parts = markdown.replace("`", "").split("](")
    return parts[0].replace("[", "") + "".join(part.partition(")")[2].replace("[", "") for part in parts[1:])
