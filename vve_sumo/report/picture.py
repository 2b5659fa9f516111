"""A plot as it stands on the page and beside it: a PNG file's bytes, a caption and words for those who do not see it.

Knows matplotlib figures; not what they show.
"""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vve_sumo.report.html import Html, tag

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: CSS counts 96 of its dots to an inch
CSS_DOTS_PER_INCH = 96
#: a picture that is wider than this stays wider on a phone as well, where it scrolls in its own box [CSS dots]
WIDE = 900


@dataclass(frozen=True, slots=True)
class Picture:
    """A plot, drawn."""

    name: str  #: of its file, without the ending
    png: bytes
    size: tuple[int, int]  #: width and height on paper [CSS dots]
    alt: str  #: what it is, in a line
    caption: str  #: what one sees in it

    def html(self) -> Html:
        """Return the picture as a part of a page that needs no other file."""
        width, height = self.size
        source = "data:image/png;base64," + base64.b64encode(self.png).decode()
        kind = {} if width > WIDE else {"class": "narrow"}
        image = tag("img", src=source, alt=self.alt, width=str(width), height=str(height), **kind)
        paper = tag("div", image, class_="paper", tabindex="0", role="region", aria_label=f"plot: {self.alt}")
        return tag("figure", paper, tag("figcaption", self.caption))


def drawn(figure: Figure, name: str, alt: str, caption: str) -> Picture:
    """Return a figure as a picture; the same figure gives the same bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None}, facecolor="white")
    width, height = (round(CSS_DOTS_PER_INCH * float(inches)) for inches in figure.get_size_inches())
    return Picture(name, out.getvalue(), (width, height), alt, caption)
