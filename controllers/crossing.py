"""Foresees who will be in the swept band when the car gets there, and who will have left it.

It knows places and speeds across the path, and no tracks, no brakes. That something crosses must hold by several
standard deviations: full braking hangs on it, and somebody may follow close behind.
"""

from __future__ import annotations

import math
from typing import Final

from .bank import Bank, SpeedHypothesis
from .trend import Trend

CROSSES: Final = 4.0  #: standard deviations of speed across the path that tell crossing from noise
IN, LEFT = 2.5, 1.0  #: standard deviations by which one must be foreseen to be in the band, or beyond it
COMES_OVER: Final = 2.0  #: standard deviations of speed across the path that tell changing lanes from keeping one
PREDICTION_HORIZON: Final = 3.0  #: nothing is foretold farther ahead than this [s]
#: Its standard deviation must be less than this: one seen for the first time changes no lane yet [m/s]
KNOWN: Final = 0.5
ON_FOOT: Final = 3.0  #: who crosses faster than this is not walking [m/s]
SPEED_SIGMA: Final = 0.15  #: of a speed that lies between two of the bank's [m/s]
LATERAL_AGILITY: Final = 0.05  #: spectral density of the acceleration of who crosses [m2/s3]
FRONT: Final = 4.0  #: from the rear of a car that comes over to its front [m]
WALKER, VEHICLE = 0.5, 4.0  #: way across the path that at least follows the edge that comes first [m]


def crosses(across: Trend, surely: float = CROSSES) -> bool:
    """Tell whether something moves across the path by so many standard deviations."""
    return across.rate * across.rate > surely * surely * across.rate_variance


def will_be_in(across: Trend, left: float, right: float, arrival: float) -> bool:
    """Tell whether a crossing thing is surely within `left` and `right` of the path [m] after `arrival` [s].

    What is seen of one who comes nearer is the edge that enters first; the body follows it.
    """
    if not arrival <= PREDICTION_HORIZON:
        return False
    now, then, sigma, enters, leaves = _forecast(across, left, right, arrival)
    follows = 0.0 if now > 0.0 else WALKER if abs(across.rate) < ON_FOOT else VEHICLE
    return enters + IN * sigma <= then <= leaves + follows - IN * sigma


def probability_in(bank: Bank, left: float, right: float, begins: float, ends: float) -> float:
    """Return how probable it is that a body is in the band, `left` and `right` of the path [m], at some time.

    That time is between `begins` and `ends` [s]. The target keeps its speed until then, but for what `_spread` says;
    one that stands keeps its place.
    """
    probability = 0.0
    for mode in bank.modes():
        now, enters, leaves = _onward(mode, left, right)
        pace = abs(mode.speed)
        follows = 0.0 if now > 0.0 else WALKER if pace < ON_FOOT else VEHICLE
        early, late = (math.sqrt(mode.variance + (_spread(time) if pace else 0.0)) for time in (begins, ends))
        has_come = _normal((now + pace * ends - enters) / late)
        has_gone = _normal((now + pace * begins - follows - leaves) / early)
        probability += mode.probability * max(has_come - has_gone, 0.0)
    return probability


def probability_of_cutting_in(bank: Bank, left: float, right: float, within: float, along: float) -> float:
    """Return how probable it is that a car that goes `along` the path [m/s] comes into the band within a time [s].

    The point that is seen of it is its rear corner. A car that comes over is turned, and its front corner comes first.
    """
    probability = 0.0
    for mode in bank.modes():
        now, enters, leaves = _onward(mode, left, right)
        if mode.speed and now <= leaves:
            sigma = math.sqrt(mode.variance + _spread(within))
            comes = now + abs(mode.speed) * (within + FRONT / along)
            probability += mode.probability * _normal((comes - enters) / sigma)
    return probability


def _onward(mode: SpeedHypothesis, left: float, right: float) -> tuple[float, float, float]:
    """Place now, where the band begins and ends, counted in the way it goes; one that stands: towards the middle."""
    if (mode.speed or -mode.place) > 0.0:
        return mode.place, -right, left
    return -mode.place, -left, right


def _spread(time: float) -> float:
    """Return the variance of a place after a time [s] because a speed lies between two of the bank's, and changes."""
    return time * time * (SPEED_SIGMA * SPEED_SIGMA + LATERAL_AGILITY * time / 3.0)


def _normal(sigmas: float) -> float:
    """Return the distribution function of the standard normal distribution."""
    return 0.5 * math.erfc(-math.sqrt(0.5) * sigmas)


def comes_over(across: Trend, left: float, right: float, within: float, surely: float) -> bool:
    """Tell whether what goes along with the car comes into the band within a time [s], by so many standard deviations.

    Unlike one who crosses it stays there: the edge that is seen first counts, and not where it would be later.
    """
    if not (across.rate_variance < KNOWN * KNOWN and crosses(across, COMES_OVER)):
        return False
    now, then, sigma, enters, leaves = _forecast(across, left, right, within)
    return now <= leaves and then - surely * sigma >= enters


def will_have_left(across: Trend, left: float, right: float, arrival: float) -> bool:
    """Tell whether a crossing thing is surely beyond the far side after `arrival` [s].

    It must be past the middle: only then is the edge that is seen the last one.
    """
    now, then, sigma, _, leaves = _forecast(across, left, right, min(arrival, PREDICTION_HORIZON))
    return now > 0.0 and then - LEFT * sigma > leaves


def _forecast(across: Trend, left: float, right: float, arrival: float) -> tuple[float, float, float, float, float]:
    """Place now, place then, its standard deviation, where the band begins and ends: all counted in the way it goes."""
    then, variance = across.ahead(arrival)
    sigma = math.sqrt(variance)
    if across.rate > 0.0:
        return across.value, then, sigma, -right, left
    return -across.value, -then, sigma, -left, right
