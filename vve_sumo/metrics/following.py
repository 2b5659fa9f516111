"""Surrogate safety measures of one road user behind another in the same lane, on whole arrays at once.

Knows gaps, speeds and times; no record, no map, no car. Inputs broadcast, plain numbers in give a number out; NaN in
any of them is NaN in the answer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vve_sumo.values import Floats

#: a time to collision below this counts as exposure [s]; the value that conflict studies use most for cars
TTC_THRESHOLD = 1.5
#: a deceleration that would avoid a crash is not counted beyond this [m/s2]: no road car brakes so hard, which would
#: take a friction coefficient above 1.2, and next to contact the formulas grow without bound
MAX_DECELERATION = 12.0


class Rss(NamedTuple):
    """What Responsibility-Sensitive Safety assumes of two cars; by default what Intel's ad-rss proposes."""

    response: float = 1.0  #: of the rear car [s]
    acceleration: float = 3.5  #: greatest of the rear car while it does not respond yet [m/s2]
    min_braking: float = 4.0  #: that the rear car then brakes with at least [m/s2], positive
    max_braking: float = 8.0  #: that the front car brakes with at most [m/s2], positive


#: ad-rss 5.0, "Parameter discussion"
RSS = Rss()
#: ordinary following: reaction and braking of the competent and careful driver of UN R157 (0.75 s, 0.774 g). Assumed
#: besides: a follower does not accelerate meanwhile, and its leader brakes no harder than that driver either
RSS_FOLLOWING = Rss(response=0.75, acceleration=0.0, min_braking=7.59, max_braking=7.59)


def headway(gap: ArrayLike, speed: ArrayLike) -> Floats:
    """Time to cover the gap at the follower's speed [s]: bumper to bumper, what SUMO calls TGAP.

    gap: [m], negative where they overlap, and so is the answer; speed: of the follower [m/s]. inf where it does not go
    forward.
    """
    g, v = _arrays(gap, speed)
    moving = v > 0.0
    return _known(np.where(moving, _ratio(g, v, moving), np.inf), g, v)


def headway_front(gap: ArrayLike, speed: ArrayLike, leader_length: ArrayLike) -> Floats:
    """Time from the leader's front to the follower's, at the follower's speed [s]: as in the Highway Capacity Manual.

    Longer than `headway` by leader_length [m] over speed [m/s]; gap [m] as there. inf where the follower does not go
    forward.
    """
    return headway(np.asarray(gap, np.float64) + np.asarray(leader_length, np.float64), speed)


def time_to_collision(gap: ArrayLike, closing_speed: ArrayLike) -> Floats:
    """Time until the gap is used up at constant speeds [s] (TTC, Hayward 1972): gap over closing speed.

    gap: bumper to bumper [m]; closing_speed: follower's minus leader's [m/s]. inf where it does not close, 0 where the
    gap is used up already.
    """
    g, dv = _arrays(gap, closing_speed)
    closing = dv > 0.0
    return _known(np.where(g <= 0.0, 0.0, np.where(closing, _ratio(g, dv, closing), np.inf)), g, dv)


def modified_time_to_collision(gap: ArrayLike, closing_speed: ArrayLike, closing_acceleration: ArrayLike) -> Floats:
    """Time until the gap is used up at constant accelerations [s] (MTTC, Ozbay et al. 2008).

    The smallest positive root of g - dv t - da t^2 / 2 = 0; closing_acceleration is the follower's minus the leader's
    [m/s2], the others as in `time_to_collision`; inf where there is no root, 0 where the gap is used up already. As
    published: a car that has come to rest goes on with its acceleration, backwards, so a leader that brakes to a stop
    is met too early.
    """
    g, dv, da = _arrays(gap, closing_speed, closing_acceleration)
    square = dv * dv + 2.0 * da * g
    root = np.sqrt(np.maximum(square, 0.0))
    # Of two forms of the same root the one that adds what has one sign, so nothing cancels however small da is.
    closing, gaining = (dv > 0.0) | ((dv == 0.0) & (da > 0.0)), (dv < 0.0) & (da > 0.0)
    time = np.where(gaining, _ratio(root - dv, da, gaining), np.inf)
    time = np.where(closing, _ratio(2.0 * g, dv + root, closing), time)
    return _known(np.where(g <= 0.0, 0.0, np.where(square < 0.0, np.inf, time)), g, dv, da)


