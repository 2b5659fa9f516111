"""Plots as they stand in the page: colours of both schemes, text, ids; and what the page carries with it."""

from __future__ import annotations

import colorsys
import hashlib
import re
from html.parser import HTMLParser
from importlib import resources
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from tests.report.test_page import contrast
from vve_sumo.plotting import heat_map
from vve_sumo.plotting.page import ACTOR, ALARM, EGO, EGO_PALE, INK, OBSTACLE, QUIET
from vve_sumo.report.assets import assets_of
from vve_sumo.report.picture import DrawnPlot, picture_of
from vve_sumo.report.theme import in_the_dark, themed, variables
from vve_sumo.uplot import LICENCE, SCRIPT, STYLE, read

DARK_PAPER = "#17191b"


def rgb(colour: str) -> str:
    return "rgb({}, {}, {})".format(*(int(colour[place : place + 2], 16) for place in (1, 3, 5)))


def on_dark(colour: str) -> float:
    return contrast(rgb(in_the_dark(colour)), rgb(DARK_PAPER))


def test_ink_and_paper_change_places() -> None:
    assert in_the_dark("#ffffff") == pytest.approx("#181818")
    assert on_dark(INK) > 14.0


@pytest.mark.parametrize(("colour", "least"), [(INK, 4.5), (QUIET, 4.5), (EGO, 4.5), (OBSTACLE, 4.5), (ACTOR, 4.5)])
def test_what_is_read_and_drawn_stands_out_from_dark_paper(colour: str, least: float) -> None:
    """WCAG 2.2: 4.5 of text, 3 of graphics (1.4.3, 1.4.11)."""
    assert on_dark(colour) >= least


@pytest.mark.parametrize("colour", [EGO, EGO_PALE, OBSTACLE, ALARM, ACTOR])
def test_a_colour_of_the_dark_scheme_keeps_its_hue(colour: str) -> None:
    """By HLS, another colour space than the one that makes it; a twelfth of the circle is a step from blue to azure."""
    hue, new = (colorsys.rgb_to_hls(*_parts(one))[0] for one in (colour, in_the_dark(colour)))
    assert min(abs(hue - new), 1.0 - abs(hue - new)) < 1.0 / 24.0


def _parts(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5))


def test_greys_of_the_dark_scheme_are_in_the_opposite_order() -> None:
    greys = [in_the_dark(f"#{part:02x}{part:02x}{part:02x}") for part in range(0, 256, 5)]
    assert greys == sorted(greys, reverse=True)


def test_every_colour_has_a_value_in_either_scheme() -> None:
    declarations = "fill:#ffffff;stroke:#0072B2"
    assert themed(declarations) == "fill:var(--paper);stroke:var(--c0072b2)"
    assert len(re.findall("--c0072b2:#", variables([declarations]))) == 2


def drawn(text: str) -> DrawnPlot:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], "o-", color=EGO)
    axes.fill_between([0.0, 1.0], 0.0, 1.0, hatch="//", facecolor="white", edgecolor=QUIET)
    axes.set_title(text, parse_math=False)
    return picture_of(figure, "one", text, text)


class Tags(HTMLParser):
    """Collects the tags and attributes of a text as a browser's tokeniser sees them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _value in attrs}


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:.*Glyph:UserWarning")
@given(
    st.text(min_size=1, max_size=30) | st.sampled_from(["</svg><script>x</script>", "--!><img onerror=x>", "\ud800"])
)
def test_a_plots_words_are_text_whatever_they_are(text: str) -> None:
    tags = Tags(drawn_text(text))
    assert tags.tags <= {"svg", "g", "defs", "path", "use", "text", "tspan", "clippath", "rect", "pattern"}
    assert not tags.attributes & {"style", "onerror", "onload", "xlink:href"}


def drawn_text(text: str) -> str:
    figure = Figure(figsize=(2.0, 1.0))
    figure.text(0.5, 0.5, text, parse_math=False)
    return picture_of(figure, "words", text, text).drawing.markup


def test_text_stays_text_and_the_same_figure_is_the_same_picture() -> None:
    first, again = drawn("gap & TTC"), drawn("gap & TTC")
    assert first == again
    assert "gap & TTC" in first.drawing.texts
    assert [term.word for term in first.terms] == ["gap", "TTC (time to collision)"]


def test_every_reference_leads_to_an_id_of_its_own_picture() -> None:
    drawing = drawn("x").drawing
    ids = [one.get("id") for one in ElementTree.fromstring(drawing.markup).iter() if one.get("id")]
    everything = drawing.markup + "".join(drawing.styles.values())
    asked = set(re.findall(r"url\(#([^)]+)\)|href=\"#([^\"]+)\"", everything))
    asked = {one or other for one, other in asked}
    assert len(ids) == len(set(ids))
    assert asked
    assert asked <= set(ids)
    assert all(str(one).startswith("one-") for one in ids)


def test_colours_that_are_values_are_the_same_in_both_schemes() -> None:
    rows = pd.DataFrame({"x": [0.0, 1.0], "y": [0.0, 1.0], "passed": [True, False]})
    drawing = picture_of(heat_map(rows, "x", "y", "passed"), "map", "a map", "").drawing
    fixed = "".join(rule for rule in drawing.rules() if rule.startswith(".f"))
    others = "".join(rule for rule in drawing.rules() if not rule.startswith(".f"))
    # The least and the greatest colour of matplotlib's map.
    assert {"#00224e", "#fee838"} <= set(re.findall("#[0-9a-f]{6}", fixed))
    assert "var(" not in fixed
    assert "#" not in re.sub(r"url\(#[^)]+\)", "", others)


def test_the_library_is_the_published_one_and_its_licence_goes_with_it() -> None:
    """Hashes of the files of the npm package uplot 1.6.32."""
    folder = resources.files("vve_sumo.uplot")
    hashes = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (SCRIPT, STYLE)}
    assert hashes == {
        SCRIPT: "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
        STYLE: "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    }
    assert "Permission is hereby granted" in read(LICENCE)
    carried = assets_of([], interactive=True).scripts
    assert "Permission is hereby granted" in carried[0]
    assert "Permission is hereby granted" not in "".join(assets_of([], interactive=False).scripts)


def test_many_points_make_no_large_page() -> None:
    """The report of 200 runs and a long drive's stay small: a curve of 10,000 noisy points is simplified or short."""
    figure = Figure(figsize=(7.0, 4.0))
    axes = figure.subplots()
    axes.plot(np.linspace(0.0, 1.0, 10_000), np.random.default_rng(1).normal(size=10_000))
    assert len(picture_of(figure, "curve", "", "").drawing.markup) < 400_000
