"""Draws the arming table as a picture for the documents: `docs/arming.svg`."""

from __future__ import annotations

import math

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import TRANSITIONS

WIDTH, HEIGHT = 650, 460
#: middle of each state's box: a ring, with FAULT inside
PLACES = {
    ArmingState.DISARMED: (90, 230),
    ArmingState.READY: (250, 60),
    ArmingState.ENGAGED: (560, 60),
    ArmingState.STOPPING: (560, 400),
    ArmingState.STOPPED: (250, 400),
    ArmingState.FAULT: (405, 230),
}
BOX = 100, 36  #: of a state
ASIDE = 7  #: of an arrow from the line between two boxes, to its right: one each way has its own
LABEL_ASIDE = 64, 12  #: of a label from its arrow, where another goes the other way: along x and y
LINE = 13  #: from one line of a label to the next
STYLE = """
rect.page{fill:#fff}
rect.state{fill:#eceff1;stroke:#546e7a}
line{stroke:#546e7a;stroke-width:1.2;marker-end:url(#head)}
text{font:12px sans-serif;text-anchor:middle;fill:#263238}
text.event{font-size:11px;fill:#37474f;paint-order:stroke;stroke:#fff;stroke-width:4px}
"""


def arrows() -> dict[tuple[ArmingState, ArmingState], list[str]]:
    """Return the events between each pair of different states."""
    found: dict[tuple[ArmingState, ArmingState], list[str]] = {}
    for before, row in TRANSITIONS.items():
        for event, after in row.items():
            if after is not before:
                found.setdefault((before, after), []).append(event)
    return found


def svg() -> str:
    """Return the picture; each arrow's title says it in words."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#546e7a"/></marker></defs>',
        f'<rect class="page" width="{WIDTH}" height="{HEIGHT}"/>',
    ]
    for (before, after), events in arrows().items():
        parts += _arrow(before, after, events)
    for state, (x, y) in PLACES.items():
        width, height = BOX
        parts.append(
            f'<g id="{state}"><rect class="state" x="{x - width // 2}" y="{y - height // 2}" width="{width}" '
            f'height="{height}" rx="8"/><text x="{x}" y="{y + 4}">{state}</text></g>'
        )
    return "\n".join([*parts, "</svg>", ""])


def _arrow(before: ArmingState, after: ArmingState, events: list[str]) -> list[str]:
    (x0, y0), (x1, y1) = PLACES[before], PLACES[after]
    length = math.hypot(x1 - x0, y1 - y0)
    dx, dy = (x1 - x0) / length, (y1 - y0) / length
    # The y of a picture points down, so (-dy, dx) lies to the right of the way.
    x0, y0, x1, y1 = x0 - ASIDE * dy, y0 + ASIDE * dx, x1 - ASIDE * dy, y1 + ASIDE * dx
    start, end = _to_the_edge(dx, dy, -ASIDE * dy, ASIDE * dx), _to_the_edge(-dx, -dy, -ASIDE * dy, ASIDE * dx)
    x0, y0, x1, y1 = x0 + start * dx, y0 + start * dy, x1 - end * dx, y1 - end * dy
    x, y = (x0 + x1) / 2, (y0 + y1) / 2 - LINE * (len(events) - 1) / 2 + 4
    if before in TRANSITIONS[after].values():
        x, y = x - LABEL_ASIDE[0] * dy, y + LABEL_ASIDE[1] * dx
    words = "".join(f'<tspan x="{x:.0f}" y="{y + LINE * row:.0f}">{event}</tspan>' for row, event in enumerate(events))
    return [
        f"<g><title>{before} to {after}: {', '.join(events)}</title>",
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/><text class="event">{words}</text></g>',
    ]


def _to_the_edge(dx: float, dy: float, x: float, y: float) -> float:
    """Return how far it is from a place in a box, by its middle, to its edge in a direction of length 1."""
    halves = BOX[0] / 2, BOX[1] / 2
    reach = [(math.copysign(half, way) - at) / way for way, at, half in ((dx, x, halves[0]), (dy, y, halves[1])) if way]
    return min(reach)
