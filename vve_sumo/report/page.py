"""The page around what a report says: head, verdict, way through it, sections, footer; all in one file.

Knows HTML and the verdict; not whether it is about a drive or a sweep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from vve_sumo.report.html import Html, escaped, folded, join, section, table, tag
from vve_sumo.report.picture import Picture
from vve_sumo.report.verdict import Verdict

#: what the verdict looks like
LOOKS = {"passed": "verdict good", "FAILED": "verdict bad", "altered": "verdict bad"}


@dataclass(frozen=True, slots=True)
class Part:
    """A section of a page."""

    anchor: str
    head: str
    content: Sequence[str]


@dataclass(frozen=True, slots=True)
class Report:
    """All that a report says."""

    kind: str  #: what it is a report of
    title: str
    verdict: Verdict
    parts: Sequence[Part]
    pictures: Sequence[Picture]
    sources: Sequence[str]  #: whom its data is of

    def page(self) -> str:
        """Return the page."""
        body = join(self._top(), tag("main", *self._sections()), self._footer())
        head = join(
            tag("meta", charset="utf-8"),
            tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
            # A page that may ask for nothing asks for nothing, not even for an icon.
            tag("link", rel="icon", href="data:,"),
            tag("title", f"{self.verdict.word}: {self.title}"),
            tag("style", Html(files(__package__).joinpath("page.css").read_text(encoding="utf-8"))),
        )
        return f"<!DOCTYPE html>\n{tag('html', tag('head', head), tag('body', body), lang='en')}\n"

    def _top(self) -> Html:
        said = tag("p", *_apart(self.verdict.sentences), class_="said")
        verdict = tag(
            "div", tag("p", tag("strong", self.verdict.word)), said, class_=LOOKS.get(self.verdict.word, "verdict")
        )
        way = tag("ul", *(tag("li", tag("a", part.head, href=f"#{part.anchor}")) for part in self._shown()))
        nav = tag("nav", way, aria_label="on this page")
        return tag("header", tag("p", self.kind, class_="kind"), tag("h1", self.title), verdict, nav, class_="top")

    def _shown(self) -> list[Part]:
        return [part for part in self.parts if any(part.content)]

    def _sections(self) -> list[Html]:
        return [section(part.anchor, part.head, *part.content) for part in self._shown()]

    def _footer(self) -> Html:
        made = "Written by vve-sumo from this folder's files alone; nothing on this page was fetched from elsewhere."
        return tag("footer", *(tag("p", line) for line in (made, *self.sources)))


def _apart(sentences: Sequence[str]) -> list[str]:
    return [escaped(f"{sentence} ") for sentence in sentences]


def hashes(told: Sequence[tuple[str, str]], summary: str) -> Html:
    """Return hashes, folded."""
    rows = [(name, tag("span", value, class_="hash")) for name, value in told]
    return folded(summary, table(("of", "SHA-256"), rows, summary)) if rows else Html("")


def commands(told: Sequence[tuple[str, str]]) -> Html:
    """Return command lines, each under what it does."""
    return join(*(join(tag("p", what), tag("pre", tag("code", line), tabindex="0")) for what, line in told))


def versions(told: dict[str, str]) -> Html:
    """Return the versions of what decided how a drive went."""
    return table(("part", "version"), list(told.items()), "versions") if told else Html("")
