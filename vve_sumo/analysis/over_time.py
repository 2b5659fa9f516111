"""A drive's metrics tick by tick, what they add up to, and those of two whose ways cross.

Reads a run and applies the tables of `vve_sumo.metrics`; it must not know what anybody draws or writes of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.crossing import Encroachment, encroachment, time_to_collision_zone
from vve_sumo.metrics.drive_columns import ActorRows
from vve_sumo.metrics.exposure import EXPOSURE, Stretch
from vve_sumo.metrics.per_tick import PER_TICK
from vve_sumo.metrics.predicted_ways import Indices
from vve_sumo.record.layout import TICK_METRICS

if TYPE_CHECKING:
    import pandas as pd


def over_time(run: Run) -> pd.DataFrame:
    """Return the metrics of a run tick by tick; `attrs` hold unit, label and meaning of every column.

    NaN wherever a metric has nothing to say: nothing ahead, nothing that closes in, no pose. `ttc_s` and `drac_mps2`
    are those of the drive's own figures, so that their extremes are `min_ttc_s` and `max_drac_mps2` of the summary.
    `attrs["deceleration_limit_mps2"]` is what was declared of the car. Columns of a user's metrics follow the shipped
    ones, as the drive recorded them.
    """
    import pandas as pd

    index = pd.Index(run.arrow("ticks")["tick"].to_numpy(), name="tick")
    frame = pd.DataFrame(PER_TICK.measure(run.data), index=index)
    if run.own_metrics.per_tick and run.holds(TICK_METRICS):
        recorded = run.arrow(TICK_METRICS).to_pandas().set_index("tick")
        own = [name for name in run.own_metrics.per_tick if name in recorded]
        frame = frame.join(recorded[own])
    frame = described(frame, {**PER_TICK, **run.own_metrics.per_tick})
    frame.attrs["deceleration_limit_mps2"] = run.vehicle.deceleration_limit
    return frame


def exposure(frame: pd.DataFrame) -> pd.Series:
    """Return what a table of `over_time`, or a stretch of it, adds up to, with units, labels and meanings in `attrs`.

    Each tick holds until the next. A tick at which nothing closes in, or nothing is known, counts as time without
    exposure. A share is NaN where the stretch takes no time. Raises ConfigError for a table that no longer says what
    the car can do.
    """
    import pandas as pd

    limit = frame.attrs.get("deceleration_limit_mps2")
    if limit is None:
        raise ConfigError("exposure: expected a table of over_time with its attrs, this one has lost them")
    columns = {str(name): column.to_numpy() for name, column in frame.items()}
    series = pd.Series(EXPOSURE.measure(Stretch(columns, limit)), name="exposure")
    for about, field in (("units", "unit"), ("labels", "label"), ("meanings", "meaning")):
        series.attrs[about] = {name: getattr(row, field) for name, row in EXPOSURE.items()}
    return series


def encroachment_of(run: Run, actor: str) -> Encroachment:
    """Return when the ego (`one`) and an actor were in the area that both of them covered, in drive time [s].

    Meant for ways that cross: of two that follow each other the area is the whole lane. Raises ConfigError for an actor
    that the record does not hold.
    """
    rows, actors = _rows_of(run, actor)
    return encroachment(run.time, run.data.ego_boxes, run.time[actors.at[rows]], actors.boxes.select(rows))


def zone_times(run: Run, actor: str) -> pd.DataFrame:
    """Return the times to the zone where the lanes of ego and actor cross, a row a tick that holds the actor.

    As `time_to_collision_zone` has it, the ego's lane straight along its heading. Raises ConfigError as
    `encroachment_of` does.
    """
    import pandas as pd

    rows, actors = _rows_of(run, actor)
    at = actors.at[rows]
    passages = time_to_collision_zone(run.data.ego_boxes.select(at), actors.boxes.select(rows))
    names = ("ego_reaches_s", "ego_leaves_s", "actor_reaches_s", "actor_leaves_s")
    columns = {"time_s": run.time[at], **dict(zip(names, passages, strict=True)), "difference_s": passages.difference}
    index = pd.Index(run.arrow("ticks")["tick"].to_numpy()[at], name="tick")
    meanings = {name: f"from now until it {name.split('_')[1]} the zone" for name in names}
    meanings |= {"time_s": PER_TICK["time_s"].meaning, "difference_s": "ego_reaches_s minus actor_reaches_s"}
    return described(pd.DataFrame(columns, index=index), meanings)


def _rows_of(run: Run, actor: str) -> tuple[Indices, ActorRows]:
    actors = run.data.actor_rows
    if actor not in actors.names:
        raise ConfigError(f"{run.folder}: no actor {actor}: it holds {', '.join(sorted(actors.names)) or 'none'}")
    return np.flatnonzero(actors.code == actors.names.index(actor)), actors
