"""A matplotlib figure as SVG that stands in the page: text stays text, and colours follow the colour scheme.

Style attributes become classes, so that the page's content security policy can forbid every other style. Colours that
stand for values (those of a colour map, and text upon it) are the same in both schemes. Knows neither what a figure
shows nor the page.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree import ElementTree as Tree

from vve_sumo.report.text import printable
from vve_sumo.report.theme import themed

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_SVG, _XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
#: elements that a plot is made of; others, such as metadata, are left out
_ELEMENTS = frozenset(("svg", "g", "defs", "path", "use", "text", "tspan", "clipPath", "rect", "image", "pattern"))
#: CSS counts 96 of its dots to an inch
CSS_DOTS_PER_INCH = 96
_WHITE = (1.0, 1.0, 1.0, 1.0)
#: group of matplotlib whose colours stand for values
_FIXED = "fixed-colours"
#: decimals of a place on the page, whose unit is 1/72 inch
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_URL = re.compile(r"url\(#([^)]+)\)")


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure as SVG."""

    markup: str
    texts: tuple[str, ...]  #: that stand in it
    width: int  #: on paper [CSS dots]
    styles: dict[str, str] = field(default_factory=dict)  #: declarations by class, colours still as `#rrggbb`
    fixed: frozenset[str] = frozenset()  #: classes whose colours are the same in both schemes

    def rules(self) -> Iterator[str]:
        """Return the CSS rules of the classes."""
        for name, declarations in self.styles.items():
            yield f".{name}{{{declarations if name in self.fixed else themed(declarations)}}}"


def drawing_of(figure: Figure, name: str, alt: str) -> Drawing:
    """Return a figure as SVG; `name` keeps its ids apart from those of other figures on the page.

    The same figure gives the same text. The figure must have been drawn before, which lays it out; it is changed.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    for artist in _of_values(figure):
        artist.set_gid(_FIXED)
    for axes in figure.axes:
        if axes.get_facecolor() == _WHITE:
            axes.patch.set_alpha(0.0)  # the page's own paper, and the cue that there is more to scroll to, show through
    figure.set_layout_engine("none")
    figure.set_facecolor("none")
    out = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(out, metadata=metadata)  # type: ignore[no-untyped-call]
    text = printable(out.getvalue())
    root = Tree.fromstring(text[text.index("<svg") :])
    shaping = _Shaping(name)
    shaping.keep(root, fixed=False)
    width, height = (round(CSS_DOTS_PER_INCH * float(inches)) for inches in figure.get_size_inches())
    root.attrib |= {"class": "plot", "role": "img", "aria-label": alt, "width": str(width), "height": str(height)}
    texts = tuple("".join(one.itertext()) for one in root.iter("text"))
    return Drawing(Tree.tostring(root, encoding="unicode"), texts, width, shaping.styles, frozenset(shaping.fixed))


def _of_values(figure: Figure) -> Iterator[Artist]:
    """Return what is coloured by values, and the texts within axes that hold a map of such colours."""
    from matplotlib.collections import QuadMesh

    for axes in figure.axes:
        yield from (one for one in axes.collections if one.get_array() is not None)
        if any(isinstance(one, QuadMesh) for one in axes.collections):
            yield from axes.texts


class _Shaping:
    """Makes of matplotlib's elements those of the page, one after the other."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.styles: dict[str, str] = {}
        self.fixed: set[str] = set()

    def keep(self, element: Tree.Element, fixed: bool) -> None:
        """Rewrite an element and all within it; `fixed` says whether its colours stand for values."""
        fixed = fixed or element.get("id") == _FIXED
        element.tag = element.tag.removeprefix(_SVG)
        self._rewrite(element, fixed)
        for inner in list(element):
            if inner.tag.removeprefix(_SVG) in _ELEMENTS:
                self.keep(inner, fixed)
            else:
                element.remove(inner)

    def _rewrite(self, element: Tree.Element, fixed: bool) -> None:
        attributes = dict(element.attrib)
        element.attrib.clear()
        for key, value in attributes.items():
            if key == "style":
                element.set("class", self._class(value, fixed))
            elif key in ("fill", "stroke") and value.startswith("#"):  # of hatches
                element.set("class", self._class(f"{key}: {value}", fixed))
            elif key == "id":
                if element.tag not in ("g", "svg", "text"):  # nothing refers to those
                    element.set("id", f"{self._name}-{value}")
            elif key == f"{_XLINK}href":
                element.set("href", value if element.tag == "image" else f"#{self._name}-{value[1:]}")
            elif not key.startswith("{"):
                element.set(key, self._value(value))
        if element.tag == "svg":
            element.attrib.pop("version", None)

    def _value(self, text: str) -> str:
        text = _URL.sub(rf"url(#{self._name}-\1)", text)
        return _LONG_NUMBER.sub(lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), text)

    def _class(self, style: str, fixed: bool) -> str:
        """Return the class of a style; the same style has the same class in every figure."""
        style = _URL.sub(rf"url(#{self._name}-\1)", style.replace(": ", ":").replace("; ", ";"))
        name = f"{'f' if fixed else 'k'}{hashlib.sha256(style.encode()).hexdigest()[:8]}"
        self.styles[name] = style
        if fixed:
            self.fixed.add(name)
        return name
