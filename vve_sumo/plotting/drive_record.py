"""From the record of a drive to its picture: reads what the page is made of, and writes `drive.png`.

Draws nothing itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow.compute as pc

from vve_sumo.analysis.run import Run
from vve_sumo.metrics.moment import Moment, moment_of
from vve_sumo.plotting.drive_page import draw
from vve_sumo.plotting.page import DrivePage, FirstSighting, SensedShapes, outcome_text
from vve_sumo.record.layout import COMMANDED
from vve_sumo.scenario.overrides import value_at
from vve_sumo.values import EGO, Floats

if TYPE_CHECKING:
    from vve_sumo.drive.run import Drive
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import distance
from vve_sumo.metrics.metric import unit_of

PICTURE = "drive.png"
#: an actor in no reading within this time of the moment is drawn as not seen [s]; sensors miss it in single readings
READINGS_AROUND: Final = 0.3
#: an actor of which no sensor has a reading for longer than this was lost [s]; what is far away is missed for less
LOST_AFTER: Final = 1.0


def page_of(run: Run) -> DrivePage:
    """Return what the page of a drive shows, from its record alone; a killed drive is shown up to its last tick."""
    moment = moment_of(run.data)
    roads = zip(*(run.arrow("roads")[name].to_pylist() for name in ("x_m", "y_m", "width_m")), strict=True)
    return DrivePage(
        title=run.title,
        subtitle=f"killed: the record ends at {run.time[-1]:.2f} s"
        if run.summary is None
        else outcome_text(run.summary),
        ticks=run.arrow("ticks"),
        actors=run.arrow("actors"),
        lead=run.lead,
        path=run.path,
        vehicle=run.vehicle,
        lanes=[(np.column_stack((x, y)), width) for x, y, width in roads],
        approach=run.data.approach,
        moment=moment,
        commanded=_commanded(run, moment) if moment else None,
        unseen=_unseen(run, moment) if moment else frozenset(),
        setting=_setting(run),
        distance=_distance(run, moment.actor) if moment else None,
        watching=_watching(run),
        sighted=_sighted(run, moment.actor) if moment else (),
        lost=_lost(run, moment.actor) if moment else (),
        sensed=_sensed(run, moment.time) if moment else (),
        ego=run.ego,
        named=_named(run),
        deviation_limit=_deviation_limit(run),
        criteria={name: bound for name, bound in (run.resolved["settings"].get("criteria") or {}).items() if bound},
    )


def _commanded(run: Run, moment: Moment) -> Floats | None:
    """Return the points of the path that the command carried at the moment (n x 2) [m]; None where it had none."""
    table = run.arrow(COMMANDED)
    own = table.filter(pc.field("tick") == run.arrow("ticks")["tick"][moment.row])
    return np.column_stack((own["x_m"], own["y_m"])) if own.num_rows else None


def _setting(run: Run) -> str:
    """Return the values of the parameters that the scenario declares, and at what deviation it lets the car stop."""
    settings = run.resolved["settings"]
    texts = []
    for name, parameter in (settings.get("parameters") or {}).items():
        try:
            value = value_at(settings, parameter["sets"][0])
        except (ConfigError, KeyError, IndexError):
            continue
        unit = unit_of(parameter["sets"][0].rpartition(".")[2])
        if isinstance(value, int | float):
            texts.append(f"{name.replace('_', ' ')} {value:g} {unit}".strip())
    return f"the scenario sets: {', '.join(texts)}" if texts else ""


def _distance(run: Run, actor: str) -> Floats:
    """Return the distance between the bodies of the ego and of an actor, tick by tick [m]; NaN where it is absent."""
    rows = run.data.actor_rows
    own = np.flatnonzero(rows.code == rows.names.index(actor))
    found = np.full(run.arrow("ticks").num_rows, np.nan)
    at = rows.at[own]
    found[at] = distance(run.data.ego_boxes.select(at), rows.boxes.select(own))
    return found


def _watching(run: Run) -> list[str]:
    """Return the sensors that say whom they saw."""
    return [name for name, table in run.sensed.items() if table.actors is not None]


def _sighted(run: Run, actor: str) -> list[FirstSighting]:
    """Return each sensor's first sight of an actor."""
    return [
        FirstSighting(name, first.time, first.range)
        for name, table in run.sensed.items()
        for first in table.first_sights()
        if first.actor == actor
    ]


def _sensed(run: Run, time: float) -> list[SensedShapes]:
    """Return what each sensor measured nearest to a drive time [s], where it did so around it and saw anything."""
    found = []
    for name, table in run.sensed.items():
        if not len(table.measured):
            continue
        nearest = int(np.argmin(np.abs(table.measured - time)))
        rows = table.of_reading(nearest)
        if abs(table.measured[nearest] - time) <= READINGS_AROUND and rows.start < rows.stop:
            found.append(SensedShapes(name, table.drawing.shape, table.shapes.select(rows)))
    return found


def _named(run: Run) -> frozenset[str]:
    """Return the actors that the scenario calls by name, and those that the summary does."""
    settings, summary = run.resolved["settings"], run.summary or {}
    further = run.resolved.get("further_ego") or {}
    own = {str(one.get("id")) for key in ("actors", "obstacles", "egos") for one in settings.get(key) or ()}
    own |= {EGO}.union(*(further[key] for key in ("actors", "obstacles", "egos"))) if further else set()
    return frozenset(own | {str(summary.get(key) or "") for key in ("braked_for", "hardest_braking_for")})


def _lost(run: Run, actor: str) -> list[tuple[float, float]]:
    """Return between which drive times [s] all sensors had lost an actor, and one saw it again."""
    at = np.unique(np.concatenate([np.zeros(0), *(table.times_of(actor) for table in run.sensed.values())]))
    ends = np.flatnonzero(np.diff(at) > LOST_AFTER)
    return [*zip(at[ends].tolist(), at[ends + 1].tolist(), strict=True)]


def _deviation_limit(run: Run) -> float | None:
    """Return the lateral deviation at which the gateway stopped the car [m]; None where it did not do so for that."""
    if "off_path" not in ((run.summary or {}).get("reasons") or ()):
        return None
    limit = run.resolved["settings"].get("ego", {}).get("deviation_limit_m")
    return None if limit is None else float(limit)


def _unseen(run: Run, moment: Moment) -> frozenset[str]:
    """Return the actors that no sensor saw around the moment; none where no sensor says whom it saw."""
    if not _watching(run):
        return frozenset()
    seen: set[str] = set()
    for table in run.sensed.values():
        near = np.flatnonzero(np.abs(table.measured - moment.time) <= READINGS_AROUND).tolist()
        seen = seen.union(*(table.actors[table.of_reading(number)] for number in near if table.actors is not None))
    return frozenset(run.data.actor_rows.names) - seen


def draw_drive(drive: Drive) -> Path:
    """Write `drive.png` into the record of a drive and return its place."""
    file = drive.folder / PICTURE
    draw(page_of(Run(drive.folder)), file)
    return file
