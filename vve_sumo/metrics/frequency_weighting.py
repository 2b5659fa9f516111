"""Frequency weightings of ISO 2631-1, as digital filters of signals that are sampled at even times.

Knows signals and the parameters of the standard; neither cars nor what a weighted acceleration adds up to. The filters
run in plain Python: importing scipy.signal takes longer than filtering a drive of ten minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.values import Floats

#: quality factor of the two filters that limit the band, of second order (Butterworth)
BUTTERWORTH: Final = 1.0 / math.sqrt(2.0)


@dataclass(frozen=True, slots=True)
class Step:
    """Upward step: the gain rises from (f5 / f6)^2 below both frequencies to 1 above them."""

    zero: float  #: f5 [Hz]
    zero_quality: float  #: Q5
    pole: float  #: f6 [Hz]
    pole_quality: float  #: Q6


@dataclass(frozen=True, slots=True)
class Weighting:
    """Parameters of a weighting (ISO 2631-1:1997, annex A; the same in table 3 of ISO 8041-1:2017)."""

    high_pass: float  #: f1, lower limit of the band [Hz]
    low_pass: float  #: f2, upper limit of the band [Hz]
    zero: float  #: f3 of the transition from constant acceleration to constant velocity [Hz]; inf for none
    pole: float  #: f4 of that transition [Hz]
    quality: float  #: Q4
    step: Step | None = None  #: None for none


#: horizontal acceleration of a seated person: fore and aft, lateral
WD: Final = Weighting(0.4, 100.0, 2.0, 2.0, 0.63)
#: motion sickness, by the standard of vertical acceleration
WF: Final = Weighting(0.08, 0.63, math.inf, 0.25, 0.86, Step(0.0625, 0.80, 0.1, 0.80))


class Section(NamedTuple):
    """Filter of second order: y[n] = b0 x[n] + b1 x[n-1] + b2 x[n-2] - a1 y[n-1] - a2 y[n-2]."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


def sections(weighting: Weighting, period: float) -> list[Section]:
    """Return the sections whose chain weights a signal that is sampled every `period` [s].

    By the bilinear transform, each frequency of the standard prewarped to itself. A low-pass at half the sampling rate
    or above is left out: at 50 Hz that is the one of Wd, whose gain is 0.998 at 25 Hz. Of what a signal that is sampled
    at 50 Hz can hold, Wd so comes out within 0.1 % up to 2 Hz, 3 % too low at 5 Hz and 13 % at 10 Hz; Wf within 1 % up
    to 1.25 Hz, where it is 0.01.
    """
    f1, f2, f3, f4 = weighting.high_pass, weighting.low_pass, weighting.zero, weighting.pole
    made = [_section((1.0, 0.0, 0.0), f1, (1.0, 1.0 / BUTTERWORTH, 1.0), f1, period)]
    if f2 * period < 0.5:
        made.append(_section((0.0, 0.0, 1.0), f2, (1.0, 1.0 / BUTTERWORTH, 1.0), f2, period))
    rise = f4 / f3
    made.append(_section((0.0, rise, 1.0), f4, (1.0, 1.0 / weighting.quality, 1.0), f4, period))
    if step := weighting.step:
        low = (step.zero / step.pole) ** 2
        zeros = (low, low / step.zero_quality, low)
        made.append(_section(zeros, step.zero, (1.0, 1.0 / step.pole_quality, 1.0), step.pole, period))
    return made


Quadratic = tuple[float, float, float]


def _section(zeros: Quadratic, zero: float, poles: Quadratic, pole: float, period: float) -> Section:
    """Return the section of a quotient of quadratics in s / w, each with its own frequency w / 2 pi [Hz]."""
    b0, b1, b2 = _transformed(zeros, zero, period)
    a0, a1, a2 = _transformed(poles, pole, period)
    return Section(b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0)


def _transformed(quadratic: Quadratic, frequency: float, period: float) -> Quadratic:
    """Return a quadratic in s / w times (1 + 1/z)^2, with s / w = (1 - 1/z) / (1 + 1/z) / tan(pi f T)."""
    second, first, constant = quadratic
    scale = 1.0 / math.tan(math.pi * frequency * period)
    square, linear = second * scale * scale, first * scale
    return square + linear + constant, 2.0 * (constant - square), square - linear + constant


def weighted(signal: Floats, weighting: Weighting, period: float) -> Floats:
    """Return a weighted signal, sampled every `period` [s], shape (n,); before its first sample it was 0.

    NaN stays from where it is first met.
    """
    values: list[float] = signal.tolist()
    for section in sections(weighting, period):
        values = _filtered(values, section)
    return np.array(values, np.float64)


def _filtered(values: list[float], section: Section) -> list[float]:
    """Return what a section makes of values (transposed direct form II)."""
    b0, b1, b2, a1, a2 = section
    first = second = 0.0
    answer = []
    for value in values:
        out = b0 * value + first
        first = b1 * value - a1 * out + second
        second = b2 * value - a2 * out
        answer.append(out)
    return answer
