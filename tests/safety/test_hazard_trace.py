"""The hazard analysis leads from losses to code and tests that are there, and leaves out nothing that stops the car."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import pytest

from tests.conftest import REPOSITORY
from tests.live.matrix import MATRIX
from tests.safety.sources import has_anchor, is_code, is_test
from vve_sumo.certify import cases
from vve_sumo.drive import reasons
from vve_sumo.hunt import invariants
from vve_sumo.people import report_gate
from vve_sumo.safety.briefing import briefing
from vve_sumo.safety.hazard_trace import CAR, PERSON, SHOWN_BY, HazardTrace, UnsafeAction, hazard_trace
from vve_sumo.stations import reports, station_gate

TRACE = hazard_trace()
#: what stands after each word of `SHOWN_BY`
KNOWN = {
    "matrix:": {row.name for row in MATRIX},
    "hunt:": {judge.name for judge in invariants.ALL},
    "certify:": set(cases.NAMES),
}
CODES = {*reasons.ALL, *report_gate.REASONS, *station_gate.REASONS, *reports.REASONS}


def complaints(trace: HazardTrace) -> list[str]:
    """Return what is wrong with an analysis, a line each."""
    return [*_of_ids(trace), *_of_what_is_left_out(trace), *(line for one in trace.actions for line in _of(one, trace))]


def _of_ids(trace: HazardTrace) -> Iterable[str]:
    every = (trace.losses, trace.hazards, trace.constraints, trace.controllers, trace.actions, trace.residuals)
    counts = Counter(one.id for kind in every for one in kind)
    yield from (f"{name} stands {count} times" for name, count in counts.items() if count > 1)
    known = {*counts, CAR}
    for link in trace.links:
        yield from (f"link to {end}, which is not there" for end in (link.from_, link.to) if end not in known)
    for above, kind in (("losses", trace.hazards), ("hazards", trace.constraints), ("hazards", trace.residuals)):
        for one in kind:
            names = getattr(one, above)
            yield from (f"{one.id} names {name}, which is not there" for name in names if name not in counts)
            if not names:
                yield f"{one.id} names none of the {above}"


def _of_what_is_left_out(trace: HazardTrace) -> Iterable[str]:
    """Yield a line for each loss, hazard, constraint, controller, row, invariant and code that nothing names."""
    hazards = {name for one in trace.actions for name in one.hazards}
    used = {
        "loss": ({one.id for one in trace.losses}, {name for one in trace.hazards for name in one.losses}),
        "hazard": ({one.id for one in trace.hazards}, hazards),
        "held hazard": ({one.id for one in trace.hazards}, {n for one in trace.constraints for n in one.hazards}),
        "constraint": ({one.id for one in trace.constraints}, {n for one in trace.actions for n in one.constraints}),
        "controller": ({one.id for one in trace.controllers}, {one.controller for one in trace.actions}),
        "reason code": (CODES, {code for one in trace.actions for code in one.codes}),
    }
    shown = {name for one in trace.actions for name in one.shown}
    for word in ("matrix:", "hunt:"):
        used[word] = (KNOWN[word], {name.removeprefix(word) for name in shown if name.startswith(word)})
    for what, (there, named) in used.items():
        yield from (f"{what} {name}: no action names it" for name in sorted(there - named))


def _of(action: UnsafeAction, trace: HazardTrace) -> Iterable[str]:
    """Yield a line for everything that an action names and that is not there."""
    names = {
        "controller": ({one.id for one in trace.controllers}, [action.controller]),
        "hazard": ({one.id for one in trace.hazards}, action.hazards),
        "constraint": ({one.id for one in trace.constraints}, action.constraints),
        "reason code": (CODES, action.codes),
        "role": ({f"{PERSON}{one.id}" for one in briefing().roles}, _persons(action)),
    }
    for what, (there, named) in names.items():
        yield from (f"{action.id}: there is no {what} {name}" for name in named if name not in there)
        if not named and what in ("hazard", "constraint"):
            yield f"{action.id} names no {what}"
    code = [name for name in action.held if not name.startswith(PERSON)]
    yield from (f"{action.id}: there is no code {name}" for name in code if not is_code(name))
    yield from (f"{action.id}: nothing shows as {name}" for name in action.shown if not _is_shown(name))
    if not action.held:
        yield f"{action.id} is held by nobody"
    if not action.shown and action.drill is None:
        yield f"{action.id} is shown by nothing, and no drill has a person try it"
    if action.drill is not None and not has_anchor(action.drill):
        yield f"{action.id}: there is no place {action.drill}"
    constrained = {name for one in trace.constraints if one.id in action.constraints for name in one.hazards}
    yield from (f"{action.id}: no constraint of it holds {name}" for name in action.hazards if name not in constrained)


def _persons(action: UnsafeAction) -> list[str]:
    return [name for name in action.held if name.startswith(PERSON)]


def _is_shown(name: str) -> bool:
    word = next((word for word in SHOWN_BY if name.startswith(word)), None)
    return is_test(name) if word is None else name.removeprefix(word) in KNOWN[word]


def test_every_hazard_is_held_and_shown_and_nothing_that_stops_the_car_is_left_out() -> None:
    assert complaints(TRACE) == []


def without(**changes: object) -> HazardTrace:
    return TRACE.model_copy(update=changes)


FIRST = TRACE.actions[0]


@pytest.mark.parametrize(
    ("trace", "said"),
    [
        (without(hazards=(*TRACE.hazards, TRACE.hazards[0].model_copy(update={"id": "H99"}))), "hazard H99"),
        (without(losses=(*TRACE.losses, TRACE.losses[0].model_copy(update={"id": "L99"}))), "loss L99"),
        (without(actions=tuple(a.model_copy(update={"codes": ()}) for a in TRACE.actions)), "reason code timer_gap"),
        (without(actions=tuple(a.model_copy(update={"shown": ()}) for a in TRACE.actions)), "matrix: drive_killed"),
        (without(actions=tuple(a.model_copy(update={"shown": ()}) for a in TRACE.actions)), "hunt: inside_lot"),
        (without(actions=(FIRST.model_copy(update={"held": ("vve_sumo.bus:Horse",)}),)), "no code vve_sumo.bus:Horse"),
        (without(actions=(FIRST.model_copy(update={"held": ("vve_sumo.horse:Bus",)}),)), "no code vve_sumo.horse:Bus"),
        (without(actions=(FIRST.model_copy(update={"held": ("person:horse",)}),)), "no role person:horse"),
        (without(actions=(FIRST.model_copy(update={"held": ()}),)), "held by nobody"),
        (without(actions=(FIRST.model_copy(update={"shown": ("tests/test_bus.py::test_a",)}),)), "test_a"),
        (without(actions=(FIRST.model_copy(update={"shown": ("matrix:horse",)}),)), "matrix:horse"),
        (without(actions=(FIRST.model_copy(update={"shown": ()}),)), "shown by nothing"),
        (without(actions=(FIRST.model_copy(update={"drill": "docs/live.md#horse"}),)), "docs/live.md#horse"),
        (without(actions=(FIRST.model_copy(update={"codes": ("horse",)}),)), "no reason code horse"),
        (without(actions=(FIRST, FIRST)), "GW-1 stands 2 times"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_missing_is_named(trace: HazardTrace, said: str) -> None:
    assert any(said in line for line in complaints(trace))


@pytest.mark.parametrize("risk", TRACE.residuals, ids=lambda risk: risk.id)
def test_the_figures_of_a_residual_risk_stand_in_its_source(risk: object) -> None:
    text = (REPOSITORY / risk.source).read_text(encoding="utf-8")  # type: ignore[attr-defined]
    assert [figure for figure in risk.figures if figure not in text] == []  # type: ignore[attr-defined]
