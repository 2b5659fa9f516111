"""Says of every scenario whether its meeting fits into a rig's lot, at which speed and on which part of its path.

Searches with `align_around` alone, and writes nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vve_sumo import workspace
from vve_sumo.commissioning.align_around import EventInLot, EventSite
from vve_sumo.commissioning.event_stretch import main_event
from vve_sumo.errors import ConfigError
from vve_sumo.rig import load as rigs


@dataclass(frozen=True, slots=True)
class LotFit:
    """A scenario and the lot; the figures of one that does not fit are None."""

    scenario: str  #: its name
    event: str | None  #: id of the obstacle or actor that is met
    own_speed_mps: float | None  #: of the scenario's ego, or the nearest that scenario and rig allow
    speed_mps: float | None  #: at which it fits: its own, or the fastest below that
    begin_m: float | None  #: where the part of the path begins, along the whole one
    end_m: float | None  #: where it ends
    clearance_m: float | None  #: of the swept ground from the lot's edge less its margin
    why_not: str  #: one line; empty for one that fits

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)

    def cells(self) -> tuple[str, ...]:
        """Return name, event, own speed, speed that fits or why none, part of the path and clearance, as texts."""
        own = "" if self.own_speed_mps is None else f"{self.own_speed_mps:.2f} m/s"
        if self.speed_mps is None:
            return (self.scenario, self.event or "", own, f"no: {self.why_not}", "", "")
        return (
            self.scenario,
            self.event or "",
            own,
            f"{self.speed_mps:.2f} m/s ({3.6 * self.speed_mps:.0f} km/h)",
            f"{self.begin_m:.0f} to {self.end_m:.0f}",
            f"{self.clearance_m:.1f} m",
        )


def lot_fits(rig: str, working: Path, names: Collection[str] | None = None) -> Iterator[LotFit]:
    """Yield every scenario of the workspace, or those of some names, as soon as it is known whether it fits.

    Raises ConfigError for a rig that is missing or wrong; a scenario's error is why it does not fit.
    """
    rigs.load(workspace.find("rig", rig, working), working)
    for name in workspace.known("scenario", working) if names is None else names:
        try:
            yield _fit_of(name, rig, working)
        except ConfigError as error:
            yield LotFit(name, None, None, None, None, None, None, str(error))


def _fit_of(name: str, rig: str, working: Path) -> LotFit:
    site = EventSite(name, rig, working)
    event, own = main_event(site.resolved), site.own_speed
    if event is None:
        return LotFit(name, None, own, None, None, None, None, "no obstacle and no actor is met")
    found = site.fastest(event, own, lambda _line: None)
    if found is None:
        why = site.obstacle_to(event, own) or "the lot is too small at any speed that the scenario allows"
        return LotFit(name, event, own, None, None, None, None, why)
    return _fitting(name, own, found)


def _fitting(name: str, own: float, found: EventInLot) -> LotFit:
    stretch, fit = found.stretch, found.result.fit
    assert fit is not None  # of a search that found a place
    begin, end, clearance = (round(value, 2) for value in (stretch.begin, stretch.end, fit.clearance))
    return LotFit(name, stretch.event, round(own, 3), round(found.speed, 3), begin, end, clearance, "")
