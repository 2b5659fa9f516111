"""Says where beside its path the rear axle may go: what bodies leave of the road, when the car gets there.

The road is a row of nodes, equally far from each other along the path. It must not know how a way is planned through
them, nor what is done where there is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import swept_half_widths
from vve_sumo.values import Vehicle

from .outlines import Body

LEFT, RIGHT = 1, -1  #: the side of a body that the car passes on
HIDDEN: Final = 4.5  #: way along the path that a body may reach beyond what is seen of it [m]
HIDDEN_SMALL: Final = 0.6  #: the same of a person or a bicycle [m]
FOLLOWS: Final = 1.0  #: of that as much at most before and behind one that goes along [s]
SPREAD_LIMIT: Final = 0.8  #: what is not known of a crossing body's place counts up to this [m]


class Room(NamedTuple):
    """What bodies leave free at each node."""

    low: list[float]  #: least d of the rear axle [m], left positive; -inf where nothing is on that side
    high: list[float]  #: greatest d of the rear axle [m]; inf likewise

    def within(self, right: float, left: float) -> Room:
        """Return the room that the road leaves of it, `right` and `left` of the path [m]."""
        return Room([max(low, -right) for low in self.low], [min(high, left) for high in self.high])


@dataclass(frozen=True, slots=True)
class Nodes:
    """Places along the path, and what the car covers there."""

    s: np.ndarray  #: of the nodes [m]
    curvature: np.ndarray  #: of the path there [1/m]
    left: np.ndarray  #: reach of the body to the left of the rear axle's line [m]
    right: np.ndarray  #: the same to the right [m]
    front: float  #: from the rear axle to the front bumper [m]
    rear: float  #: to the rear bumper [m]

    @classmethod
    def of(cls, vehicle: Vehicle, s: np.ndarray, curvature: np.ndarray) -> Nodes:
        """Return the nodes of a car."""
        left, right = swept_half_widths(curvature, vehicle.rear_axle_to_bumper, vehicle.width)
        return cls(s, curvature, left, right, vehicle.rear_axle_to_bumper, vehicle.rear_overhang)


class Margins(NamedTuple):
    """How far the car keeps from bodies."""

    clearance: float  #: between the car's side and a body [m]
    lengthwise: float  #: before and behind a body [m]
    slack: float  #: and by so long before and behind one that comes nearer along the path [s]
    sigmas: float = 2.0  #: of what is not known of a crossing body's speed


def side_of(body: Body) -> int:
    """Return the side that the car passes a body on that is not in its way."""
    return RIGHT if float(body.d.min() + body.d.max()) > 0.0 else LEFT


def sides_to_pass(bodies: Sequence[Body], blocking: Sequence[Body]) -> list[list[int]]:
    """Return the choices of sides to pass on: all that block on the left, on the right, each on its freer side."""
    choices = []
    for choose in (LEFT, RIGHT, 0):
        if (choose == 0 and len(blocking) < 2) or (choose == RIGHT and not blocking):
            continue
        chosen = {id(body): choose or side_of(body) for body in blocking}
        choices.append([chosen.get(id(body), side_of(body)) for body in bodies])
    return choices


def hidden_length(body: Body) -> float:
    """Return how far a body may reach along the path beyond what is seen of it [m]."""
    return HIDDEN_SMALL if body.small else max(HIDDEN - float(np.ptp(body.s)), 0.5)


def room(nodes: Nodes, times: Sequence[float], bodies: Sequence[Body], sides: Sequence[int], keeps: Margins) -> Room:
    """Return the room at the nodes, which the rear axle reaches after `times` [s], passing bodies on given sides."""
    count = len(nodes.s)
    low, high = np.full(count, -math.inf), np.full(count, math.inf)
    at = np.array(times)
    for body, side in zip(bodies, sides, strict=True):
        beside, d, spread = _beside(nodes, at, body, keeps, 0.0)
        if not beside.any():
            continue
        away = keeps.clearance + spread
        if side == LEFT:
            most = np.where(beside, d, -math.inf).max(axis=1) + nodes.right + away
            low = np.maximum(low, most)
        else:
            least = np.where(beside, d, math.inf).min(axis=1) - nodes.left - away
            high = np.minimum(high, least)
    return Room(low.tolist(), high.tolist())


def clearances(nodes: Nodes, times: Sequence[float], way_d: Sequence[float], body: Body, keeps: Margins) -> list[float]:
    """Return how near a body is to the car's side at each node of a way [m]; inf where it is not beside the car.

    `way_d` are the rear axle's [m], `times` when it is there [s]. Negative where the body is in the way. A car that
    leaves its path steeply has its front much farther out than its rear axle. -inf where a number is none.
    """
    at, way = np.array(times), np.array(way_d)
    beside, d, spread = _beside(nodes, at, body, keeps, 0.0)
    ahead = (body.s[None, :] + body.along * at[:, None] - nodes.s[:, None]).clip(-nodes.rear, nodes.front)
    away = d - way[:, None] - _slopes(way, nodes.s)[:, None] * ahead
    gap = np.where(away > 0.0, away - nodes.left[:, None], -away - nodes.right[:, None])
    both = _straddled(away, beside)
    least = np.where(beside, gap, math.inf).min(axis=1) - spread
    nearest = np.where(both, np.minimum(least, 0.0), least)
    kept: list[float] = np.where(np.isnan(nearest), -math.inf, nearest).tolist()
    return kept


def _slopes(d: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.gradient(d, s) if len(d) > 1 else np.zeros(len(d))


def _straddled(away: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return whether points of a body lie on both sides of the car's line at a node: it is in the way, whole."""
    straddled: np.ndarray = np.logical_and(
        np.any(beside & (away > 0.0), axis=1), np.any(beside & (away <= 0.0), axis=1)
    )
    return straddled


def _beside(
    nodes: Nodes, times: np.ndarray, body: Body, keeps: Margins, since: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which points are beside the car at each node, their d there [m], and how uncertain those are [m].

    What is hidden of a body reaches from each of its points on along the path.
    """
    ahead = times[:, None] + since
    s, d = body.s[None, :] + body.along * ahead, body.d[None, :] + body.across * ahead
    hidden = hidden_length(body)
    slack = keeps.slack if body.along < 0.0 else min(keeps.slack, FOLLOWS)
    far = keeps.lengthwise + slack * abs(body.along)
    at = nodes.s[:, None]
    beside: np.ndarray = (s + hidden + far >= at - nodes.rear) & (s - far <= at + nodes.front)
    spread = np.minimum(keeps.sigmas * body.sigma * times, SPREAD_LIMIT) if body.across else np.zeros(len(times))
    return beside, d, spread
