"""How a drive came to rest, and whether its stop kept the bound of the vehicle as declared.

Knows stops and stopping-bound checks; measures nothing itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vve_sumo.analysis.braking import Stop, comfort, stop_of
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import (
    LATE,
    StoppingBoundCheck,
    stopping_bound_check,
    stopping_bound_checks,
)
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import count, integer, number
from vve_sumo.report.tables import Cell, Column, ReportTable, Row

if TYPE_CHECKING:
    import pandas as pd

#: runs that broke their bound, listed at most
MAX_ROWS = 50


def stop(run: Run) -> dict[str, object]:
    """Return how the drive came to rest, split into reaction, build-up and braking; `stop` is None where it did not."""
    braking = stop_of(run)
    if braking is None:
        return {"stop": None}
    begin = f"Braking was first commanded at {number(braking.onset_s, 's')}, at {number(braking.onset_speed, 'm/s')}"
    demand = f"as hard as a constant {number(braking.demand, 'm/s²')} would be"
    rest = f"from {number(braking.rest_s, 's')} on the car was at rest, which is slower than {number(AT_REST, 'm/s')}"
    text = f"{begin}, {demand}; {rest}."
    return {
        "stop": text,
        "stop_hunting": _hunting(run),
        "stop_parts": _split(braking),
        "stop_comfort": _comfort(run, braking),
    }


def _hunting(run: Run) -> Cell | None:
    """Return the warning of an approach on which the car gained speed and braked again, time after time."""
    approach = run.data.approach
    if approach is None or not approach.hunting:
        return None
    count = f"{approach.reversals} sign changes of the acceleration"
    way = f"over {number(approach.distance, 'm')} and {number(approach.duration, 's')}"
    text = f"HUNTING on the approach: {count} {way}. The car gained speed and braked again on its way to rest."
    return Cell(text, kind="no")


def _split(braking: Stop) -> ReportTable:
    parts = {
        "reaction": (braking.reaction, "until the car's deceleration begins to rise"),
        "build-up": (braking.build_up, "until it has risen"),
        "braking": (braking.braking, "until rest"),
    }
    rows = [(Cell(name, text), number(part.duration), number(part.distance)) for name, (part, text) in parts.items()]
    time, distance = (sum(part[which] for part, _ in parts.values()) for which in (0, 1))
    rows.append((Cell("together", "from the first command to rest"), number(time), number(distance)))
    return ReportTable(
        "the stop split into its parts", ("part", Column("time [s]", True), Column("distance [m]", True)), rows
    )


def _comfort(run: Run, braking: Stop) -> ReportTable:
    felt = comfort(run, braking)
    figures = {
        label_of("mfdd_mps2"): (braking.mfdd, unit_of("mfdd_mps2")),
        "maximum mean deceleration over 2 s": (felt.mean_deceleration_mps2, unit_of("_mps2")),
        f"{label_of('max_jerk_mps3')} of the stop": (felt.max_jerk_mps3, unit_of("_mps3")),
        f"{label_of('rms_jerk_mps3')} of the stop": (felt.rms_jerk_mps3, unit_of("_mps3")),
    }
    rows = [(name, number(value, unit)) for name, (value, unit) in figures.items()]
    return ReportTable("comfort of the stop", ("figure", Column("value", True)), rows)


def bound_check(run: Run) -> dict[str, object]:
    """Return the stopping-bound check of a drive: what the vehicle as declared needs at most, and what it took.

    `bound_check` is None where the drive holds no stop to check.
    """
    check = stopping_bound_check(run)
    if math.isnan(check.distance):
        return {"bound_check": None}
    rows = [
        (label_of("stop_onset_speed_mps"), number(check.onset_speed, "m/s")),
        (label_of("stop_demand_mps2"), number(check.demand, "m/s²")),
        ("worst latency of the loop during the stop", number(1000.0 * check.latency, "ms", 1)),
        ("declared dead time and lag of the brakes", number(1000.0 * (check.brake_delay + check.brake_lag), "ms", 1)),
        ("bound: what the car as declared needs at most", number(check.bound, "m")),
        ("stopping distance", number(check.distance, "m")),
        ("stopping distance less the bound; negative is within the bound", number(check.excess, "m")),
        ("tolerated of that", number(check.tolerance, "m")),
        *((f"… for {name}", number(term, "m")) for name, term in _terms(check).items()),
    ]
    return {
        "bound_check": ReportTable("stopping-bound check", ("what", Column("value", True)), rows),
        "distance": _distance(check),
        "answer": _answer(check),
        "answers": _answers(check),
    }


def _terms(check: StoppingBoundCheck) -> dict[str, float]:
    """Return the terms of the tolerance by what is not known exactly; none where nothing is judged."""
    words = ("brakes and mass, and the ripple of the course", "grade", "speed", "the tick of the onset")
    return {} if math.isnan(check.tolerance) else dict(zip(words, check.terms, strict=True))


def status(run: Run) -> dict[str, object]:
    """Return in a few words what the section on the stop holds, and whether it says that something is wrong."""
    check, hunting = stopping_bound_check(run), _hunting(run) is not None
    words = ["HUNTING"] * hunting
    if check.held or check.broken:
        words.append(f"stopping bound {'BROKEN' if check.broken else 'kept'}")
    return {"stop_status": ", ".join(words), "stop_wrong": check.broken or hunting}


def _distance(check: StoppingBoundCheck) -> Cell:
    if math.isnan(check.excess):
        return Cell("The stopping distance cannot be checked: the record does not hold the latency of the loop.")
    if math.isnan(check.tolerance):
        return Cell("The stopping distance is not checked: the car gained speed on its way to rest.")
    broke = "distance" in check.missed
    kept = f"{'BROKE' if broke else 'kept'} its bound of {number(check.bound, 'm')}"
    text = (
        f"The stop took {number(check.distance, 'm')} and {kept}, which a car with the declared brakes needs at most "
        f"for what was commanded; {number(check.tolerance, 'm')} more are tolerated."
    )
    return Cell(text, kind="no" if broke else "")


def _answer(check: StoppingBoundCheck) -> Cell:
    """Return what of the declared response of the brakes was not kept."""
    late = [part for part in check.missed if part != "distance"]
    if math.isnan(check.answer.together.value):
        return Cell("The record does not show how fast the brakes answered.")
    kept = f"LATER THAN DECLARED: {' and '.join(late)}" if late else "No part is certainly later than declared"
    text = f"The response of the brakes to the commanded torque, fitted to the speed. {kept}"
    return Cell(f"{text}; {number(1000.0 * LATE, 'ms', 0)} are tolerated.", kind="no" if late else "")


def _answers(check: StoppingBoundCheck) -> ReportTable:
    declared = (check.brake_delay, check.brake_lag, check.brake_delay + check.brake_lag)
    names = ("reaction: dead time", "build-up: lag", "together")
    rows = [
        (name, _ms(part.value), f"{_ms(part.low)} to {_ms(part.high)}", _ms(wanted))
        for name, part, wanted in zip(names, check.answer, declared, strict=True)
    ]
    columns = ("part", Column("measured [ms]", True), Column("between [ms]", True), Column("declared [ms]", True))
    return ReportTable("how the brakes answered", columns, [] if math.isnan(check.answer.together.value) else rows)


def _ms(time: float) -> str:
    return number(1000.0 * time, digits=0)


def bound_checks(rows: pd.DataFrame) -> dict[str, object]:
    """Return the stopping-bound checks of a sweep's runs; `bound_checks` is None where no run braked to rest."""
    checks = stopping_bound_checks(rows)
    stopped = int((checks["held"] | checks["broken"]).sum())
    hunting = int(rows["hunting"].eq(True).sum()) if "hunting" in rows else 0
    if stopped + hunting == 0:
        return {"bound_checks": None}
    broken = checks[checks["broken"]].sort_values("excess_m", ascending=False, kind="stable")
    longer = f"{integer(len(broken)) if len(broken) else 'none'} took longer than what the car as declared needs"
    text = f"{count(stopped, 'run')} braked to rest at once; {longer}, by more than its own tolerance."
    if hunting:
        text += f" {count(hunting, 'run')} hunted on the approach, and {'is' if hunting == 1 else 'are'} not judged."
    shown = broken.head(MAX_ROWS)
    names = ("distance_m", "bound_m", "excess_m", "tolerance_m")
    figures = zip(*(shown[name].to_numpy(float) for name in names), strict=True)
    keys = rows.loc[shown.index, "key"].astype(str)
    lines: list[Row] = [(Cell(key, kind="code"), *map(number, those)) for key, those in zip(keys, figures, strict=True)]
    heads = ("took [m]", "bound [m]", "beyond it [m]", "tolerated [m]")
    columns: tuple[Column | str, ...] = ("run", *(Column(head, True) for head in heads))
    return {
        "bound_checks": Cell(text, kind="" if broken.empty and not hunting else "no"),
        "broken_bounds": ReportTable("runs that broke their bound", columns, lines, len(broken)),
    }
