"""The house style of every plot: page, letters, colours with their strokes and marks, words with their units.

Knows names of columns; it must not know what a plot is about, a record or a dataset.
"""

from __future__ import annotations

import contextlib
import io
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vve_sumo.plotting.page import ACTOR, ALARM, EGO, EGO_PALE, INK, OBSTACLE, QUIET, STYLE

#: of a plot; at half of it, a paper's column, the letters are still 5 points high [inch]
WIDTH: Final = 7.0
DOTS_PER_INCH: Final = 150
#: characters of a title in a line, for each inch of the page
TITLE: Final = 9.4
#: entries of a legend in a line, if not said; fewer where they are long
IN_A_LINE: Final = 3
#: of a legend: a letter, and what an entry takes beside its letters; of axes: what stands beside them [inch]
LETTER, ENTRY, BESIDE = 0.083, 0.65, 0.9


class SeriesStyle(NamedTuple):
    """How one of several things is drawn; each part of it alone tells them apart."""

    colour: str
    stroke: Any  #: of a line
    mark: str  #: of points


#: first to last; in grey, strokes and marks still differ
LINE_STYLES: Final = (
    SeriesStyle(EGO, "-", "o"),
    SeriesStyle(OBSTACLE, (0, (5, 2)), "s"),
    SeriesStyle(ACTOR, (0, (6, 2, 1.5, 2)), "^"),
    SeriesStyle(INK, (0, (1.2, 1.5)), "D"),
    SeriesStyle(ALARM, (0, (6, 2, 1.5, 2, 1.5, 2)), "v"),
    SeriesStyle(EGO_PALE, (0, (9, 3)), "P"),
)
FIRST, SECOND, THIRD = LINE_STYLES[:3]
#: widths of lines that lie upon each other: the first shows on both sides of the next
UNDER, OVER = 2.8, 1.4
#: of what is not to be crossed: limits, thresholds, budgets
LIMIT: Final[dict[str, Any]] = {"color": INK, "linewidth": 1.1, "linestyle": (0, (2, 2))}
#: of what went wrong
BAD: Final[dict[str, Any]] = {
    "marker": "X",
    "color": OBSTACLE,
    "markeredgecolor": INK,
    "markeredgewidth": 0.6,
    "markersize": 8.0,
    "linestyle": "",
}


class Picture(Figure):
    """A figure that keeps the house style whenever it is drawn, and that Jupyter shows without pyplot."""

    def draw(self, renderer: Any) -> None:
        """Draw it; ticks that are made only now take their letters from the style."""
        with mpl.rc_context(STYLE):
            super().draw(renderer)

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        """Write it; a PDF takes its fonts from the style once everything is drawn."""
        with mpl.rc_context(STYLE):
            super().savefig(fname, **kwargs)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


@contextlib.contextmanager
def page(width: float = WIDTH, height: float = 4.2, *, arranged: bool = True) -> Iterator[Picture]:
    """Give an empty figure of a size [inch] to draw into in the house style.

    `arranged` leaves room for labels, legends and titles wherever they stand.
    """
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained" if arranged else None)
        FigureCanvasAgg(figure)
        yield figure


def save(figure: Figure, file: Path) -> None:
    """Write a figure into a file; its ending says in which format."""
    with mpl.rc_context(STYLE):
        figure.savefig(file)


def name(figure: Figure, *titles: str) -> None:
    """Write titles over a figure, each in two lines at most."""
    room = int(TITLE * figure.get_figwidth())
    lines = [line for title in titles for line in textwrap.wrap(title, room, max_lines=2, placeholder=" …")]
    figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=12, fontweight="bold")


def plain(axes: Axes) -> None:
    """Take away from axes what says nothing, and lay a faint grid behind."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.35, linewidth=0.6)
    axes.set_axisbelow(True)


def _panels(axes: Axes) -> int:
    """Return how many panels stand side by side with these axes."""
    spec = axes.get_subplotspec()
    return 1 if spec is None else spec.get_gridspec().ncols


def _room(axes: Axes) -> float:
    """Return the width of axes [inch]."""
    return axes.figure.bbox.width / axes.figure.dpi / _panels(axes) - BESIDE


def _columns(axes: Axes, words: Sequence[str], most: int) -> int:
    """Return how many columns a legend over axes has room for."""
    room = _room(axes)
    for columns in range(most, 1, -1):
        parts = np.array_split([len(word) for word in words], columns)
        if sum(ENTRY + LETTER * part.max(initial=0) for part in parts) <= room:
            return columns
    return 1


def explain(axes: Axes, most: int = IN_A_LINE, title: str = "") -> None:
    """Put a legend over axes, where nothing is drawn; of things with one name the first stands for all.

    It has so many entries in a line at most, and a title where one is given, as a panel's.
    """
    named = {word: mark for mark, word in reversed([*zip(*axes.get_legend_handles_labels(), strict=True)])}
    if named or title:
        words = [*named][::-1]
        # Beside other panels, what is too long for one takes a line more.
        letters = int((_room(axes) - ENTRY + BESIDE / 2.0) / LETTER) if _panels(axes) > 1 else 1000
        place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
        space: dict[str, Any] = {"columnspacing": 1.2, "handlelength": 2.3, "handletextpad": 0.5}
        columns = _columns(axes, words, most)
        if title:
            space |= {"title": title, "alignment": "left", "title_fontproperties": {"weight": "bold", "size": 10.5}}
        lines = [textwrap.fill(word, letters) for word in words]
        axes.legend([named[word] for word in words], lines, ncols=columns, **place, **space)


def blank(axes: Axes, why: str) -> None:
    """Write into empty axes why they are empty."""
    axes.set_xticks(())
    axes.set_yticks(())
    axes.text(0.5, 0.5, textwrap.fill(why, 60), transform=axes.transAxes, ha="center", va="center", color=QUIET)


def widened(least: float, greatest: float, share: float = 0.05) -> tuple[float, float]:
    """Return limits of an axis that hold both ends with some room; of one value, one on either side."""
    room = share * (greatest - least) or 1.0
    return least - room, greatest + room


def finite(*columns: Any) -> NDArray[np.bool_]:
    """Return where all of some columns hold a number."""
    known: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(column) for column in columns])
    return known
