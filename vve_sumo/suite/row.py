"""What a row of a suite is before it is driven, and what came of it.

Values only; knows neither how a drive is run nor how a table is printed.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from vve_sumo.scenario.schema import Scenario
from vve_sumo.suite.physics import Need


class Approach(NamedTuple):
    """The speed at which the test wants the car from where its target enters to where the car brakes."""

    target: str  #: actor whose entry begins the test
    speed: float  #: [m/s]
    below: float  #: the speed may be so much less [m/s]
    above: float  #: or so much more [m/s]


class CutIn(NamedTuple):
    """The time to collision with which the target has to come into the lane."""

    target: str  #: actor that cuts in
    lane_edge: float  #: of the ego's lane, beside the path [m], left positive
    ttc: float  #: [s]
    tolerance: float  #: [s]


@dataclass(frozen=True, slots=True)
class Row:
    """One test; its scenario's criteria are what it demands."""

    id: str  #: unlike any other row's of the suite
    what: str
    required: str  #: the criteria in the standard's words and units
    scenario: Scenario | None  #: None where the row is not applicable
    not_applicable: str = ""  #: why not
    approach: Approach | None = None
    cut_in: CutIn | None = None
    need: Need | None = None  #: None where no braking is demanded


class Verdict(enum.StrEnum):
    """What is said of a row."""

    PASSED = "passed"
    FAILED = "failed"
    UNAVOIDABLE = "failed, not avoidable by closed form"
    INVALID = "invalid"  #: the test was not driven as it must be
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a row; None where there is nothing to say."""

    row: Row
    verdict: Verdict
    why: str = ""  #: of what is not passed
    approach_mps: tuple[float, float] | None = None  #: least and greatest speed from the target's entry to the braking
    cut_in_ttc_s: float | None = None
    impact_mps: float | None = None  #: relative, 0 without contact
    least_gap_m: float | None = None
    deceleration_mps2: float | None = None  #: the greatest
    record: Path | None = None  #: where it is kept
    cpu_s: float = 0.0
