"""The contents of a certificate: the drive and verdict of each case, and the likely defects.

Values only.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from vve_sumo.certify.cases import Case
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import Answer, Window
from vve_sumo.values import Floats


class CaseVerdict(enum.StrEnum):
    """The verdict of a case."""

    PASSED = "passed"
    FAILED = "FAILED"
    VOID = "VOID"  #: the nominal drive has no suitable time for the fault: nothing was tested
    NOT_APPLICABLE = "not applicable"  #: the rig has no wire that the case affects


@dataclass(frozen=True, slots=True)
class CaseDrive:
    """One drive of a case: the car's motion tick by tick, and the brain's answers on the wire."""

    time: Floats  #: of every tick [s of drive time]
    speed: Floats  #: true, along the heading [m/s]
    gap: Floats  #: from the front bumper to the lead vehicle or obstacle on the path [m]; NaN without one
    answers: Sequence[Answer]
    outcome: str  #: how the drive ended
    reasons: Sequence[str]  #: the gateway's at the end
    collision: bool
    impact_speed: float  #: [m/s]; NaN for no contact
    stop_gap: float  #: at rest [m]; NaN where nothing was ahead or the car did not come to rest
    x: Floats  #: true rear axle, map [m]
    y: Floats  #: as x
    heading: Floats  #: true [rad]
    deviation: Floats  #: of the true rear axle from the path [m], left positive
    contact: float = math.nan  #: drive time of the first contact [s]; NaN for none
    refused: Mapping[str, int] = field(default_factory=dict)  #: rejected setpoints, by reason code
    taken: int = 1  #: accepted setpoints
    record_sha256: str = ""  #: of the drive's record


@dataclass(frozen=True, slots=True)
class CaseResult:
    """The result of a case with one seed."""

    case: Case
    seed: int
    verdict: CaseVerdict
    why: str = ""  #: why it failed or does not apply
    window: Window | None = None  #: of the fault; None where nothing was injected
    reaction: float = float("nan")  #: from the fault to the required reaction [s]; inf for never, NaN: not measured
    distance_left: float = float("nan")  #: distance left at rest [m]; NaN where nothing was ahead
    impact_speed: float = float("nan")  #: [m/s]; NaN for no contact
    outcome: str = ""  #: how the drive ended
    reasons: tuple[str, ...] = ()  #: the gateway's at the end
    extra_braking: float = 0.0  #: during the fault, beyond the nominal drive's at the same time [m/s2]
    last: Answer | None = None  #: the brain's last setpoint before rest
    record: Path | None = None  #: folder of the drive's record
    record_sha256: str = ""
    drive: CaseDrive | None = None  #: for the picture

    @property
    def key(self) -> str:
        """Name of the case and its seed."""
        return f"{self.case.name}, seed {self.seed}"


@dataclass(frozen=True, slots=True)
class Defect:
    """A likely defect of the brain, inferred from its behaviour."""

    name: str
    cases: tuple[str, ...]  #: failed cases that indicate it


@dataclass(frozen=True, slots=True)
class BrainUnderTest:
    """The identity of the brain."""

    command: str  #: empty for one that was started by hand
    files: Mapping[str, str]  #: SHA-256 of every file that the command names


@dataclass(frozen=True, slots=True)
class Certificate:
    """A certificate."""

    rig: str
    rig_argument: str  #: name or file that the command was given
    rig_sha256: str
    scenario: str
    values: Mapping[str, Any]  #: overridden values of the scenario
    brain: BrainUnderTest
    wires: tuple[str, ...]  #: kinds
    seeds: tuple[int, ...]
    cases: tuple[str, ...]  #: selected cases
    limits: CertificateLimits
    results: tuple[CaseResult, ...]
    defects: tuple[Defect, ...]
    software: Mapping[str, Any]  #: versions and hash of the code
    began_utc: str

    @property
    def passed(self) -> bool:
        """Whether every applicable case was driven and passed; an untested case is not passed."""
        return all(result.verdict in (CaseVerdict.PASSED, CaseVerdict.NOT_APPLICABLE) for result in self.results)

    @property
    def verdict(self) -> Literal["passed", "FAILED", "INCOMPLETE"]:
        """The overall verdict; a failed case outweighs an untested one."""
        verdicts = {result.verdict for result in self.results}
        return "FAILED" if CaseVerdict.FAILED in verdicts else "passed" if self.passed else "INCOMPLETE"
