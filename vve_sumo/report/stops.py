"""How a drive came to rest and what its certificate says of that, as parts of the page.

Knows stops and certificates; measures nothing itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vve_sumo.analysis.braking import Stop, comfort, stop_of
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import (
    LATE,
    TOLERANCE,
    StoppingBoundCheck,
    stopping_bound_check,
    stopping_bound_checks,
)
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.html import Column, Html, folded, sub, table, tag
from vve_sumo.report.tables import about
from vve_sumo.report.words import count, number, said

if TYPE_CHECKING:
    import pandas as pd

#: runs that broke their bound, listed at most
MOST = 50
#: a longer list is folded
LONG = 12


def stop(run: Run) -> Html:
    """Return how the drive came to rest, split into reaction, build-up and braking."""
    found = stop_of(run)
    if found is None:
        return sub("The stop", tag("p", "The drive holds no stop that was commanded and ended at rest."))
    began = f"Braking was first commanded at {number(found.onset_s, 's')}, at {number(found.onset_speed, 'm/s')}"
    asked = f"as hard as a constant {number(found.demand, 'm/s²')} would be"
    text = f"{began}, {asked}; the car stood at {number(found.rest_s, 's')}."
    return sub("The stop", tag("p", text), _split(found), _felt(run, found))


def _split(found: Stop) -> Html:
    parts = {
        "reaction": (found.reaction, "until the car's deceleration begins to rise"),
        "build-up": (found.build_up, "until it has risen"),
        "braking": (found.braking, "until rest"),
    }
    rows = [(about(name, says), number(part.duration), number(part.distance)) for name, (part, says) in parts.items()]
    time, way = (sum(part[which] for part, _ in parts.values()) for which in (0, 1))
    rows.append((about("together", "from the first command to rest"), number(time), number(way)))
    columns = ("part", Column("time [s]", True), Column("distance [m]", True))
    return table(columns, rows, "the stop split into its parts")


def _felt(run: Run, found: Stop) -> Html:
    felt = comfort(run, found)
    named = {
        label_of("mfdd_mps2"): (found.mfdd, unit_of("mfdd_mps2")),
        "maximum mean deceleration over 2 s": (felt.mean_deceleration_mps2, unit_of("_mps2")),
        label_of("max_jerk_mps3"): (felt.max_jerk_mps3, unit_of("_mps3")),
        label_of("rms_jerk_mps3"): (felt.rms_jerk_mps3, unit_of("_mps3")),
    }
    rows = [(name, number(value, unit)) for name, (value, unit) in named.items()]
    return table(("figure", Column("value", True)), rows, "how the stop felt")


def promised(run: Run) -> Html:
    """Return the certificate of a drive's stop: what the car as declared promised of it, and what happened."""
    found = stopping_bound_check(run)
    if not (found.held or found.broken):
        return Html("")
    rows = [
        (label_of("stop_onset_speed_mps"), number(found.onset_speed, "m/s")),
        (label_of("stop_demand_mps2"), number(found.demand, "m/s²")),
        ("worst latency of the loop during the stop", number(1000.0 * found.latency, "ms", 1)),
        ("declared dead time and lag of the brakes", number(1000.0 * (found.brake_delay + found.brake_lag), "ms", 1)),
        ("bound: what the car as declared needs at most", number(found.bound, "m")),
        ("what it took", number(found.distance, "m")),
        ("beyond the bound; negative is better than promised", number(found.excess, "m")),
    ]
    figures = table(("what", Column("value", True)), rows, "certificate")
    return sub("Certificate", _of_distance(found), figures, *_of_answer(found))


def _of_distance(found: StoppingBoundCheck) -> Html:
    if math.isnan(found.excess):
        return tag("p", "The record does not tell what the stop promised: the loop's latency was not taken down.")
    broke = "distance" in found.missed
    kept = f"{'BROKE' if broke else 'kept'} its bound of {number(found.bound, 'm')}"
    text = (
        f"The stop took {number(found.distance, 'm')} and {kept}, which a car with the declared brakes needs at most "
        f"for what was commanded; {number(TOLERANCE, 'm')} more are tolerated."
    )
    return tag("p", text, **_looks(broke))


def _of_answer(found: StoppingBoundCheck) -> list[Html]:
    """How the brakes answered: what was not held of it, and the figures."""
    answer, late = found.answer, [part for part in found.missed if part != "distance"]
    if math.isnan(answer.together.value):
        return [tag("p", "The record does not tell how fast the brakes answered.")]
    said = f"NOT HELD: {' and '.join(late)}" if late else "No part of it is later for sure"
    text = (
        f"How the brakes answered the commanded torque, fitted to the speed. {said}, where "
        f"{number(1000.0 * LATE, 'ms', 0)} beyond the declaration are tolerated."
    )
    declared = (found.brake_delay, found.brake_lag, found.brake_delay + found.brake_lag)
    named = ("reaction: dead time", "build-up: lag", "together")
    rows = [
        (name, _ms(part.value), f"{_ms(part.low)} to {_ms(part.high)}", _ms(wanted))
        for name, part, wanted in zip(named, answer, declared, strict=True)
    ]
    columns = ("part", Column("found [ms]", True), Column("between [ms]", True), Column("declared [ms]", True))
    return [tag("p", text, **_looks(bool(late))), table(columns, rows, "how the brakes answered")]


def _ms(time: float) -> str:
    return number(1000.0 * time, digits=0)


def _looks(bad: bool) -> dict[str, str]:
    return {"class_": "no"} if bad else {}


def flagged(rows: pd.DataFrame) -> Html:
    """Return the runs of a sweep that broke their stopping bound, the worst first."""
    told = stopping_bound_checks(rows)
    stopped = int((told["held"] | told["broken"]).sum())
    if stopped == 0:
        return Html("")
    broken = told[told["broken"]].sort_values("excess_m", ascending=False, kind="stable")
    most = f"by more than {number(TOLERANCE, 'm')}"
    longer = (
        f"{said('', len(broken)) if len(broken) else 'none'} took longer than what the car as declared needs, {most}"
    )
    text = f"{count(stopped, 'run')} braked to rest; {longer}."
    if broken.empty:
        return sub("Certificates", tag("p", text))
    columns = ("run", Column("took [m]", True), Column("bound [m]", True), Column("beyond it [m]", True))
    shown = broken.head(MOST)
    figures = zip(*(shown[name].to_numpy(float) for name in ("distance_m", "bound_m", "excess_m")), strict=True)
    keys = rows.loc[shown.index, "key"].astype(str)
    lines = [(tag("code", key), *map(number, those)) for key, those in zip(keys, figures, strict=True)]
    listed = table(columns, lines, "runs that broke their bound")
    listed = folded("Runs that broke their bound, the worst first", listed) if len(lines) > LONG else listed
    return sub("Certificates", tag("p", text, class_="no"), listed)
