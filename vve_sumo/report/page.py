"""The page of a report: its content set by a template, all in one file.

Knows the templates' names; neither how they set the content nor whether it is about a drive or a sweep.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from vve_sumo.metrics.table import with_labels
from vve_sumo.report.assets import assets_of
from vve_sumo.report.key_figures import KeyFigure
from vve_sumo.report.picture import DrawnPlot
from vve_sumo.report.tables import Cell, ReportTable
from vve_sumo.report.text import printable
from vve_sumo.report.verdict import ReportVerdict


@dataclass(frozen=True, slots=True)
class ReportPage:
    """All that a report says."""

    template: str  #: of its sections
    kind: str  #: what it is a report of
    title: str
    verdict: ReportVerdict
    key_figures: Sequence[KeyFigure]  #: beside the verdict
    pictures: Sequence[DrawnPlot]  #: the first one stands beside the verdict
    sources: Sequence[str]  #: whom its data is of
    content: Mapping[str, object]  #: of its sections, by the names that the template uses
    data: Mapping[str, Any] | None = None  #: what `page.js` draws; None for nothing

    def page(self) -> str:
        """Return the page."""
        assets = assets_of((picture.drawing for picture in self.pictures), interactive=self.data is not None)
        return printable(_templates().get_template(self.template).render(self.content, report=self, assets=assets))


@cache
def _templates() -> Environment:
    """Return the templates: every text is escaped as it is set, and a name that the content lacks is an error."""
    environment = Environment(
        loader=PackageLoader(__package__),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["with_labels"] = with_labels
    # As characters, not as escapes, so that `printable` sees them.
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    return environment


def hashes(digests: Sequence[tuple[str, str]], name: str) -> ReportTable:
    """Return files or parts with their hashes."""
    return ReportTable(name, ("of", "SHA-256"), [(of, Cell(digest, kind="hash")) for of, digest in digests if digest])


def versions(parts: Mapping[str, str]) -> ReportTable:
    """Return the versions of what decided how a drive went."""
    return ReportTable("versions", ("part", "version"), list(parts.items()))
