"""What the picture of a drive shows, and what all its parts share: colours, places on the page, readings of the ticks.

It must not know what any one part draws, nor SUMO, nor how the drive was run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa

from vve_sumo.drive.reasons import in_words
from vve_sumo.metrics.approach import StopApproach
from vve_sumo.metrics.key_figures import braked_hardest_for, unmet
from vve_sumo.metrics.lead_vehicle import LeadVehicle
from vve_sumo.metrics.moment import Moment
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.drawing import Placed
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours after Okabe and Ito, Color Universal Design (2008): told apart by the colour-blind, and by lightness in grey.
INK, QUIET, ROAD, PAPER = "#1b1b1b", "#767676", "#dcdcd8", "#ffffff"
EGO, EGO_PALE, OBSTACLE, ALARM, ACTOR = "#0072b2", "#56b4e9", "#d55e00", "#e69f00", "#009e73"

#: of the page; at half of it, a paper's column pair, the letters are still 5 points high [inch]
SIZE = (13.0, 8.0)
DOTS_PER_INCH = 120
POINTS_PER_INCH = 72
STYLE: dict[Any, Any] = {
    "font.size": 11,
    "axes.titlesize": 11,
    "legend.fontsize": 10.5,
    "legend.frameon": False,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "butt",
    "text.parse_math": False,  # a name that holds dollars is no formula
    "pdf.fonttype": 42,  # letters as outlines of TrueType: publishers refuse Type 3, matplotlib's default
    "ps.fonttype": 42,
}

# Where things stand on the page [inch], from its left and lower edge.
LEFT, LEFT_WIDTH, RIGHT, RIGHT_WIDTH = 0.25, 7.35, 8.35, 4.4
BOTTOM, TOP, BETWEEN = 0.75, 6.95, 0.42

#: a reading of more points than this is drawn as a cloud of dots
MANY_POINTS = 300
#: colour of such dots: dark enough to be seen when they are small
CLOUD = "#6a51a3"
#: marker and colour of the shapes of each sensor, in their order; after the last they begin again
SENSED = (("D", "#cc79a7"), ("^", "#f0e442"), ("s", "#56b4e9"), ("v", "#009e73"))


class FirstSighting(NamedTuple):
    """When a sensor first saw the actor that mattered."""

    sensor: str  #: its name
    time: float  #: drive time [s]
    range: float  #: as measured [m]


class SensedShapes(NamedTuple):
    """What a sensor measured nearest to the moment."""

    sensor: str  #: its name
    shape: Literal["points", "rays", "boxes"]
    placed: Placed  #: in the map


@dataclass(frozen=True, slots=True)
class DrivePage:
    """Everything that the picture shows."""

    title: str
    subtitle: str
    ticks: pa.Table
    actors: pa.Table
    lead: LeadVehicle
    path: ReferencePath
    vehicle: Vehicle
    lanes: Sequence[tuple[Floats, float]]  #: centre line (n x 2) [m] and width [m] of each lane
    moment: Moment | None = None  #: the one that matters; None where no actor came near
    commanded: Floats | None = None  #: path that the command carries at the moment (n x 2) [m]; None for none
    unseen: frozenset[str] = frozenset()  #: actors that no sensor saw around the moment
    watching: Sequence[str] = ()  #: the sensors that say whom they saw
    criteria: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  #: least and greatest value of metrics
    approach: StopApproach | None = None  #: of the last stop
    setting: str = ""  #: what the scenario sets: values of its parameters, faults
    distance: Floats | None = None  #: between the bodies of the ego and of the actor that mattered, tick by tick [m]
    sighted: Sequence[FirstSighting] = ()  #: of that actor, one for each sensor that saw it
    lost: Sequence[
        tuple[float, float]
    ] = ()  #: drive times [s] between which all sensors had lost that actor, and one saw it again
    sensed: Sequence[SensedShapes] = ()  #: of each sensor that measured anything around the moment
    ego: str = "ego"  #: id of the ego whose drive it is
    named: frozenset[str] = frozenset()  #: actors that the scenario or the subtitle calls by their names
    deviation_limit: float | None = (
        None  #: lateral deviation at which the gateway stopped the car; None where it did not
    )

    @property
    def main(self) -> str:
        """Name of the actor that mattered; empty for none."""
        return self.moment.actor if self.moment else ""

    @property
    def second(self) -> str:
        """Name of the other actor that was ahead for the longest time; empty for none."""
        ahead = Counter(name for name in self.lead.actor if name not in ("", self.main))
        return ahead.most_common(1)[0][0] if ahead and self.main else ""

    def name_of(self, actor: str) -> str:
        """Return what an actor is called wherever it stands in the picture; empty for one known by its looks alone."""
        by_name = actor in self.named or (self.second and actor in (self.main, self.second))
        return plain_name(actor) if by_name else ""

    def colour_of(self, actor: str) -> str:
        """Return in what colour a body, a trace and a gap of an actor are drawn."""
        return {self.main: OBSTACLE, self.second: ACTOR}.get(actor, PAPER) if actor else PAPER


#: how a drive ended, in words of somebody who knows no outcomes
ENDED = {
    "stopped": "came to rest",
    "arrived": "came to rest at the end of its path",
    "contact": "hit somebody",
    "driver_has_control": "the driver took over",
    "fault": "stopped by the gateway",
    "timeout": "the time ran out",
    "completed": "drove on to where the scenario ends",
    "played": "the recording ran to its end",
}


def outcome_text(summary: Mapping[str, Any]) -> str:
    """Return in a line what a drive came to; the summary of a live one whose program was killed says less."""
    outcome, gap, seed = str(summary["outcome"]), summary.get("stop_gap_m"), summary.get("seed")
    parts = [ENDED.get(outcome, outcome)]
    if outcome == "stopped":
        stood, target = gap is not None and gap == gap, summary.get("braked_for")
        parts[0] += f" {gap:.2f} m" if stood else ""
        parts[0] += f" before {plain_name(target or 'what was ahead')}" if stood or target else ""
    elif outcome in ("fault", "driver_has_control") and (codes := summary.get("reasons")):
        parts[0] += f": {', '.join(map(in_words, codes))}"
    if outcome != "contact" and summary.get("collision") is not None:
        parts.append("contact" if summary["collision"] else "no contact")
    if actor := braked_hardest_for(summary):
        parts.append(f"braked hardest for {plain_name(actor)}")
    if summary.get("emergency_used"):
        parts.append("braked in emergency")
    why = f": {', '.join(missed)}" if summary.get("passed") is False and (missed := unmet(summary)) else ""
    parts.append({True: "criteria met", False: "criteria NOT met", None: "not judged"}[summary.get("passed")] + why)
    parts += [] if seed is None else [f"seed {seed}"]
    return " · ".join(parts).encode(errors="replace").decode()  # half a surrogate pair of JSON cannot be drawn


def plain_name(name: object) -> str:
    """Return the name of an actor without underscores."""
    return str(name).replace("_", " ")


def prefix(ticks: pa.Table) -> str:
    """Return what the columns of the car's motion begin with: the truth's if there is any, else the estimate's."""
    return "true_" if np.isfinite(ticks["true_x_m"].to_numpy()).any() else ""


def trace(ticks: pa.Table) -> tuple[Floats, Floats, Floats]:
    """Return x, y and heading of the rear axle where they are known: the truth if any, else the estimate."""
    x, y, heading = (ticks[f"{prefix(ticks)}{name}"].to_numpy() for name in ("x_m", "y_m", "heading_rad"))
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    return x[known], y[known], heading[known]


def contact(ticks: pa.Table) -> int | None:
    """Return the row of the first contact."""
    return next((row for row, names in enumerate(ticks["contacts"].to_pylist()) if names), None)


def halo() -> list[Any]:
    """Return the effect that sets words off from the lines below them."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.5, foreground=PAPER)]


def panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes whose lower left corner and size are given in inches from the page's lower left corner."""
    return figure.add_axes((left / SIZE[0], bottom / SIZE[1], width / SIZE[0], height / SIZE[1]))


def say(axes: Axes, words: str) -> None:
    """Write into empty axes why they are empty."""
    axes.set_yticks(())
    ground = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5}  # no line of an event strikes the words through
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=QUIET, bbox=ground)
