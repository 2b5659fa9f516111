"""A plot on the page and beside it: its drawing, a PNG file's bytes, a caption, a text for those who do not see it.

Knows matplotlib figures; not what they show.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vve_sumo.report.glossary import Term, used_in
from vve_sumo.report.svg import Drawing, drawing_of
from vve_sumo.report.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: of the PNG files: a harder compression takes three times as long and saves a tenth
PNG = {"compress_level": 3}


@dataclass(frozen=True, slots=True)
class DrawnPlot:
    """A plot, drawn."""

    name: str  #: of its file, without the ending
    png: bytes
    drawing: Drawing
    alt: str  #: what it is, in a line
    caption: str  #: what one sees in it

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms that stand in the picture or its caption."""
        return used_in((*self.drawing.texts, self.caption))


def picture_of(figure: Figure, name: str, alt: str, caption: str) -> DrawnPlot:
    """Return a figure as a picture; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(printable(text.get_text()))  # half a character in a name is more than matplotlib can draw
    out = io.BytesIO()
    # Not by `savefig`, which draws everything twice.
    canvas = FigureCanvasAgg(figure)
    canvas.print_png(out, metadata={"Software": None}, pil_kwargs=PNG)  # type: ignore[no-untyped-call]
    return DrawnPlot(name, out.getvalue(), drawing_of(figure, name, alt), alt, caption)
