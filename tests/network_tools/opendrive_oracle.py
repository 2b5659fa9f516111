"""Where the lanes of an OpenDRIVE file run, worked out from its reference lines: by the standard's formulae alone.

ASAM OpenDRIVE 1.8, clauses 9.3 (geometry of the reference line), 11.4 (lane offset) and 11.7 (widths). Curves are
integrated numerically. Lanes inside junctions are left out: a converter may draw its own.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

STEP = 2.0  #: between two points [m]


class Drawn(NamedTuple):
    """A lane's middle as the file has it."""

    road: str
    lane: int
    points: NDArray[np.float64]  #: x, y (n, 2) in the file's plane [m], in the order of s
    narrowest: float  #: least width [m]


def lanes(file: Path, kind: str = "driving") -> list[Drawn]:
    """Return every lane of a kind outside junctions."""
    found = []
    for road in ET.parse(file).getroot().iter("road"):
        if road.get("junction", "-1") != "-1":
            continue
        length = float(road.attrib["length"])
        sections = road.findall("lanes/laneSection")
        starts = [float(section.attrib["s"]) for section in sections] + [length]
        for section, start, end in zip(sections, starts, starts[1:], strict=False):
            s = np.linspace(start, end, max(int((end - start) / STEP), 2))
            x, y, heading = np.array([_reference(road, one) for one in s]).T
            for side, sign in (("left", 1), ("right", -1)):
                outward = sorted(section.findall(f"{side}/lane"), key=lambda lane: abs(int(lane.attrib["id"])))
                t = np.array([_cubic(road.findall("lanes/laneOffset"), one, "s") for one in s])
                for lane in outward:
                    width = np.array([_cubic(lane.findall("width"), one - start, "sOffset") for one in s])
                    if lane.get("type") == kind:
                        at = t + sign * width / 2.0
                        points = np.column_stack([x - at * np.sin(heading), y + at * np.cos(heading)])
                        found.append(Drawn(road.attrib["id"], int(lane.attrib["id"]), points, float(width.min())))
                    t = t + sign * width
    return found


def _cubic(pieces: list[ET.Element], at: float, key: str) -> float:
    piece = next((one for one in reversed(pieces) if float(one.attrib[key]) <= at + 1e-9), None)
    if piece is None:
        return 0.0
    d = at - float(piece.attrib[key])
    a, b, c, e = (float(piece.attrib[name]) for name in "abcd")
    return a + d * (b + d * (c + d * e))


def _reference(road: ET.Element, s: float) -> tuple[float, float, float]:
    pieces = road.findall("planView/geometry")
    piece = next(one for one in reversed(pieces) if float(one.attrib["s"]) <= s + 1e-9)
    x, y, heading, length = (float(piece.attrib[name]) for name in ("x", "y", "hdg", "length"))
    along = s - float(piece.attrib["s"])
    (shape,) = (child for child in piece if child.tag in ("line", "arc", "spiral", "poly3", "paramPoly3"))
    if shape.tag in ("line", "arc", "spiral"):
        first = float(shape.get("curvature", shape.get("curvStart", "0")))
        last = float(shape.get("curvEnd", first))
        u = np.linspace(0.0, along, 201)
        turned = heading + first * u + 0.5 * (last - first) / length * u * u
        return x + np.trapezoid(np.cos(turned), u), y + np.trapezoid(np.sin(turned), u), float(turned[-1])
    if shape.tag == "poly3":
        b, c, d = (float(shape.attrib[name]) for name in "bcd")
        u = np.linspace(0.0, along, 2001)
        slope = b + u * (2.0 * c + 3.0 * u * d)
        far = np.concatenate([[0.0], np.cumsum(np.diff(u) * np.hypot(1.0, 0.5 * (slope[1:] + slope[:-1])))])
        p = float(np.interp(along, far, u))
        local, tangent = (
            (p, float(shape.attrib["a"]) + p * (b + p * (c + p * d))),
            (1.0, b + p * (2.0 * c + 3.0 * p * d)),
        )
    else:
        p = along / length if shape.get("pRange", "normalized") == "normalized" else along
        coefficients = {axis: [float(shape.attrib[name + axis]) for name in "abcd"] for axis in "UV"}
        at = [k[0] + p * (k[1] + p * (k[2] + p * k[3])) for k in coefficients.values()]
        rate = [k[1] + p * (2.0 * k[2] + 3.0 * p * k[3]) for k in coefficients.values()]
        local, tangent = (at[0], at[1]), (rate[0], rate[1])
    cosine, sine = math.cos(heading), math.sin(heading)
    turned_by = math.atan2(tangent[1], tangent[0])
    return x + cosine * local[0] - sine * local[1], y + sine * local[0] + cosine * local[1], heading + turned_by
