"""Studies of adaptive cruise control on one drive: string stability, headways, error of the time gap.

Reads a run and applies `vve_sumo.metrics.string_stability`; it must not know what anybody draws of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.following import headway
from vve_sumo.metrics.predicted_ways import Indices
from vve_sumo.metrics.string_stability import (
    Amplification,
    GapError,
    settled_from,
    speed_amplification,
    time_gap_error,
    time_shares,
)
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: edges of the bins of a headway's distribution, the last bin has no end [s]
HEADWAY_EDGES: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
#: vehicles of a string are no farther from the ego along its path [m], and no farther beside it [m]
REACH, BESIDE = 150.0, 1.5

STRING_MEANINGS: Final = {
    "speed_min_mps": "least speed",
    "speed_max_mps": "greatest speed",
    "amplification_l2": "of the vehicle's speed over its predecessor's, both counted from the head's median speed: "
    "root of the sum of squares",
    "amplification_linf": "likewise of the greatest size",
    "head_to_tail_l2": "of the vehicle's speed over that of the string's head, as amplification_l2",
    "head_to_tail_linf": "likewise of the greatest size",
}

HEADWAY_MEANINGS: Final = {
    "from_s": "least headway of the bin, bumper to bumper",
    "to_s": "headway at which the bin ends",
    "time_share": "share of the time behind a leader",
}


def string_of(run: Run) -> tuple[Indices, dict[str, Floats]]:
    """Return the ticks of the longest time behind one moving leader, and the speeds of the string then, head first.

    The string is the ego, its leader, and the vehicles in the ego's lane within REACH at the begin, in the middle and
    at the end of that time, in the order of its middle. Empty where the ego follows nobody for long enough.
    """
    drive = run.data
    ticks = drive.following
    if not len(ticks):
        return ticks, {}
    actors, leader = drive.actor_rows, drive.lead.actor[ticks[0]]
    members: dict[str, tuple[float, Floats]] = {drive.ego: (0.0, drive.motion.speed[ticks])}
    for code in np.unique(actors.code[np.isin(actors.at, ticks)]).tolist():
        rows = np.flatnonzero((actors.code == code) & (actors.at >= ticks[0]) & (actors.at <= ticks[-1]))
        if not np.array_equal(actors.at[rows], ticks):
            continue
        seen = rows[[0, len(rows) // 2, -1]]
        own, boxes = drive.s[actors.at[seen]], actors.boxes.select(seen)
        s, d, heading = run.path.project_many(boxes.x, boxes.y, own, REACH)
        along = np.cos(boxes.heading - heading) > 0.0
        in_lane = (along & (np.abs(d) < BESIDE) & (np.abs(s - own) < REACH - 1.0)).all()
        if in_lane or actors.names[code] == leader:
            members[actors.names[code]] = float(s[1] - own[1]), actors.boxes.speed[rows]
    order = sorted(members, key=lambda name: -members[name][0])
    return ticks, {name: members[name][1] for name in order}


def string_stability(run: Run, chain: Sequence[str] | None = None) -> pd.DataFrame:
    """Return how a disturbance passes through the string with the ego in it: a row a vehicle, the head first.

    `chain` are its vehicles from head to tail, "ego" for the ego, in place of those of `string_of`. Empty where the ego
    follows nobody for long enough. Raises ConfigError for a vehicle that is not in the string.
    """
    import pandas as pd

    _ticks, speeds = string_of(run)
    for name in chain or ():
        if name not in speeds:
            raise ConfigError(f"{run.folder}: no {name} in the string, which has {', '.join(speeds) or 'no vehicle'}")
    names = list(speeds if chain is None else chain)
    rows = [_passed_on([speeds[name] for name in names[: place + 1]]) for place in range(len(names))]
    frame = pd.DataFrame(rows, index=pd.Index(names, name="vehicle"), columns=list(STRING_MEANINGS), dtype=np.float64)
    return described(frame, STRING_MEANINGS)


def head_to_tail(run: Run, leader: str, chain: Sequence[str], undisturbed: float, begin: float) -> Amplification:
    """Return how much larger the disturbance of a platoon's last ego is than that of the leading actor.

    chain: ids of the egos from the first, which follows `leader`, to the last. Ticks count from the drive time `begin`
    [s] on, and from when every ego is settled behind the one ahead. undisturbed: the platoon's speed [m/s]. NaN where
    somebody never settles.
    """
    egos = [run.egos[name] for name in chain]
    ticks = min(len(one.time) for one in egos)
    actors = run.actors
    ahead = actors[(actors["actor"] == leader) & (actors["tick"] < ticks)]["speed_mps"].to_numpy()
    speeds = [ahead, *(one.motion.speed[:ticks][-len(ahead) :] for one in egos)]
    time = run.time[:ticks][-len(ahead) :]
    first = int(np.searchsorted(time, begin))
    for before, one, own in zip(speeds, egos, speeds[1:], strict=False):
        first = max(first, settled_from(time, one.lead.gap[:ticks][-len(ahead) :], before, own))
    return speed_amplification(speeds[0][first:], speeds[-1][first:], undisturbed)


def _passed_on(speeds: list[Floats]) -> tuple[float, ...]:
    """Return the row of the last of some vehicles that follow each other."""
    head, own = speeds[0], speeds[-1]
    steady = float(np.median(head))
    # The head has no predecessor.
    passed = [speed_amplification(one, own, steady) for one in (speeds[-2], head)] if len(speeds) > 1 else []
    extremes = float(own.min()), float(own.max())
    return (*extremes, *(value for pair in passed for value in pair), *[np.nan] * (0 if passed else 4))


def headway_distribution(run: Run, edges: ArrayLike = HEADWAY_EDGES) -> pd.DataFrame:
    """Return the share of the time behind a leader that each bin of headways takes, a row a bin; the last has no end.

    Time counts while the ego moves faster than FOLLOWING_SPEED behind an actor that goes its way faster than that too.
    """
    import pandas as pd

    drive, bounds = run.data, np.asarray(edges, np.float64)
    values = np.where(drive.behind_leader, headway(drive.lead.gap, drive.motion.speed), np.nan)
    shares = time_shares(run.time, values, np.append(bounds, np.inf))
    columns = {"from_s": bounds, "to_s": np.append(bounds[1:], np.inf), "time_share": shares}
    return described(pd.DataFrame(columns), HEADWAY_MEANINGS)


def time_gap_error_of(run: Run, time_gap: float | None = None, standstill: float | None = None) -> GapError:
    """Return the error of the time gap [s] behind leaders, for the policy of a gap of standstill + time_gap * speed.

    Where they are not given, time_gap [s] and standstill [m] are the record's tuning `time_headway_s` and `gap_m` of
    the controller, standstill else 0. Raises ConfigError where neither names the wanted time gap.
    """
    tuning = run.resolved["settings"]["controller"].get("tuning", {})
    time_gap = tuning.get("time_headway_s") if time_gap is None else time_gap
    standstill = tuning.get("gap_m", 0.0) if standstill is None else standstill
    if time_gap is None:
        raise ConfigError(f"{run.folder}: its controller's tuning has no time_headway_s: give the wanted time gap [s]")
    drive = run.data
    rows = np.flatnonzero(drive.behind_leader)
    return time_gap_error(drive.lead.gap[rows], drive.motion.speed[rows], float(time_gap), float(standstill))
