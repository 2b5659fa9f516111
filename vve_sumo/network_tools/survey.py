"""Records a path on the virtual road: a SUMO car drives along given edges, and its track becomes a file of positions.

The track is of the car's front bumper, which SUMO keeps on the lanes' centre lines. Smoothed, it is the path of the
ego's rear axle. Knows nothing of the ego or of traffic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.build import attribution
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import refuse_tight_bend
from vve_sumo.world.lone_car import PERIOD, SPEED, front_track
from vve_sumo.world.network import Network, Roads

Floats = NDArray[np.float64]

SPACING = 1.0  #: between two points of the file [m]
FINE = 0.5  #: between two points of the track as it is smoothed [m]
STANDING = 0.05  #: samples nearer than this to the last one were taken at a stop [m]
SEAM = 100.0  #: overlap over which a closed path is smoothed across its ends [m]; many times the reach of the smoothing
WEIGHTS = (1e-3, 1e5)  #: least and greatest weight of the smoothing spline's bending [m3]
BISECTIONS = 40
DECIMALS = 10  #: of a degree: a hundredth of a millimetre


class Survey(NamedTuple):
    """Figures of the recorded path."""

    edges: tuple[str, ...]  #: driven, in order
    length: float  #: of the path [m]
    points: int  #: written
    deviation: float  #: greatest distance of the path from the recorded track [m]
    curvature: float  #: greatest curvature of the cubic path through the points [1/m]
    curvature_rate: float  #: greatest change of curvature over arc length [1/m2]


def record_path(
    network: Path,
    start: str,
    end: str,
    out: Path,
    *,
    via: Sequence[str] = (),
    start_position: float = 0.0,
    end_position: float | None = None,
    tolerance: float = 0.3,
    tightest: float | None = None,
) -> Survey:
    """Drive a SUMO car from edge `start` through the edges `via` to edge `end` and write its track to `out` as CSV.

    Positions count along the edges [m]; without `end_position` the drive ends at the edge's end. Between the named
    edges the car takes the shortest route. The track is smoothed as far as it stays within `tolerance` [m] of the
    recorded one. A drive that ends where it began gives a closed path, smooth across the seam, whose last point repeats
    its first. Starts libsumo in this process. Raises ConfigError, and writes nothing, on an unknown edge, a position
    that is not on its edge, where no route exists, and where a car cannot follow the path whose tightest circle has
    the curvature `tightest` [1/m].
    """
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ConfigError(f"tolerance {tolerance}: expected a length above zero [m]")
    roads = Roads(network)
    edges = roads.route((start, *via, end))
    stop = roads.edge(end).getLength() if end_position is None else end_position
    for edge, position in ((start, start_position), (end, stop)):
        roads.place(f"{edge}_0", position)
    closed = len(edges) > 1 and (start, start_position) == (end, stop)
    points, deviation = _smoothed(_moved(front_track(network, edges, start_position, stop)), tolerance, closed)
    try:
        path = ReferencePath.from_points(points[:, 0], points[:, 1])
    except ValueError as error:
        raise ConfigError(f"{network}: from {start} to {end}: {error}") from None
    if tightest is not None:
        refuse_tight_bend(path, tightest, f"{network}: from {start} to {end}")
    _write(out, roads.network, points, edges)
    curvature = path.samples.curvature
    return Survey(
        edges=edges,
        length=path.length,
        points=len(points),
        deviation=deviation,
        curvature=float(np.max(np.abs(curvature))),
        curvature_rate=float(np.max(np.abs(np.diff(curvature) / np.diff(path.samples.s)))),
    )


def _moved(track: Floats) -> Floats:
    """Leave out the samples taken at a stop."""
    kept = [0]
    for i in range(1, len(track)):
        if math.dist(track[i], track[kept[-1]]) > STANDING:
            kept.append(i)
    return track[kept]


def _smoothed(track: Floats, tolerance: float, closed: bool) -> tuple[Floats, float]:
    """Return points about every SPACING of the smoothest spline within `tolerance`, and its greatest departure.

    The cubic smoothing spline (Reinsch 1967) over the track's arc length; straight stretches stay as they are.
    """
    line = _even(np.vstack([track, track[:1]]) if closed else track)
    seam = min(round(SEAM / FINE), len(line) - 1) if closed else 0
    if seam:
        line = np.vstack([line[-seam - 1 : -1], line, line[1 : seam + 1]])
    s = _arc_lengths(line)
    least, greatest = (math.log(weight) for weight in WEIGHTS)
    for _ in range(BISECTIONS):
        middle = (least + greatest) / 2
        within = _departure(line, _bent(line, math.exp(middle), s)) <= tolerance
        least, greatest = (middle, greatest) if within else (least, middle)
    first, last = float(s[seam]), float(s[len(line) - 1 - seam])
    even: Floats = np.linspace(first, last, round((last - first) / SPACING) + 1)
    points = _bent(line, math.exp(least), even)
    if closed:
        points[-1] = points[0]
    return points, _departure(line, _bent(line, math.exp(least), s))


def _bent(line: Floats, weight: float, at: Floats) -> Floats:
    from scipy.interpolate import make_smoothing_spline

    s = _arc_lengths(line)
    return np.stack([make_smoothing_spline(s, line[:, axis], lam=weight)(at) for axis in (0, 1)], axis=1)


def _arc_lengths(line: Floats) -> Floats:
    return np.arange(len(line), dtype=np.float64) * FINE


def _departure(line: Floats, other: Floats) -> float:
    return float(np.max(_norms(line - other)))


def _even(line: Floats) -> Floats:
    """Return points of the polyline at even distances of about FINE, both ends among them."""
    s = np.concatenate([[0.0], np.cumsum(_norms(np.diff(line, axis=0)))])
    even = np.linspace(0.0, s[-1], max(4, round(s[-1] / FINE)) + 1)
    return np.stack([np.interp(even, s, line[:, axis]) for axis in (0, 1)], axis=1)


def _norms(vectors: Floats) -> Floats:
    return np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2)


def _write(out: Path, network: Network, points: Floats, edges: tuple[str, ...]) -> None:
    frame = network.frame()
    rows = [[f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(x, y)] for x, y in points.tolist()]
    lines = [
        "# Path for the middle of the ego's rear axle, WGS84, in driving order, a point about every metre.",
        f"# Recorded on the virtual road {network.path.name}: a SUMO car drove the edges below at {SPEED:.0f} m/s,",
        f"# sampled every {PERIOD} s at its front bumper, which SUMO keeps on the lane's centre line; then smoothed.",
        *(f"# {line}" for line in attribution(network.path)),
        f"# edges: {' '.join(edges)}",
        "latitude_deg,longitude_deg",
        *(",".join(row) for row in rows),
    ]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
