"""The page of a report: its content set by a template, all in one file.

Knows the templates' names; neither how they set the content nor whether it is about a drive or a sweep.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from vve_sumo.report.picture import Picture
from vve_sumo.report.tables import Cell, Table
from vve_sumo.report.verdict import Verdict

#: no page may hold these: control characters, halves of characters, and marks that turn the reading direction round
_UNFIT = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)


@dataclass(frozen=True, slots=True)
class Report:
    """All that a report says."""

    template: str  #: of its sections
    kind: str  #: what it is a report of
    title: str
    verdict: Verdict
    pictures: Sequence[Picture]  #: the first one stands at the top of what happened
    sources: Sequence[str]  #: whom its data is of
    content: Mapping[str, object]  #: of its sections, by the names that the template uses

    def page(self) -> str:
        """Return the page."""
        return _UNFIT.sub("\ufffd", _templates().get_template(self.template).render(self.content, report=self))


@cache
def _templates() -> Environment:
    """Return the templates: every text is escaped as it is set, and a name that the content lacks is an error."""
    return Environment(
        loader=PackageLoader(__package__),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def hashes(digests: Sequence[tuple[str, str]], name: str) -> Table:
    """Return files or parts with their hashes."""
    return Table(name, ("of", "SHA-256"), [(of, Cell(digest, kind="hash")) for of, digest in digests if digest])


def versions(parts: Mapping[str, str]) -> Table:
    """Return the versions of what decided how a drive went."""
    return Table("versions", ("part", "version"), list(parts.items()))
