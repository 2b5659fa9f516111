"""A row of a suite before it is driven, and the outcomes of its drives.

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
    """The required speed of the car from the entry of its target until the car brakes."""

    target: str  #: actor whose entry begins the test
    speed: float  #: [m/s]
    below: float  #: tolerance below it [m/s]
    above: float  #: tolerance above it [m/s]


class CutIn(NamedTuple):
    """The required time to collision at which the target enters the lane."""

    target: str  #: actor that cuts in
    lane_edge: float  #: of the ego's lane, beside the path [m], left positive
    ttc: float  #: [s]
    tolerance: float  #: [s]


class RequiredEvasion(NamedTuple):
    """What is required of a car that may leave its path for somebody."""

    clearance: float  #: least distance between its body and every other one's, at least [m]; 0 requires no more
    back_within: float  #: distance of its rear axle from its path at the end, at most [m]


class RequiredString(NamedTuple):
    """What is required of a platoon behind an actor that changes its speed."""

    leader: str  #: the actor
    chain: tuple[str, ...]  #: ids of the egos, from the first behind it to the last
    speed: float  #: of the undisturbed platoon [m/s]
    begin: float  #: drive time at which the disturbance begins [s]
    max_amplification: float  #: from head to tail, by root of the sum of squares


@dataclass(frozen=True, slots=True)
class SuiteRow:
    """One test; the criteria of its scenario are its requirements."""

    id: str  #: unique within the suite
    description: str
    required: str  #: the criteria in the standard's words and units
    scenario: Scenario | None  #: None where the row is not applicable
    not_applicable: str = ""  #: why not
    approach: RequiredApproach | None = None
    cut_in: CutIn | None = None
    need: Need | None = None  #: None where there is nothing to brake for
    evasion: RequiredEvasion | None = None  #: None where the car does not leave its path
    string: RequiredString | None = None  #: None where no platoon is measured
    demand: float = 0.0  #: least required demand on the service brakes [m/s2]; 0: none


class RowVerdict(enum.StrEnum):
    """The verdict of a row."""

    PASSED = "passed"
    FAILED = "failed"
    UNAVOIDABLE = "failed, not avoidable by closed form"
    INVALID = "invalid"  #: the test was not driven as it must be
    NOT_APPLICABLE = "not applicable"


#: verdicts of drives, by precedence: the first that occurs is the row's
DECIDING = (RowVerdict.INVALID, RowVerdict.FAILED, RowVerdict.UNAVOIDABLE, RowVerdict.PASSED)


@dataclass(frozen=True, slots=True)
class RowOutcome:
    """The outcome of one drive of a row; None for a value that does not exist."""

    row: SuiteRow
    seed: int  #: of the drive's noise
    verdict: RowVerdict
    record: Path | None = None  #: where it is kept
    why: str = ""  #: reason of a verdict other than passed; this and what follows are columns of the dataset
    approach_least_mps: float | None = None  #: least speed from the target's entry to the braking
    approach_greatest_mps: float | None = None  #: the greatest
    cut_in_ttc_s: float | None = None
    impact_speed_mps: float | None = None  #: relative, 0 without contact
    min_gap_m: float | None = None
    max_deceleration_mps2: float | None = None
    demand_mps2: float | None = None  #: largest demand on the service brakes, as a deceleration of the declared car
    clearance_m: float | None = None  #: least distance between the car's body and every other one's
    off_path_m: float | None = None  #: of the true rear axle at the end
    head_to_tail_l2: float | None = None  #: the last ego's disturbance of speed over the leader's


@dataclass(frozen=True, slots=True)
class JudgedRow:
    """A row with the outcomes of its drives, by seed; none where the row is not applicable."""

    row: SuiteRow
    drives: tuple[RowOutcome, ...] = ()

    @property
    def verdict(self) -> RowVerdict:
        """The first of DECIDING that a drive has: a row passes if every drive passes."""
        verdicts = {drive.verdict for drive in self.drives}
        return next((verdict for verdict in DECIDING if verdict in verdicts), RowVerdict.NOT_APPLICABLE)

    def minimum(self, column: str) -> float | None:
        """Return the least value that a drive has in a column; None where none has one."""
        return min(self._values(column), default=None)

    def maximum(self, column: str) -> float | None:
        """Return the greatest value that a drive has in a column; None where none has one."""
        return max(self._values(column), default=None)

    def _values(self, column: str) -> list[float]:
        return [value for drive in self.drives if (value := getattr(drive, column)) is not None]

    @property
    def passed(self) -> int:
        """Number of drives that passed."""
        return sum(drive.verdict is RowVerdict.PASSED for drive in self.drives)

    @property
    def why(self) -> str:
        """Why the row is not passed: the reason of the first deciding drive, and the share of passed drives."""
        if not self.drives:
            return self.row.not_applicable
        why = next(drive.why for drive in self.drives if drive.verdict is self.verdict)
        driven = len(self.drives)
        if driven == 1 or self.verdict is RowVerdict.PASSED:
            return why
        share = wilson(self.passed, driven)
        return f"{why}; {self.passed} of {driven} drives passed (95 %: {share.low:.2f} to {share.high:.2f})"
