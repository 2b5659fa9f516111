"""What a row of a suite is before it is driven, and what came of its drives.

Values only; knows neither how a drive is run nor how a table is printed.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from vve_sumo.scenario.schema import Scenario
from vve_sumo.statistics import wilson
from vve_sumo.suite.physics import Need


class RequiredApproach(NamedTuple):
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
class SuiteRow:
    """One test; its scenario's criteria are what it demands."""

    id: str  #: unlike any other row's of the suite
    what: str
    required: str  #: the criteria in the standard's words and units
    scenario: Scenario | None  #: None where the row is not applicable
    not_applicable: str = ""  #: why not
    approach: RequiredApproach | None = None
    cut_in: CutIn | None = None
    need: Need | None = None  #: None where there is nothing to brake for
    demand: float = 0.0  #: braking that has to be asked of the service brakes, at least [m/s2]; 0: none


class RowVerdict(enum.StrEnum):
    """What is said of a row."""

    PASSED = "passed"
    FAILED = "failed"
    UNAVOIDABLE = "failed, not avoidable by closed form"
    INVALID = "invalid"  #: the test was not driven as it must be
    NOT_APPLICABLE = "not applicable"


#: verdicts of a row's drives, the one that decides the row's first
DECIDING = (RowVerdict.INVALID, RowVerdict.FAILED, RowVerdict.UNAVOIDABLE, RowVerdict.PASSED)


@dataclass(frozen=True, slots=True)
class RowOutcome:
    """What came of one drive of a row; None where there is nothing to say."""

    row: SuiteRow
    seed: int  #: of the drive's noise
    verdict: RowVerdict
    why: str = ""  #: of what is not passed
    approach_mps: tuple[float, float] | None = None  #: least and greatest speed from the target's entry to the braking
    cut_in_ttc_s: float | None = None
    impact_mps: float | None = None  #: relative, 0 without contact
    least_gap_m: float | None = None
    deceleration_mps2: float | None = None  #: the greatest
    demand_mps2: float | None = None  #: the most asked of the service brakes, as a deceleration of the declared car
    record: Path | None = None  #: where it is kept
    cpu_s: float = 0.0


@dataclass(frozen=True, slots=True)
class JudgedRow:
    """What came of a row: all of its drives, by seed; none where the row is not applicable."""

    row: SuiteRow
    drives: tuple[RowOutcome, ...] = ()

    @property
    def verdict(self) -> RowVerdict:
        """The first of DECIDING that a drive came to: a row is passed where every drive is."""
        came = {drive.verdict for drive in self.drives}
        return next((verdict for verdict in DECIDING if verdict in came), RowVerdict.NOT_APPLICABLE)

    @property
    def passed(self) -> int:
        """How many drives passed."""
        return sum(drive.verdict is RowVerdict.PASSED for drive in self.drives)

    @property
    def why(self) -> str:
        """Why the row is not passed: what the first drive that decides it says, and how many passed beside it."""
        if not self.drives:
            return self.row.not_applicable
        why = next(drive.why for drive in self.drives if drive.verdict is self.verdict)
        driven = len(self.drives)
        if driven == 1 or self.verdict is RowVerdict.PASSED:
            return why
        share = wilson(self.passed, driven)
        return f"{why}; {self.passed} of {driven} drives passed (95 %: {share.low:.2f} to {share.high:.2f})"
