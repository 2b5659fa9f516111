"""Numbers, names of figures and verdicts in the words that people read.

Knows names of figures and what they mean; neither HTML nor where a value comes from.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from vve_sumo.analysis.units import unit_of

#: where a text stands for a number that is not there
NONE = "none"
#: between a number and its unit, which stay in one line
SPACE = "\u00a0"
MINUS = "\u2212"


class Figure(NamedTuple):
    """A figure of a drive as people call it."""

    name: str
    meaning: str


#: figures of a drive's summary, by their keys, in the order in which they are told
FIGURES: dict[str, Figure] = {
    "outcome": Figure("outcome", "how the drive ended"),
    "collision": Figure("collision", "whether the car's outline overlapped another's at any tick"),
    "impact_speed_mps": Figure("impact speed", "relative, at the first contact"),
    "stop_gap_m": Figure(
        "gap at rest", "front bumper to what stood ahead, along the path, once the car stood; negative is overlap"
    ),
    "min_gap_m": Figure("closest approach", "least gap at any tick; negative is overlap"),
    "min_ttc_s": Figure("least time to collision", "gap over closing speed, the least at any tick"),
    "max_drac_mps2": Figure("greatest deceleration needed", "to avoid a contact (DRAC), the greatest at any tick"),
    "max_deceleration_mps2": Figure("greatest deceleration", "of the rear axle along its heading"),
    "max_speed_mps": Figure("greatest speed", "of the rear axle along its heading"),
    "max_lateral_deviation_m": Figure("greatest lateral deviation", "of the rear axle from its path"),
    "emergency_used": Figure("emergency layer", "whether it braked the car"),
    "duration_s": Figure("drive time", "from the first tick to the last"),
    "ticks": Figure("ticks", "steps of the drive that the record holds"),
    "anchor_position_error_m": Figure("error of SUMO's ego, place", "from what was asked of it, the greatest"),
    "anchor_speed_error_mps": Figure("error of SUMO's ego, speed", "from what was asked of it, the greatest"),
    "stop_distance_m": Figure("stopping distance", "of the last stop, from the first command to rest"),
    "stop_bound_m": Figure("bound of the stopping distance", "what the car as declared needs for that stop at most"),
    "stop_onset_speed_mps": Figure("speed at the onset", "of the last stop"),
    "stop_demand_mps2": Figure("deceleration granted", "in the last stop, as a constant one"),
    "stop_reaction_s": Figure("reaction", "of the last stop, until the deceleration begins to rise"),
    "stop_build_up_s": Figure("build-up", "of the last stop, until the deceleration has risen"),
    "mfdd_mps2": Figure("mean fully developed deceleration (MFDD)", "of the last stop"),
    "prediction_error_100ms_mean_m": Figure("prediction over 100 ms, mean error", "against what was measured then"),
    "prediction_error_100ms_max_m": Figure("prediction over 100 ms, greatest error", "against what was measured then"),
}

#: what a table of the analysis may have beside them
MEASURES: dict[str, Figure] = {
    "tet_s": Figure("time exposed (TET)", "time with a time to collision below 1.5 s"),
    "tit_s2": Figure("time integrated (TIT)", "by how much the time to collision lay below 1.5 s, summed over time"),
    "cpi_share": Figure(
        "crash potential index (CPI)",
        "share of the time in which more deceleration was needed than the car is declared to reach",
    ),
    "rss_share": Figure("gap shorter than safe (RSS)", "share of the time, by Responsibility-Sensitive Safety"),
    "max_jerk_mps3": Figure("greatest jerk", "rate of change of the acceleration"),
    "rms_jerk_mps3": Figure("jerk, root mean square", "over the whole drive"),
    "rms_acceleration_mps2": Figure("acceleration, root mean square", "over the whole drive"),
    "first_s": Figure("first seen", ""),
    "first_range_m": Figure("first range", ""),
    "first_ttc_s": Figure("first TTC", ""),
    "detected_share": Figure("share detected", ""),
    "dropouts": Figure("drop-outs", ""),
    "dropouts_hidden": Figure("drop-outs, hidden", ""),
    "longest_dropout_s": Figure("longest drop-out", ""),
    "range_error_mean_m": Figure("range error, mean", ""),
    "range_error_std_m": Figure("range error, std", ""),
    "range_rate_error_mean_mps": Figure("range rate error, mean", ""),
    "range_rate_error_std_mps": Figure("range rate error, std", ""),
    "p50_ms": Figure("median", ""),
    "p95_ms": Figure("95 %", ""),
    "p99_ms": Figure("99 %", ""),
    "max_ms": Figure("greatest", ""),
    "n": Figure("ticks", ""),
}


def figure_of(key: str) -> Figure:
    """Return what a figure is called; of one that nobody named, its key without the unit."""
    unit = unit_of(key)
    bare = key.rpartition("_")[0] if unit or key.endswith("_share") else key
    return (FIGURES | MEASURES).get(key, Figure(bare.replace("_", " "), ""))


def number(value: float, unit: str = "", digits: int | None = None) -> str:
    """Return a number with its unit; what is not there is `none`, small numbers keep three decimals."""
    if not math.isfinite(value):
        return NONE if math.isnan(value) else (f"{MINUS}∞" if value < 0.0 else "∞")
    places = digits if digits is not None else (2 if abs(value) >= 0.1 or value == 0.0 else 3)
    said = f"{value:.{places}f}".replace("-", MINUS)
    said = said.removeprefix(MINUS) if not float(f"{value:.{places}f}") else said
    return f"{said}{SPACE}{unit}" if unit else said


def short(value: object) -> str:
    """Return a value of a setting or parameter as briefly as it can be said without loss for people."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    return str(value) if isinstance(value, str | int) else json.dumps(value, ensure_ascii=False)


def said(key: str, value: object) -> str:
    """Return a figure's value with the unit that its key ends in."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return short(value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u2009")
    return number(float(value), unit_of(key)) if isinstance(value, float) else short(value)


def with_unit(key: str, value: object) -> str:
    """Return a setting's value with the unit that its key ends in."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{short(value)}{SPACE}{unit_of(key)}".rstrip() if is_number else short(value)


def asked(key: str, wanted: object) -> str:
    """Return what a criterion asks for: a truth value, a word or a band with `min` and `max`."""
    if not isinstance(wanted, Mapping):
        return short(wanted)
    low, high = wanted.get("min"), wanted.get("max")
    if low is None or high is None:
        return f"at most {with_unit(key, high)}" if low is None else f"at least {with_unit(key, low)}"
    return f"{short(low)} to {with_unit(key, high)}"


def flat(settings: Mapping[str, Any], stem: str = "") -> Iterator[tuple[str, object]]:
    """Return settings as dotted keys with their values; a member of a list goes by its `id`, else by its number."""
    for key, value in settings.items():
        name = f"{stem}{key}"
        inner = value
        if isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            inner = {str(one.get("id") or count): one for count, one in enumerate(value)}
        if isinstance(inner, Mapping) and inner:
            yield from flat(inner, f"{name}.")
        else:
            yield name, ({} if isinstance(inner, Mapping) else value)


def count(many: int, one: str, more: str = "") -> str:
    """Return how many there are of something: 1 run, 2 runs."""
    return f"{said('', many)} {one if many == 1 else more or one + 's'}"


def share(part: float) -> str:
    """Return a share in percent, to a tenth; a whole or nothing only where it is just that."""
    if not 0.0 <= part <= 1.0:
        return NONE
    told = 100.0 * part if part in (0.0, 1.0) else min(max(100.0 * part, 0.1), 99.9)
    return f"{told:.1f} %".replace(".0 %", " %")
