"""Draws the control structure of the hazard analysis: `docs/safety/control_structure.svg`."""

from __future__ import annotations

import math
import textwrap

from vve_sumo.safety.hazard_trace import CAR, Link, hazard_trace

COLUMN, ROW = 320, 130  #: from one box to the next
BOX = 180, 50
LEFT, TOP = 120, 50  #: middle of the first box
CAR_AT = 1, 3  #: column and row of the controlled process
WORDS_IN_LINE = 26
ASIDE = 9  #: of an arrow from the line between two boxes, where another goes the other way
STYLE = """
rect.page{fill:#fff}
rect.person{fill:#fff3e0;stroke:#8d6e63}
rect.program{fill:#eceff1;stroke:#546e7a}
rect.car{fill:#e8f5e9;stroke:#558b2f}
line{stroke:#546e7a;stroke-width:1.2;marker-end:url(#head)}
text{font:12px sans-serif;text-anchor:middle;fill:#263238}
text.what{font-size:11px;fill:#37474f;paint-order:stroke;stroke:#fff;stroke-width:4px}
"""


def svg() -> str:
    """Return the picture: a box a controller, an arrow for what goes from one to another."""
    trace = hazard_trace()
    places = {one.id: (LEFT + one.at[0] * COLUMN, TOP + one.at[1] * ROW) for one in trace.controllers}
    places[CAR] = LEFT + CAR_AT[0] * COLUMN, TOP + CAR_AT[1] * ROW
    width = max(x for x, _y in places.values()) + LEFT
    height = max(y for _x, y in places.values()) + TOP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#546e7a"/></marker></defs>',
        f'<rect class="page" width="{width}" height="{height}"/>',
    ]
    pairs = {(link.from_, link.to) for link in trace.links}
    for link in trace.links:
        parts += _arrow(link, places, both=(link.to, link.from_) in pairs)
    names = {one.id: (one.name, "person" if one.kind == "person" else "program") for one in trace.controllers}
    names[CAR] = "Car in the lot", "car"
    for name, (x, y) in places.items():
        parts.append(_box(name, x, y, *names[name]))
    return "\n".join([*parts, "</svg>", ""])


def _box(name: str, x: int, y: int, title: str, kind: str) -> str:
    lines = textwrap.wrap(title, WORDS_IN_LINE)
    first = y + 4 - 7 * (len(lines) - 1)
    words = "".join(f'<tspan x="{x}" y="{first + 14 * row}">{line}</tspan>' for row, line in enumerate(lines))
    box = (
        f'<rect class="{kind}" x="{x - BOX[0] // 2}" y="{y - BOX[1] // 2}" width="{BOX[0]}" height="{BOX[1]}" rx="6"/>'
    )
    return f'<g id="{name}">{box}<text>{words}</text></g>'


def _arrow(link: Link, places: dict[str, tuple[int, int]], *, both: bool) -> list[str]:
    (x0, y0), (x1, y1) = places[link.from_], places[link.to]
    length = math.hypot(x1 - x0, y1 - y0)
    dx, dy = (x1 - x0) / length, (y1 - y0) / length
    # The y of a picture points down, so (-dy, dx) lies to the right of the way.
    aside = ASIDE if both else 0
    ox, oy = -aside * dy, aside * dx
    reach = _reach(dx, dy)
    a, b = (x0 + ox + reach * dx, y0 + oy + reach * dy), (x1 + ox - reach * dx, y1 + oy - reach * dy)
    # On crossing ways the words stand nearer to where the arrow begins.
    share = 0.5 if not both else 0.4
    x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    x, y = x + (5.0 * ox if abs(dy) > abs(dx) else 0.0), y + (1.2 * oy if abs(dx) > abs(dy) else 0.0) + 4
    lines = textwrap.wrap(link.what, 18)
    words = "".join(
        f'<tspan x="{x:.0f}" y="{y + 12 * (row - (len(lines) - 1) / 2):.0f}">{line}</tspan>'
        for row, line in enumerate(lines)
    )
    return [
        f"<g><title>{link.from_} to {link.to}: {link.what}</title>",
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/><text class="what">{words}</text></g>',
    ]


def _reach(dx: float, dy: float) -> float:
    """Return how far it is from the middle of a box to its edge in a direction of length 1."""
    return min(half / abs(way) for way, half in ((dx, BOX[0] / 2), (dy, BOX[1] / 2)) if way)
