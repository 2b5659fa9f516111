"""What the page carries beside its content: style sheet, scripts, and the policy that allows these and nothing else.

Knows the files in `templates/`, and uPlot; neither what a report says nor how its sections are set.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import resources

from markupsafe import Markup

from vve_sumo import uplot
from vve_sumo.report.svg import Drawing
from vve_sumo.report.theme import variables


@dataclass(frozen=True, slots=True)
class Assets:
    """Style sheet, scripts and policy of a page."""

    style: Markup
    scripts: tuple[Markup, ...]

    @property
    def policy(self) -> str:
        """Content security policy: nothing is fetched, and only the page's own style sheet and scripts count."""
        scripts = " ".join(map(_hash, self.scripts))
        own = f"style-src {_hash(self.style)}; script-src {scripts}"
        return f"default-src 'none'; img-src data:; {own}; base-uri 'none'; form-action 'none'"


def assets_of(drawings: Iterable[Drawing], interactive: bool) -> Assets:
    """Return what a page with these drawings carries; the library only where something is `interactive`."""
    shown = list(drawings)
    own = {name: text for one in shown for name, text in one.styles.items() if name not in one.fixed}
    rules = "\n".join(dict.fromkeys(rule for one in shown for rule in one.rules()))
    parts = [_file("page.css"), variables(own.values()), rules, *([uplot.read(uplot.STYLE)] if interactive else [])]
    library = [f"/*\n{uplot.read(uplot.LICENCE)}*/\n{uplot.read(uplot.SCRIPT)}"] if interactive else []
    return Assets(Markup("\n".join(parts)), tuple(map(Markup, [*library, _file("page.js")])))


def _hash(content: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


@cache
def _file(name: str) -> str:
    return (resources.files(__package__) / "templates" / name).read_text(encoding="utf-8")
