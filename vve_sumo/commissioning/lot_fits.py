"""Says of every scenario whether its main meeting fits into a rig's lot, at which speed, on which part of its path.

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
    event: str | None  #: id of the obstacle or actor that is met; others are looked at only where they are near it
    own_speed_mps: float | None  #: of the scenario's ego, whether the rig allows it or not
    speed_mps: float | None  #: at which it fits: its own, or the fastest below that which scenario, rig and lot allow
    begin_m: float | None  #: where the part of the path begins, along the whole one
    end_m: float | None  #: where it ends
    clearance_m: float | None  #: of the swept ground from the lot's edge less its margin
    left_out: tuple[str, ...]  #: of a part that fits, whoever of the scenario is not on it
    why_not: str  #: one line; empty for one that fits

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)

    def cells(self) -> tuple[str, ...]:
        """Return name, event, own speed, speed that fits or why none, part of the path, clearance, who is left out."""
        own = "" if self.own_speed_mps is None else f"{self.own_speed_mps:.2f} m/s"
        if self.speed_mps is None:
            return (self.scenario, self.event or "", own, f"no: {self.why_not}", "", "", "")
        return (
            self.scenario,
            self.event or "",
            own,
            f"{self.speed_mps:.2f} m/s ({3.6 * self.speed_mps:.0f} km/h)",
            f"{self.begin_m:.0f} to {self.end_m:.0f}",
            f"{self.clearance_m:.1f} m",
            "; ".join(self.left_out),
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
            yield _none(name, None, None, str(error))


def _fit_of(name: str, rig: str, working: Path) -> LotFit:
    site = EventSite(name, rig, working)
    event, own = main_event(site.resolved), site.resolved.scenario.ego.speed_mps
    if event is None:
        return _none(name, None, own, "no obstacle and no actor is met")
    found = site.fastest(event, site.own_speed, lambda _line: None)
    if found is None:
        return _none(name, event, own, site.why_none(event, site.own_speed))
    return _fitting(name, own, found)


def _fitting(name: str, own: float, found: EventInLot) -> LotFit:
    stretch, fit = found.stretch, found.result.fit
    assert fit is not None  # of a search that found a place
    begin, end, clearance = (round(value, 2) for value in (stretch.begin, stretch.end, fit.clearance))
    speed, left_out = round(found.speed, 3), found.part.left_out
    return LotFit(name, stretch.event, round(own, 3), speed, begin, end, clearance, left_out, "")


def _none(name: str, event: str | None, own: float | None, why: str) -> LotFit:
    """Return what there is to be said of a scenario that does not fit."""
    return LotFit(name, event, own, None, None, None, None, (), why)
