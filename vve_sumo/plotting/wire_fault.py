"""What an external controller did when its inputs lied: speed, gap and its setpoints around the fault.

Knows arrays; it must not know what the fault was, nor what was required.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from vve_sumo.plotting.page import ALARM
from vve_sumo.plotting.style import FIRST, LIMIT, SECOND, explain, finite, name, page, plain
from vve_sumo.values import Floats

#: shown before the fault, or before the end where there is none [s]
BEFORE: Final = 6.0
#: greatest gap that is shown [m]
FARTHEST: Final = 60.0


@dataclass(frozen=True, slots=True)
class WireFaultDrive:
    """One drive of a case."""

    title: str
    time: Floats  #: of every tick [s]
    speed: Floats  #: [m/s]
    gap: Floats  #: [m]; NaN for nothing ahead
    answered: Floats  #: time of every setpoint [s]
    acceleration: Floats  #: acceleration that it asked for [m/s2]
    begins: float  #: of the fault [s]; NaN for none
    ends: float  #: of the fault [s]; inf for the end of the drive
    deadline: float  #: by which the reaction is required [s]; NaN where there is none


def wire_fault(drive: WireFaultDrive) -> Figure:
    """Draw speed and gap above, the brain's setpoints below, with the fault's window and the deadline."""
    last = float(drive.time[-1])
    begin = drive.begins if np.isfinite(drive.begins) else last - 2.0 * BEFORE
    with page(height=3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        name(figure, drive.title)
        for axes in (above, below):
            plain(axes)
            if np.isfinite(drive.begins):
                word = "fault on the wire" if axes is above else None
                axes.axvspan(drive.begins, min(drive.ends, last), color=ALARM, alpha=0.25, linewidth=0.0, label=word)
            if np.isfinite(drive.deadline):
                axes.axvline(drive.deadline, label="reaction required" if axes is above else None, **LIMIT)
        above.plot(drive.time, drive.speed, color=FIRST.colour, linestyle=FIRST.stroke, label="speed [m/s]")
        near = finite(drive.gap) & (np.where(finite(drive.gap), drive.gap, np.inf) <= FARTHEST)
        gap = np.where(near, drive.gap, np.nan)
        above.plot(drive.time, gap, color=SECOND.colour, linestyle=SECOND.stroke, label="gap [m]")
        above.set_ylim(bottom=0.0)
        below.plot(drive.answered, drive.acceleration, ".", color=FIRST.colour, markersize=3.0)
        below.set(xlabel="drive time [s]", ylabel="asked [m/s²]", xlim=(max(0.0, begin - BEFORE), last))
        explain(above, 4)
        return figure
