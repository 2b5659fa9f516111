"""Builds HTML from small functions; text is escaped as it goes in, so that no caller can forget it.

Knows the language alone: neither what a page is about nor how it looks.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

#: no page may hold these: control characters, halves of characters, and marks that turn the reading direction round
_UNFIT = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)
_EMPTY = frozenset({"img", "link", "meta"})


class Html(str):
    """Text that is HTML already; every other text is escaped before it becomes a part of a page."""

    __slots__ = ()


class Column(NamedTuple):
    """A column of a table."""

    head: str
    number: bool = False  #: whether it holds numbers, which stand to the right


def escaped(text: str) -> Html:
    """Return a text as HTML; what is HTML already stays as it is."""
    return text if isinstance(text, Html) else Html(html.escape(_UNFIT.sub("\ufffd", text), quote=True))


def join(*parts: str) -> Html:
    """Return parts one after the other."""
    return Html("".join(map(escaped, parts)))


def tag(name: str, /, *content: str, **attributes: str) -> Html:
    """Return an element; of an attribute's name a trailing underscore is dropped (`class_`), others are hyphens."""
    said = "".join(f' {key.rstrip("_").replace("_", "-")}="{escaped(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{said}>") if name in _EMPTY else Html(f"<{name}{said}>{join(*content)}</{name}>")


def paragraphs(text: str) -> Html:
    """Return a text whose empty lines part paragraphs."""
    return join(*(tag("p", part.strip()) for part in re.split(r"\n\s*\n", text) if part.strip()))


def table(columns: Sequence[Column | str], rows: Iterable[Sequence[str]], name: str) -> Html:
    """Return a table in a box of its own, which scrolls where the table is wider than the page; the first cell of a
    row is its head, `name` what it is called by those who do not see it.
    """
    wanted = [Column(one) if isinstance(one, str) else one for one in columns]
    classes = [{"class": "number"} if one.number else {} for one in wanted]
    heads = (tag("th", one.head, scope="col", **kind) for one, kind in zip(wanted, classes, strict=True))
    lines = (_line(row, classes) for row in rows)
    whole = tag("table", tag("thead", tag("tr", *heads)), tag("tbody", *lines))
    return tag("div", whole, class_="scroll", role="region", tabindex="0", aria_label=name)


def _line(row: Sequence[str], classes: Sequence[dict[str, str]]) -> Html:
    cells = zip(row, classes, strict=True)
    return tag("tr", *(tag("td" if n else "th", cell, **kind, **_scope(n)) for n, (cell, kind) in enumerate(cells)))


def _scope(number: int) -> dict[str, str]:
    return {} if number else {"scope": "row"}


def folded(summary: str, *content: str, name: str = "details") -> Html:
    """Return content that stands folded under a summary until somebody unfolds it."""
    return tag(name, tag("summary", summary), *content)


def section(anchor: str, head: str, *content: str) -> Html:
    """Return a section under a heading of the second level; nothing where it has no content."""
    inside = [part for part in content if part]
    return tag("section", tag("h2", head), *inside, id=anchor) if inside else Html("")


def sub(head: str, *content: str) -> Html:
    """Return content under a heading of the third level; nothing where there is none."""
    inside = [part for part in content if part]
    return join(tag("h3", head), *inside) if inside else Html("")
