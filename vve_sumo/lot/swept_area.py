"""Computes the swept area of a car's body along a path, as convex shapes without gaps between them.

Pure geometry of a rectangle that moves along a curve of its rear axle; knows no lot, no car's brakes and no map. Places
are complex numbers (x + iy) in the frame of the rear axle at the beginning: x forward, y left [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.values import Floats, Vehicle

Complexes = NDArray[np.complex128]

SLICES: Final = 24  #: of a path of constant curvature
FAN_SPACING: Final = 0.8  #: neighbouring paths of a fan end about this far from each other [m]
FARTHER: Final = 1.0 / 80.0  #: extra length share of a relaxing path, over the square of its turn [1/rad2]
SWING: Final = 0.25  #: by which a corner swings out besides, over that turn [m/rad]; about a quarter of the width
MAX_FAN_GAPS: Final = 10  #: between the paths of a fan
PANELS: Final = 2  #: of the integration, for each interval of a curvature's table


@dataclass(frozen=True, slots=True)
class Body:
    """A rectangle fixed to its rear axle."""

    corners: Complexes  #: four, in order
    reach: float  #: of the farthest corner from the rear axle [m]

    @classmethod
    def of(cls, vehicle: Vehicle) -> Body:
        """Return the car's, without mirrors."""
        front, rear, half = vehicle.rear_axle_to_bumper, vehicle.rear_overhang, 0.5 * vehicle.width
        corners = np.array([front + 1j * half, -rear + 1j * half, -rear - 1j * half, front - 1j * half])
        return cls(corners, float(np.abs(corners).max()))

    def grown(self, by: float) -> Body:
        """Return the rectangle with every side moved outwards [m]."""
        if by == 0.0:
            return self
        corners = self.corners + by * (np.sign(self.corners.real) + 1j * np.sign(self.corners.imag))
        return Body(corners, float(np.abs(corners).max()))


def fan(body: Body, low: float, high: float, distance: float) -> Complexes:
    """Return shapes, (n, 4), that cover the body on every circle from curvature `low` to `high` [1/m] up to `distance`.

    A negative distance goes backwards.
    """
    gaps = min(1 + int(abs(high - low) * distance * distance / (2.0 * FAN_SPACING)), MAX_FAN_GAPS)
    bends = np.linspace(low, high, gaps + 1)[:, None]
    s = np.linspace(0.0, distance, SLICES + 1)
    turned = bends * s
    # A chord is sin(a) / a times its arc, a being half the angle turned.
    places = s * np.sinc(turned / math.tau) * np.exp(0.5j * turned)
    corners = places + np.exp(1j * turned) * body.corners[:, None, None]
    bend, far = max(abs(low), abs(high)), np.abs(s[1:])
    gap, step = (high - low) / gaps, distance / SLICES
    # Second derivatives of a corner's place along s and across the fan, see `_covered`.
    along = step * step * (bend + bend * bend * body.reach)
    across = gap * gap * (far * far * far / 3.0 + far * far * body.reach)
    return _covered(corners, turned, (along + across) / 8.0)


def relaxing(body: Body, low: float, high: float, distance: float) -> Complexes:
    """Return shapes, (n, 4), that cover the body on all paths of a curvature between `low` and `high` [1/m].

    A path that turns for a part of its length and is straight for the rest ends beyond every circle of that length: by
    a hundredth for a turn of 1 rad, in proportion to the square of the turn. A corner of the body swings out a little
    more. Both shares (`FARTHER`, `SWING`) were found empirically; the tests check them.
    """
    angle = max(abs(low), abs(high)) * abs(distance)
    return fan(body, low, high, distance * (1.0 + angle * angle * FARTHER) + math.copysign(angle * SWING, distance))


def trail(body: Body, curvature: Floats, spacing: float) -> Complexes:
    """Return shapes, (n, 4), that cover the body on a path of curvature [1/m] given every `spacing` [m]."""
    fine = spacing / PANELS
    knots = np.arange(len(curvature) * PANELS - PANELS + 1) / PANELS
    bends = np.interp(knots, np.arange(len(curvature)), curvature)
    here, there = bends[:-1], bends[1:]
    turned = np.concatenate(([0.0], np.cumsum(0.5 * fine * (here + there))))
    middle = turned[:-1] + fine * (0.375 * here + 0.125 * there)
    ahead = np.exp(1j * turned)
    # Simpson's rule; the heading is exact, being the integral of straight lines.
    legs = fine / 6.0 * (ahead[:-1] + 4.0 * np.exp(1j * middle) + ahead[1:])
    places = np.concatenate(([0.0], np.cumsum(legs)))[::PANELS]
    corners = (places + ahead[::PANELS] * body.corners[:, None])[:, None]
    bend = np.maximum(np.abs(curvature[:-1]), np.abs(curvature[1:]))
    slope = np.abs(np.diff(curvature)) / spacing
    loose = spacing * spacing / 8.0 * (bend + (bend * bend + slope) * body.reach)
    return _covered(corners, turned[None, ::PANELS], loose)


def as_pairs(shapes: Complexes, x: float, y: float, heading: float) -> Floats:
    """Return shapes as map coordinates, (n, 4, 2), of a way that begins at a place and heading of a map [m, rad]."""
    turn = complex(math.cos(heading), math.sin(heading))
    placed = shapes * turn + complex(x, y)
    return np.ascontiguousarray(placed).view(np.float64).reshape(*placed.shape, 2)


def _covered(corners: Complexes, turned: Floats, loose: Floats) -> Complexes:
    """Return a rectangle for each cell between two neighbouring paths and two places along them.

    `corners`: (4, paths, places); `turned`: headings, (paths, places); `loose`: how far a corner strays from the
    bilinear interpolation between its places at the ends of the cell [m], at most h^2 / 8 times its second derivative
    in each direction. The interpolation stays in the hull of those places, and so in the rectangle. A single path is
    its own neighbour.
    """
    lower, upper = (slice(None, -1), slice(1, None)) if len(turned) > 1 else (slice(None), slice(None))
    turn = np.exp(0.25j * (turned[lower, :-1] + turned[lower, 1:] + turned[upper, :-1] + turned[upper, 1:]))
    ends = (corners[:, lower, :-1], corners[:, lower, 1:], corners[:, upper, :-1], corners[:, upper, 1:])
    seen = np.concatenate(ends if len(turned) > 1 else ends[:2]) * turn.conj()
    ahead, beside = seen.real, seen.imag
    back, front = ahead.min(axis=0) - loose, ahead.max(axis=0) + loose
    right, left = beside.min(axis=0) - loose, beside.max(axis=0) + loose
    boxes = np.stack((front + 1j * left, back + 1j * left, back + 1j * right, front + 1j * right), axis=-1)
    return np.asarray((boxes * turn[..., None]).reshape(-1, 4), dtype=np.complex128)
