"""A plot on the page and beside it: a PNG file's bytes, a caption and a text for those who do not see it.

Knows matplotlib figures; not what they show.
"""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: CSS counts 96 of its dots to an inch
CSS_DOTS_PER_INCH = 96


@dataclass(frozen=True, slots=True)
class Picture:
    """A plot, drawn."""

    name: str  #: of its file, without the ending
    png: bytes
    width: int  #: on paper [CSS dots]
    height: int  #: on paper [CSS dots]
    alt: str  #: what it is, in a line
    caption: str  #: what one sees in it

    @property
    def data_uri(self) -> str:
        """The picture as an address that needs no other file."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode()


def picture_of(figure: Figure, name: str, alt: str, caption: str) -> Picture:
    """Return a figure as a picture; the same figure gives the same bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None}, facecolor="white")
    width, height = (round(CSS_DOTS_PER_INCH * float(inches)) for inches in figure.get_size_inches())
    return Picture(name, out.getvalue(), width, height, alt, caption)
