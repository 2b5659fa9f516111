"""Words lie within the page and not upon each other, numbers have units, and files suit notebooks and papers."""

from __future__ import annotations

import itertools
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.isolated import isolated
from tests.plotting.runs_and_sweeps import survivors
from vve_sumo import plotting
from vve_sumo.plotting import style


def shown(figure: Figure) -> list[tuple[Text, Any]]:
    """Return every text that is drawn, and its place on the page."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    texts = [text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_visible()]
    kept = [text for text in texts if text.get_text().strip() and drawn(text, figure)]
    return [(text, text.get_window_extent(renderer)) for text in kept]


def drawn(text: Text, figure: Figure) -> bool:
    """Leave out labels of ticks that lie outside the limits, which matplotlib keeps but does not draw."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            inside = {id(one) for tick in axis._update_ticks() for one in (tick.label1, tick.label2)}  # type: ignore[attr-defined]
            every = axis.majorTicks + axis.minorTicks  # type: ignore[attr-defined]
            ticks = {id(one) for tick in every for one in (tick.label1, tick.label2)}
            if id(text) in ticks:
                return id(text) in inside
    return True


PLOTS = ("overview", "safety", "approach", "gaps", "stops", "map", "shares", "distribution", "boundary", "worst")
PLOTS += ("latency", "comparison", "cliff", "response", "panels", "laws", "pairs")


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("name", PLOTS)
def test_words_lie_within_the_page_and_not_upon_each_other_and_numbers_have_units(
    figures: dict[str, Figure], name: str
) -> None:
    texts = shown(figures[name])
    page = figures[name].bbox
    assert len(texts) > 5
    for text, box in texts:
        assert page.x0 - 1.0 <= box.x0 <= box.x1 <= page.x1 + 1.0, text.get_text()
        assert page.y0 - 1.0 <= box.y0 <= box.y1 <= page.y1 + 1.0, text.get_text()
    for (one, box), (other, beside) in itertools.combinations(texts, 2):
        wide = min(box.x1, beside.x1) - max(box.x0, beside.x0)
        high = min(box.y1, beside.y1) - max(box.y0, beside.y0)
        assert wide <= 2.0 or high <= 2.0, (one.get_text(), other.get_text())
    for axes in figures[name].axes:
        # On a drive's page the titles of the panels say it; a list of names (legs, lines) has no unit.
        for axis, said in ((axes.xaxis, axes.get_xlabel()), (axes.yaxis, axes.get_ylabel() + axes.get_title("left"))):
            words = [text.get_text() for text in axis.get_ticklabels() if text.get_visible()]
            numbers = [word for word in words if re.fullmatch(r"[\u2212\-\d.]+", word)]
            assert re.search(r"\[.+\]", said) or not numbers, (name, said, words)


def test_a_plot_shows_itself_in_a_notebook_in_the_house_style(figures: dict[str, Figure], tmp_path: Path) -> None:
    figure = figures["gaps"]
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    sizes = {text.get_fontsize() for text in figure.axes[0].get_xticklabels()}
    assert sizes == {float(style.STYLE["font.size"])}
    plotting.save(figure, tmp_path / "plot.svg")
    assert (tmp_path / "plot.svg").read_text(encoding="utf-8").startswith("<?xml")


def has_pyplot() -> bool:
    import vve_sumo.plotting  # noqa: F401

    return "matplotlib.pyplot" in sys.modules


def test_plots_need_no_pyplot() -> None:
    assert not isolated(has_pyplot)


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["pdf", "ps"])
def test_a_plot_for_a_paper_has_no_type_3_fonts(form: str, tmp_path: Path) -> None:
    """Publishers refuse them; fonts of a PDF are named in its text, those of PostScript by their type."""
    file = tmp_path / f"plot.{form}"
    plotting.distribution(survivors(), "stop_gap_m", "controller.name").savefig(file)
    content = file.read_bytes()
    assert b"/Subtype /Type3" not in content
    assert b"/FontType 3" not in content
    assert (b"/Subtype /CIDFontType2" if form == "pdf" else b"/FontType 42") in content
