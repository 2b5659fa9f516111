"""Colours of plots on the page, which follow the reader's light or dark colour scheme.

In the dark scheme a colour keeps its hue, and its lightness is turned over: what was near the paper stays near it, what
stood out stands out. Knows colours only.

Source of the colour space: Ottosson, A perceptual color space for image processing (Oklab), 2020.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

#: the page's own colours, which its style sheet sets for both schemes
OF_PAGE = {"#ffffff": "--paper", "#000000": "--ink", "#1b1b1b": "--ink"}
#: Oklab lightness of ink and paper of the page in the light scheme and in the dark one
INK_LIGHT, PAPER_LIGHT, INK_DARK, PAPER_DARK = 0.22, 1.0, 0.94, 0.21
#: above 1, so that colours of middle lightness come out light enough to be read on dark paper
GAMMA = 1.6
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}\b")


def themed(declarations: str) -> str:
    """Return CSS declarations with every colour replaced by the variable that stands for it."""
    return _COLOUR.sub(lambda found: f"var({_variable(found[0].lower())})", declarations)


def variables(declarations: Iterable[str]) -> str:
    """Return the rules that give every colour in CSS declarations its value in either scheme."""
    colours = sorted({colour.lower() for text in declarations for colour in _COLOUR.findall(text)} - OF_PAGE.keys())
    light = "".join(f"{_variable(colour)}:{colour};" for colour in colours)
    dark = "".join(f"{_variable(colour)}:{in_the_dark(colour)};" for colour in colours)
    return f":root{{{light}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n"


def _variable(colour: str) -> str:
    return OF_PAGE.get(colour, f"--c{colour[1:]}")


def in_the_dark(colour: str) -> str:
    """Return the colour of the dark scheme for one of the light scheme, both as `#rrggbb`."""
    lightness, a, b = _oklab(colour)
    share = (lightness - INK_LIGHT) / (PAPER_LIGHT - INK_LIGHT)
    return _hex(INK_DARK + max(share, 0.0) ** GAMMA * (PAPER_DARK - INK_DARK), a, b)


def _oklab(colour: str) -> tuple[float, float, float]:
    channels = (int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5))
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    long = (0.4122214708 * red + 0.5363325363 * green + 0.0514459929 * blue) ** (1 / 3)
    middle = (0.2119034982 * red + 0.6806995451 * green + 0.1073969566 * blue) ** (1 / 3)
    short = (0.0883024619 * red + 0.2817188376 * green + 0.6299787005 * blue) ** (1 / 3)
    return (
        0.2104542553 * long + 0.7936177850 * middle - 0.0040720468 * short,
        1.9779984951 * long - 2.4285922050 * middle + 0.4505937099 * short,
        0.0259040371 * long + 0.7827717662 * middle - 0.8086757660 * short,
    )


def _hex(lightness: float, a: float, b: float) -> str:
    """Return a colour of Oklab; one that no screen shows is cut channel by channel."""
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    middle = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = (
        4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short,
        -1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short,
        -0.0041960863 * long - 0.7034186147 * middle + 1.7076147010 * short,
    )
    parts = (12.92 * c if c <= 0.0031308 else 1.055 * max(c, 0.0) ** (1 / 2.4) - 0.055 for c in linear)
    return "#" + "".join(f"{round(255.0 * min(max(part, 0.0), 1.0)):02x}" for part in parts)
