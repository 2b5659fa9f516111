"""What a body looks like to a sensor that sees its shape: upright blocks within the body's box, by its kind.

A vehicle is one block, its box. People and two-wheelers are several, because most of their box is air. The shares are
assumptions after the proportions of an adult (height of the hip 0.48, of the chin 0.87 of the body's) and of a bicycle
with its rider.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.path import Indices
from vve_sumo.values import Actors, Floats


class Part(NamedTuple):
    """A block as shares of the body's box."""

    ahead: float  #: of the middle from the middle of the box, share of the length
    left: float  #: of the middle from the middle of the box, share of the width
    length: float  #: share of the length
    width: float  #: share of the width
    bottom: float  #: share of the height
    top: float  #: share of the height


_WHOLE: Final = (Part(0.0, 0.0, 1.0, 1.0, 0.0, 1.0),)
_PERSON: Final = (
    Part(0.0, 0.25, 1.0, 0.3, 0.0, 0.48),  # a leg
    Part(0.0, -0.25, 1.0, 0.3, 0.0, 0.48),
    Part(0.0, 0.0, 1.0, 1.0, 0.48, 0.82),  # trunk and arms
    Part(0.0, 0.0, 0.8, 0.35, 0.82, 1.0),  # the head
)
_RIDER: Final = (
    Part(0.0, 0.0, 1.0, 0.15, 0.0, 0.55),  # wheels and frame
    Part(-0.05, 0.0, 0.3, 1.0, 0.45, 0.82),  # trunk, arms and legs
    Part(0.05, 0.0, 0.12, 0.35, 0.82, 1.0),
)
#: by kind of body
PARTS: Final = {
    "motorcycle": (Part(0.0, 0.0, 1.0, 0.4, 0.0, 0.6), *_RIDER[1:]),
    "bicycle": _RIDER,
    "pedestrian": _PERSON,
    "child": _PERSON,
}
_BY_NUMBER: Final[Sequence[tuple[Part, ...]]] = [PARTS.get(kind, _WHOLE) for kind in BODY_KINDS]
#: by number of kind: how many parts it has, and which of all parts is its first one
_COUNTS: Final = np.array([len(parts) for parts in _BY_NUMBER])
_FIRSTS: Final = np.cumsum(_COUNTS) - _COUNTS
#: the parts of all kinds, fields by parts, with halves of length and width
_SHARES: Final = (np.array([part for parts in _BY_NUMBER for part in parts]) * (1.0, 1.0, 0.5, 0.5, 1.0, 1.0)).T.copy()


class Blocks(NamedTuple):
    """Upright blocks in the map; arrays have an entry a block."""

    actor: Indices  #: row of the actor that the block belongs to
    x: Floats  #: of the middle, map [m]
    y: Floats  #: of the middle, map [m]
    cos: Floats  #: of the heading
    sin: Floats  #: of the heading
    half_length: Floats  #: along the heading [m]
    half_width: Floats  #: across the heading [m]
    bottom: Floats  #: above the ground [m]
    top: Floats  #: above the ground [m]
    speed_x: Floats  #: map [m/s]
    speed_y: Floats  #: map [m/s]


def finite_rows(actors: Actors) -> Indices:
    """Return the rows of the actors whose every number is finite."""
    place = actors.x, actors.y, actors.heading, actors.speed, actors.lateral_speed
    finite = np.isfinite(np.concatenate((*place, actors.length, actors.width, actors.height)))
    if np.logical_and.reduce(finite):
        return np.arange(len(actors.x))
    return np.flatnonzero(np.logical_and.reduce(finite.reshape(-1, len(actors.x))))


def blocks_of(actors: Actors, rows: Indices) -> Blocks:
    """Return the blocks of some rows of the actors, every number of which must be finite."""
    kind = actors.kind[rows]
    count = _COUNTS[kind]
    actor = np.repeat(rows, count)
    part = np.arange(len(actor)) + np.repeat(_FIRSTS[kind] - np.cumsum(count) + count, count)
    length, width, height = actors.length, actors.width, actors.height
    scales = length, width, length, width, height, height
    columns = actors.x, actors.y, actors.heading, actors.speed, actors.lateral_speed, *scales
    of_blocks = np.concatenate(columns).reshape(len(columns), -1).take(actor, axis=1)
    x, y, heading, speed, lateral = of_blocks[: -len(scales)]
    ahead, left, half_length, half_width, bottom, top = of_blocks[-len(scales) :] * _SHARES.take(part, axis=1)
    cos, sin = np.cos(heading), np.sin(heading)
    return Blocks(
        actor,
        x + ahead * cos - left * sin,
        y + ahead * sin + left * cos,
        cos,
        sin,
        half_length,
        half_width,
        bottom,
        top,
        speed * cos - lateral * sin,
        speed * sin + lateral * cos,
    )
