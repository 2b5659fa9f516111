"""How the ride felt to passengers: the figures by ISO 2631-1, and what the standard calls them in words.

Knows the comfort of a ride; measures nothing itself.
"""

from __future__ import annotations

import math

from vve_sumo.analysis.run import Run
from vve_sumo.metrics.per_drive import OF_RIDE, PER_DRIVE
from vve_sumo.metrics.ride_comfort import MAX_TRANSIENT_RATIO, RideComfort, reactions
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import figure, number
from vve_sumo.report.tables import Column, ReportTable, named

#: the figure that the standard has words for
TOTAL = "weighted_rms_xy_mps2"


def comfort(run: Run) -> dict[str, object]:
    """Return how the ride felt; `comfort` is None of a drive without a ride whose accelerations are known."""
    felt = run.data.ride_comfort
    if felt is None:
        return {"comfort": None, "comfort_missing": f"{PER_DRIVE[TOTAL].missing}.", "comfort_status": ""}
    measure = PER_DRIVE.functions()
    rows = [(named(name), figure(name, measure[name](run.data))) for name in OF_RIDE]
    return {
        "comfort": ReportTable("comfort of the ride", ("measure", Column("value", True)), rows),
        "comfort_words": [*_reaction(felt), *_short_events(felt), _where(run)],
        "comfort_status": "" if math.isnan(felt.total) else reactions(felt.total),
    }


def _reaction(felt: RideComfort) -> list[str]:
    """Return what the standard calls the vibration total value; nothing of a ride that is too short to have one."""
    if math.isnan(felt.total):
        return []
    value = number(felt.total, "m/s²")
    return [
        f"ISO 2631-1 (annex C) calls a vibration total value of {value} “{reactions(felt.total)}” in public transport. "
        "This one is of the two horizontal axes; vertical vibration, which the record does not hold, would add to it."
    ]


def _short_events(felt: RideComfort) -> list[str]:
    """Return that short events count for more than the root mean square says, where the standard says so."""
    if not felt.max_transient > MAX_TRANSIENT_RATIO * felt.total:
        return []
    ratio = number(felt.max_transient / felt.total, digits=1)
    return [
        f"The {label_of('mtvv_xy_mps2')} is {ratio} times as much. Above {MAX_TRANSIENT_RATIO:g} the root mean square "
        "of a ride understates how its short events, such as a braking, are felt (ISO 2631-1, 6.3.3)."
    ]


def _where(run: Run) -> str:
    origin = "the truth of the simulated vehicle" if run.motion.true else "as estimated, which is smoothed above 2 Hz"
    return (
        f"The accelerations are those of the rear axle in the plane of the road, {origin}. Neither the tilt of the "
        "body nor the seat is in them."
    )
