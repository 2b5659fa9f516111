"""Where the time went between a fix and its command frame, leg by leg.

Knows a record's latency table by the monitor's own legs; must not know what made them long.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.table import rows
from vve_sumo.record.latencies import DATAGRAM, LEGS, TOTAL, legs, percentiles, rows_of
from vve_sumo.record.rows import LatencyRow

if TYPE_CHECKING:
    import pandas as pd

FIX_AGE, SIMULATE, END_TO_END, POSE_AGE = "fix_age", "simulate", "end_to_end", "pose_age"

#: every leg of the breakdown in order, and what it is
MEANINGS: Final = {
    FIX_AGE: "epoch of the fix to the arrival of its bytes; of ticks that a datagram woke",
    **dict(
        zip(
            LEGS,
            (
                "arrival of the bytes to the tick's begin",
                "bytes decoded, judged, placed and predicted",
                "all sensors stepped",
                "controller",
                "setpoint handed to the gateway",
                "gateway and bus, to the return of the last command frame's send",
            ),
            strict=True,
        )
    ),
    TOTAL: "arrival of the bytes to the return of that send; where the deadline woke the tick, from its begin",
    END_TO_END: "epoch of the newest fix to the return of that send",
    SIMULATE: "hand-over to the end of SUMO's step: the slack's work, which no command waits for",
    POSE_AGE: "tick minus epoch of the newest trusted fix",
}

#: of a leg, over the ticks of a drive
PERCENTILES: Final = rows(
    Metric("p50_ms", "median", "median: the smallest sample that half of them do not exceed", worse="higher"),
    Metric("p95_ms", "95 %", "95th percentile, likewise", worse="higher"),
    Metric("p99_ms", "99 %", "99th percentile, likewise", worse="higher"),
    Metric("max_ms", "maximum", "greatest", worse="higher"),
    Metric("n", "ticks", "ticks in which the leg happened from end to end", kind="int"),
)


def latency_breakdown(run: Run) -> pd.DataFrame:
    """Return a row for each leg of MEANINGS with percentiles and greatest [ms] and the number of ticks.

    Legs, ranks and rounding (to microseconds) are the monitor's, so that its legs' figures are those of `summary.json`.
    A record without a latency table, as every one of lockstep, has the pose's age alone: the other legs then are NaN
    with n = 0, for a simulated clock takes no time.
    """
    import pandas as pd

    over_time = _seconds(run)
    legs = {}
    for name in MEANINGS:
        samples = over_time[name].to_numpy()
        ordered = sorted(samples[np.isfinite(samples)].tolist())
        figures = {f"{which}_ms": math.nan if value is None else value for which, value in percentiles(ordered).items()}
        legs[name] = figures | {"n": len(ordered)}
    table = pd.DataFrame.from_dict(legs, orient="index", columns=list(PERCENTILES)).rename_axis("leg")
    return described(table, PERCENTILES)


def legs_over_time(run: Run) -> pd.DataFrame:
    """Return every leg of every tick [ms] as `LEG_ms`, by tick, with `time_s`; NaN where it did not happen.

    Beside them `woken_by` and `missed` of the table; empty and 0 for a tick that it does not know.
    """
    seconds = _seconds(run)
    table = seconds[["time_s", "woken_by", "missed"]].copy()
    for name in MEANINGS:
        table[f"{name}_ms"] = 1e3 * seconds[name]
    meanings = {f"{name}_ms": meaning for name, meaning in MEANINGS.items()}
    beside = {"time_s": "drive time of the tick", "missed": "ticks skipped before this one"}
    woken = "what began the tick: a datagram, or the deadline where the due one did not come"
    return described(table, meanings | beside | {"woken_by": woken})


def _seconds(run: Run) -> pd.DataFrame:
    """Every leg [s], by tick, also of ticks that only the latency table knows, as a killed drive leaves them."""
    import pandas as pd

    ticks = run.arrow("ticks")
    ages = pd.DataFrame({"time_s": run.time, POSE_AGE: ticks["pose_age_s"].to_numpy()}, index=ticks["tick"].to_numpy())
    rows = list(rows_of(run.arrow("latency"))) if run.holds("latency") else []
    columns = ["due_s", "woken_by", "missed", *(name for name in MEANINGS if name != POSE_AGE)]
    timed = pd.DataFrame([_timed(row) for row in rows], columns=columns, index=[row.tick for row in rows])
    table = ages.join(timed.astype({"woken_by": object}), how="outer").rename_axis("tick")
    table["time_s"] = table["time_s"].fillna(table.pop("due_s").astype(float))
    return table.fillna({"woken_by": "", "missed": 0}).astype(dict.fromkeys(MEANINGS, float) | {"missed": int})


def _timed(row: LatencyRow) -> dict[str, float | int | str]:
    """What a row of the latency table says, leg by leg [s]."""
    epoch = row.epoch_s if math.isfinite(row.epoch_s) else math.nan
    return {
        "due_s": row.due_s,
        "woken_by": row.woken_by,
        "missed": row.missed,
        FIX_AGE: row.received_s - epoch if row.woken_by == DATAGRAM else math.nan,
        **legs(row),
        END_TO_END: row.framed_s - epoch,
        SIMULATE: row.simulated_s - row.handed_s,
    }
