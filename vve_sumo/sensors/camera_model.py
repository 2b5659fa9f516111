"""The geometry of a camera with a lens: where points before it are in the picture, and along which ray a pixel looks.

The camera's frame: x to the right, y down, z along the axis, metres. Pixels are counted as OpenCV counts them: columns
to the right and rows down from the middle of the upper left pixel. Pure functions of arrays; the module knows no car
and no picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.values import Floats

#: no ray may be farther from the axis [rad]: the street is first drawn on a plane, of which wide angles need too much
MAX_ANGLE: Final = math.radians(75.0)
#: steps of Newton's method at most, and the error of a slope or an angle at which it ends
MAX_STEPS, TOLERANCE = 30, 1e-11
#: a ray's picture must lie so near to its pixel [focal lengths]; else the lens has no ray for the pixel
CLOSE: Final = 1e-7


class BrownConrady(NamedTuple):
    """A lens whose picture is near that of a pinhole: OpenCV's `calibrateCamera`, its first five coefficients.

    With slopes (x, y) and r² = x² + y², the picture is at x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²) and
    y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y, in focal lengths from the principal point.
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def distorted(self, slopes: Floats) -> Floats:
        """Return where rays of slopes (n, 2) are seen [focal lengths from the principal point], right and down."""
        x, y = slopes[:, 0], slopes[:, 1]
        square = x * x + y * y
        radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        return np.column_stack(
            (
                x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x),
                y * radial + self.p1 * (square + 2.0 * y * y) + 2.0 * self.p2 * x * y,
            )
        )


class KannalaBrandt(NamedTuple):
    """A fisheye lens: OpenCV's `fisheye`. At the angle a from the axis a ray is seen a (1 + k1 a² + k2 a⁴ + …) away."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def distorted(self, slopes: Floats) -> Floats:
        """Return where rays of slopes (n, 2) are seen [focal lengths from the principal point], right and down."""
        radius = np.hypot(slopes[:, 0], slopes[:, 1])
        angle = np.arctan(radius)
        square = angle * angle
        seen = angle * (1.0 + square * (self.k1 + square * (self.k2 + square * (self.k3 + square * self.k4))))
        scale = np.divide(seen, radius, out=np.ones_like(radius), where=radius > 1e-12)
        return slopes * scale[:, np.newaxis]


Lens = BrownConrady | KannalaBrandt


@dataclass(frozen=True, slots=True)
class CameraModel:
    """The inner geometry of a camera."""

    columns: int  #: pixels
    rows: int  #: pixels
    focal_x: float  #: focal length in widths of a pixel
    focal_y: float  #: focal length in heights of a pixel
    centre_x: float  #: column of the principal point, 0 in the middle of the first one
    centre_y: float  #: row of the principal point, 0 in the middle of the first one
    lens: Lens

    def project(self, points: Floats) -> Floats:
        """Return columns and rows (n, 2) of points (n, 3) of the camera's frame; NaN of those behind the camera."""
        z = points[:, 2]
        before = np.where(z > 1e-9, z, np.nan)
        return self._pixels(self.lens.distorted(points[:, :2] / before[:, np.newaxis]))

    def slopes(self, pixels: Floats) -> Floats:
        """Return the slopes (n, 2), to the right and down for a metre along the axis, of the rays of pixels (n, 2).

        Raises ValueError where a pixel has no ray within MAX_ANGLE of the axis: the lens then maps none there.
        """
        seen = (pixels - (self.centre_x, self.centre_y)) / (self.focal_x, self.focal_y)
        if self.pinhole:
            return seen
        found = _inverted(self.lens.distorted, seen)
        far = np.hypot(found[:, 0], found[:, 1]) > math.tan(MAX_ANGLE)
        wrong = ~np.isfinite(found).all(axis=1) | far
        if wrong.any():
            column, row = pixels[int(np.argmax(wrong))].tolist()
            raise ValueError(
                f"the lens has no ray within {math.degrees(MAX_ANGLE):.0f} degrees of the axis "
                f"for the pixel in column {column:g}, row {row:g}"
            )
        return found

    @property
    def pinhole(self) -> bool:
        """Whether the lens changes nothing."""
        return isinstance(self.lens, BrownConrady) and not any(self.lens)

    def grid(self) -> Floats:
        """Return the slopes of the rays of all pixels, (rows, columns, 2); raises ValueError as `slopes` does."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        pixels = np.column_stack((column.ravel(), row.ravel())).astype(np.float64)
        return self.slopes(pixels).reshape(self.rows, self.columns, 2)

    def _pixels(self, seen: Floats) -> Floats:
        return seen * (self.focal_x, self.focal_y) + (self.centre_x, self.centre_y)


def _inverted(distorted: Callable[[Floats], Floats], seen: Floats) -> Floats:
    """Return the slopes that a lens maps to `seen`, by Newton's method from the axis outwards; NaN where none are.

    Pixels are approached along the way from the principal point, so that a lens that folds the picture over gives the
    inner ray or none.
    """
    found = np.zeros_like(seen)
    # Where there is none, the method leaves for infinity.
    with np.errstate(all="ignore"):
        for share in (0.25, 0.5, 0.75, 1.0):
            wanted = share * seen
            for _ in range(MAX_STEPS):
                off = distorted(found) - wanted
                if np.nanmax(np.abs(off), initial=0.0) < TOLERANCE:
                    break
                found = found - _solved(_jacobian(distorted, found), off)
        missed = ~(np.abs(distorted(found) - seen).max(axis=1) < CLOSE)
        missed |= ~(np.linalg.det(_jacobian(distorted, found)) > 0.0)
    return np.where(missed[:, np.newaxis], np.nan, found)


def _jacobian(distorted: Callable[[Floats], Floats], at: Floats, step: float = 1e-6) -> Floats:
    """Return the derivatives of the picture by the slopes, (n, 2, 2), by central differences."""
    columns = []
    for axis in ((step, 0.0), (0.0, step)):
        columns.append((distorted(at + axis) - distorted(at - axis)) / (2.0 * step))
    return np.stack(columns, axis=2)


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Return the solutions of n systems of two equations; NaN where one has none."""
    (a, b), (c, d) = matrix[:, 0].T, matrix[:, 1].T
    solved: Floats = np.column_stack((d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]))
    solved /= (a * d - b * c)[:, np.newaxis]
    return solved
