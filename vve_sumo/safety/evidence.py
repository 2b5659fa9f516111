"""What was tried before a test day, from what other commands left: records, fault matrix, hunt, certificate.

Reads files and judges nothing beyond what they say of themselves; a file that is none is one line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from vve_sumo.config_file import read_json
from vve_sumo.drive.reasons import in_words
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError
from vve_sumo.record.alterations import SUMMARY
from vve_sumo.record.hashes import hash_file
from vve_sumo.record.layout import PROVENANCE
from vve_sumo.safety.hazard_trace import hazard_trace

MATRIX: Final = "matrix:"  #: before the name of a row in the hazard analysis
#: in the name of a test of pytest: the row that it was given
ROW: Final = re.compile(r"\[([\w-]+)\]$")
CERTIFICATE: Final = "certificate.json"  #: in a certificate's folder
QUERY, HUNT = "hunt.json", "report.txt"  #: in a hunt's folder


@dataclass(frozen=True, slots=True)
class DriveEvidence:
    """One drive of the day, by its record."""

    record: str
    begun: str
    scenario: str
    outcome: str
    reasons: tuple[str, ...]  #: in words
    operator: str
    driver: str
    sha256: str  #: of the record; empty where the drive was never finished
    altered: tuple[str, ...]  #: what is not as the drive left it


def drive_evidence(folder: Path) -> DriveEvidence:
    """Return what a record says of its drive; raises ConfigError for a folder that holds none."""
    resolved = read_json(folder / "scenario.json", "a drive")
    there = (folder / SUMMARY).is_file()
    summary = read_json(folder / SUMMARY, "a drive's summary") if there else {}
    origin = read_json(folder / PROVENANCE, "a drive's origin")
    altered = alterations(folder) if there else []
    return DriveEvidence(
        record=folder.name,
        begun=str(origin.get("began_utc", "")),
        scenario=str(resolved.get("scenario", "")),
        outcome=_outcome(summary),
        reasons=tuple(in_words(str(code)) for code in summary.get("reasons") or ()),
        operator=str(origin.get("operator") or ""),
        driver=str(origin.get("driver") or ""),
        sha256=str(summary.get("record_sha256") or ""),
        altered=tuple(one.part for one in altered or ()),
    )


def _outcome(summary: dict[str, Any]) -> str:
    if not summary:
        return "never finished"
    passed = summary.get("passed")
    verdict = "not judged" if passed is None else "passed" if passed else "FAILED"
    return f"{summary.get('outcome', 'unknown')}, {verdict}"


@dataclass(frozen=True, slots=True)
class MatrixEvidence:
    """What came of the fault matrix."""

    sha256: str  #: of the file
    begun: str
    passed: tuple[str, ...]  #: rows
    failed: tuple[str, ...]
    not_tried: tuple[str, ...]  #: rows of the analysis that were skipped or left out


def matrix_evidence(file: Path) -> MatrixEvidence:
    """Return what a JUnit file of pytest says of the fault matrix; raises ConfigError for one without a row of it."""
    rows = [
        name.removeprefix(MATRIX) for one in hazard_trace().actions for name in one.shown if name.startswith(MATRIX)
    ]
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise ConfigError(f"{file}: expected the file of pytest --junitxml, {error}") from None
    found: dict[str, list[bool]] = {}
    for case in root.iter("testcase"):
        name = ROW.search(case.get("name", ""))
        skipped = case.find("skipped") is not None
        if name is not None and name[1] in rows and not skipped:
            bad = case.find("failure") is not None or case.find("error") is not None
            found.setdefault(name[1], []).append(not bad)
    if not found:
        raise ConfigError(f"{file}: expected rows of the fault matrix, as tests/live/test_matrix.py names them")
    return MatrixEvidence(
        sha256=hash_file(file),
        begun=next((str(suite.get("timestamp", "")) for suite in root.iter("testsuite")), ""),
        passed=tuple(name for name in rows if all(found.get(name, [False]))),
        failed=tuple(name for name in rows if name in found and not all(found[name])),
        not_tried=tuple(name for name in rows if name not in found),
    )


@dataclass(frozen=True, slots=True)
class HuntEvidence:
    """What a hunt found."""

    folder: str
    sha256: str  #: of its report
    summary: tuple[str, ...]  #: its first lines
    nearest: str  #: the invariant with the least margin
    of_this_rig: bool  #: whether the rig's file is the one that was hunted with


def hunt_evidence(folder: Path, rig_sha256: str) -> HuntEvidence:
    """Return what a hunt's folder says; raises ConfigError for a folder that holds none."""
    query, file = read_json(folder / QUERY, "a hunt", "rig_sha256"), folder / HUNT
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ConfigError(f"{folder}: expected the folder of a hunt, with {HUNT}: {error.strerror}") from None
    if not lines or "episodes" not in lines[0]:
        raise ConfigError(f"{file}: expected a hunt's report, got {lines[0]!r}" if lines else f"{file}: is empty")
    margins = [line.strip() for line in lines if re.match(r"  +\d\.\d+  \w+: ", line)]
    return HuntEvidence(
        folder=folder.name,
        sha256=hash_file(file),
        summary=tuple(lines[:3]),
        nearest=" ".join(margins[0].split()[:2]).rstrip(":") if margins else "",
        of_this_rig=query["rig_sha256"] == rig_sha256,
    )


@dataclass(frozen=True, slots=True)
class CertificateEvidence:
    """What a certificate says of an external controller."""

    folder: str
    sha256: str  #: of certificate.json
    begun: str
    verdict: str
    passed: bool
    brain: str  #: its command
    brain_files: tuple[tuple[str, str], ...]  #: with their hashes
    counts: tuple[tuple[str, int], ...]  #: verdicts of its drives
    of_this_rig: bool


def certificate_evidence(folder: Path, rig_sha256: str) -> CertificateEvidence:
    """Return what a certificate's folder says; raises ConfigError for a folder that holds none."""
    file = folder / CERTIFICATE
    said = read_json(file, "a certificate", "verdict", "results", "brain", "rig_sha256", "began_utc", "passed")
    try:
        verdicts = [str(one["verdict"]) for one in said["results"]]
        brain = said["brain"]
        files = tuple((str(name), str(digest)) for name, digest in brain["files_sha256"].items())
        command = str(brain["command"] or "started by hand")
    except (KeyError, TypeError, AttributeError):
        raise ConfigError(f"{file}: expected a certificate of this version") from None
    return CertificateEvidence(
        folder=folder.name,
        sha256=hash_file(file),
        begun=str(said["began_utc"]),
        verdict=str(said["verdict"]),
        passed=said["passed"] is True,
        brain=command,
        brain_files=files,
        counts=tuple((word, verdicts.count(word)) for word in dict.fromkeys(verdicts)),
        of_this_rig=said["rig_sha256"] == rig_sha256,
    )
