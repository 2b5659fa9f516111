"""CSV of a drive or a sweep: its rows, and beside them a table with unit and meaning of every column.

The names of columns end in their units. Numbers are written with as many digits as reading them back exactly needs; an
empty cell is a value that is not there. The files have no comments, so that any program reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.analysis.bodies import bodies
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.export.part import ExportPart

if TYPE_CHECKING:
    import pandas as pd

#: columns of the record's ticks that stand beside the measures over time
OF_TICKS: Final = (
    "yaw_rate_radps",
    "s_m",
    "acceleration_setpoint_mps2",
    "granted_acceleration_mps2",
    "brake_torque_nm",
    "throttle_percent",
    "steering_setpoint_rad",
    "steering_rad",
    "measured_steering_rad",
    "pose_trusted",
    "state",
    "emergency",
    "note",
    "faults",
    "reasons",
    "lane",
    "contacts",
)
_PLACE = "of the ego's rear axle, map: the truth where there is one, else the estimate"
POSE: Final = {
    "x_m": f"x {_PLACE}",
    "y_m": f"y {_PLACE}",
    "heading_rad": "of the ego, counter-clockwise from the map's +x: the truth where there is one, else the estimate",
}
BODIES: Final = {
    "tick": "number of the tick",
    "time_s": "drive time of the tick",
    "actor": "name of the actor; ego is the ego",
    "kind": "car, van, truck, bus, motorcycle, bicycle, pedestrian, child; of traffic, by its radar cross section",
    "x_m": "centre of the box, map",
    "y_m": "centre of the box, map",
    "heading_rad": "counter-clockwise from the map's +x",
    "speed_mps": "along the heading",
    "length_m": "of the box, along the heading",
    "width_m": "of the box",
}


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield a row a tick; a row a body and tick, the ego among the bodies (`actors`); the columns of both."""
    ticks, actors = tick_table(run), actor_table(run)
    yield ExportPart("", _csv(ticks))
    yield ExportPart("actors", _csv(actors))
    yield ExportPart("columns", _csv(columns_of({"ticks": ticks, "actors": actors})))


def of_sweep(sweep: Sweep) -> Iterator[ExportPart]:
    """Yield a row a finished run, and the columns."""
    rows = sweep.rows()
    yield ExportPart("", _csv(rows))
    yield ExportPart("columns", _csv(columns_of({"runs": rows})))


def tick_table(run: Run) -> pd.DataFrame:
    """Return a row a tick: the measures over time, pose, what was commanded and granted, state and reasons."""
    import pandas as pd

    measures, ticks, motion = over_time(run), run.ticks, run.motion
    others = [name for name in OF_TICKS if name not in measures]
    columns = {
        "tick": ticks["tick"],
        **{str(name): column.to_numpy() for name, column in measures.items()},
        **dict(zip(POSE, (motion.x, motion.y, motion.heading), strict=True)),
        **{name: ticks[name] for name in others},
    }
    meanings = ticks.attrs["meanings"] | measures.attrs["meanings"] | POSE
    table = described(pd.DataFrame(columns), meanings)
    table.attrs["labels"] |= measures.attrs["labels"]
    return table


def actor_table(run: Run) -> pd.DataFrame:
    """Return a row a body and tick, tick by tick, the ego first."""
    import pandas as pd

    found, numbers = bodies(run), run.arrow("ticks")["tick"].to_numpy()
    sizes = [len(body.at) for body in found]
    columns = {
        "tick": np.concatenate([numbers[body.at] for body in found]),
        "time_s": np.concatenate([body.time for body in found]),
        "actor": np.repeat([body.name for body in found], sizes),
        "kind": np.repeat([body.kind for body in found], sizes),
        "x_m": np.concatenate([body.x for body in found]),
        "y_m": np.concatenate([body.y for body in found]),
        "heading_rad": np.concatenate([body.heading for body in found]),
        "speed_mps": np.concatenate([body.speed for body in found]),
        "length_m": np.repeat([body.length for body in found], sizes),
        "width_m": np.repeat([body.width for body in found], sizes),
    }
    return described(pd.DataFrame(columns).sort_values("tick", kind="stable", ignore_index=True), BODIES)


def columns_of(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return a row for each column of tables: its unit, label and meaning."""
    import pandas as pd

    rows = [
        (which, name, *(table.attrs[about][name] for about in ("units", "labels", "meanings")))
        for which, table in tables.items()
        for name in table.columns
    ]
    return pd.DataFrame(rows, columns=["table", "column", "unit", "label", "meaning"])


def _csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False, lineterminator="\n").encode()