def required_deceleration(gap: ArrayLike, closing_speed: ArrayLike, delay: ArrayLike = 0.0) -> Floats:
    """Constant deceleration, begun after `delay`, that just avoids contact with a leader of constant speed [m/s2].

    dv^2 / (2 (g - dv delay)): without a delay DRAC (Almqvist et al. 1991), with one, a perception-reaction time [s],
    MDRAC, which is dv / (2 (TTC - delay)) as well. Positive is braking; 0 where the gap [m] does not close, inf where
    it is used up before the brakes answer.
    """
    g, dv, tau = _arrays(gap, closing_speed, delay)
    rest = g - dv * tau
    closing, room = dv > 0.0, rest > 0.0
    needed = np.where(room, _ratio(0.5 * dv * dv, rest, room), np.inf)
    return _known(np.where(closing, needed, 0.0), g, dv, tau)


def rss_distance(speed: ArrayLike, leader_speed: ArrayLike, assumed: Rss = RSS) -> Floats:
    """Least gap that is safe behind a leader that goes the same way [m], Responsibility-Sensitive Safety.

    v rho + a rho^2 / 2 + (v + rho a)^2 / (2 b_least) - w^2 / (2 b_greatest), not below 0 (Shalev-Shwartz, Shammah and
    Shashua 2017, definition 1). speed, leader_speed: forward [m/s]; NaN where one is negative, which the rule for one
    direction says nothing of.
    """
    v, w = _arrays(speed, leader_speed)
    rho, a = assumed.response, assumed.acceleration
    way = v * rho + 0.5 * a * rho * rho + (v + rho * a) ** 2 / (2.0 * assumed.min_braking)
    distance = np.maximum(way - w * w / (2.0 * assumed.max_braking), 0.0)
    safe: Floats = np.where((v >= 0.0) & (w >= 0.0), distance, np.nan)[()]
    return safe


def time_exposed(time: Floats, ttc: Floats, threshold: float = TTC_THRESHOLD) -> float:
    """Time spent with a time to collision below the threshold [s] (TET, Minderhoud and Bovy 2001).

    time, ttc: [s], one entry a tick; what holds at a tick holds until the next, and the last one counts no time. NaN,
    where nothing closes in, is no exposure. NaN for no ticks at all.
    """
    return _over(time, (ttc < threshold).astype(np.float64))


def time_integrated(time: Floats, ttc: Floats, threshold: float = TTC_THRESHOLD) -> float:
    """By how much the time to collision lay below the threshold, summed over time [s2] (TIT, Minderhoud and Bovy 2001).

    Arguments as in `time_exposed`.
    """
    return _over(time, np.where(ttc < threshold, threshold - ttc, 0.0))


def crash_potential_index(time: Floats, deceleration: Floats, available: float) -> float:
    """Share of the time in which avoiding a crash takes more than the car has (CPI, Cunto and Saccomanno 2007).

    deceleration: DRAC, tick by tick [m/s2], NaN where nothing closes in; available: the greatest deceleration that the
    car can do (MADR) [m/s2]. There MADR is random; here it is the one car's own, and so the probability 0 or 1. The
    whole time counts, also without a leader. NaN where no time passes.
    """
    whole = float(time[-1] - time[0]) if len(time) else 0.0
    return _over(time, (deceleration > available).astype(np.float64)) / whole if whole > 0.0 else float("nan")


def _over(time: Floats, rate: Floats) -> float:
    """Sum of a rate over time, each entry held until the next."""
    return float(np.sum(rate[:-1] * np.diff(time))) if len(time) else float("nan")


def _arrays(*values: ArrayLike) -> tuple[Floats, ...]:
    return tuple(np.broadcast_arrays(*(np.asarray(value, np.float64) for value in values)))


def _ratio(above: Floats, below: Floats, where: ArrayLike) -> Floats:
    """Quotient where it is asked for, else 1; one too large for a float is inf, as it should be."""
    with np.errstate(over="ignore"):
        return np.divide(above, below, out=np.ones_like(above), where=np.asarray(where, np.bool_))


def _known(answer: Floats, *inputs: Floats) -> Floats:
    """Return the answer, NaN where an input is."""
    unknown = np.logical_or.reduce([np.isnan(value) for value in inputs])
    known: Floats = np.where(unknown, np.nan, answer)[()]
    return known
