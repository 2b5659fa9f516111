"""One run of a sweep as plain data: the job and its result, each a line of JSON.

Knows neither how a run is driven nor the sweep that it belongs to.
"""

from __future__ import annotations

import errno
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import ConfigError

VERSION = 6  #: of the lines that jobs and results travel as

PROGRESS_PREFIX = "at "  #: prefix of a line of progress; time, speed, s and the path's length follow
READY = "ready"  #: line of a server that is ready for jobs
CHUNK = 65536  #: bytes that are read from a pipe at once

#: prefix of the error of a run that cannot be driven
CONFIG = "config: "
#: prefix of the error of a run whose external controller is not there
RIG = "rig: "
#: prefix of the error of a full disk, which every further run would have as well
DISK_FULL = "disk_full"
DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT)  #: of a full disk and of an exceeded quota

MetricValue = float | int | str | bool | None


@dataclass(frozen=True, slots=True)
class Job:
    """What a run needs."""

    key: str  #: of the run within its sweep
    name: str  #: of the scenario
    table: dict[str, Any]  #: the scenario as in a TOML file, with the run's values
    file: Path  #: the scenario's, named in errors; relative names are looked up beside it
    working: Path  #: folder in which names are looked up first
    keep: Path | None = None  #: folder of the record; None: the record is deleted
    pose: Path | None = None  #: recording that is played instead of a simulated vehicle
    rig: Path | None = None  #: file of the rig whose car drives; None: the scenario's vehicle
    progress: bool = False  #: whether the run reports its progress
    time_limit_s: float = 3600.0  #: wall time that the run may take
    memory_limit_mb: float = 4096.0  #: resident, 10^6 bytes, with everything that the run starts
    driver: str = (
        ""  #: `module:function` that starts an external controller and drives; empty: the scenario's controller drives
    )
    driven: dict[str, Any] = field(default_factory=dict)  #: what that function needs

    def to_json(self) -> str:
        """Return the job as one line of JSON; raises ConfigError for values that JSON cannot express."""
        try:
            return _line(asdict(self))
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"{self.file}: expected texts, finite numbers, truth values, lists and tables: {error}"
            ) from None

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Return the job of a line; raises ConfigError for a line of another version or content."""
        known = _known(line, "job", _JOB)
        paths = {
            name: Path(known[name]) for name in ("file", "working", "keep", "pose", "rig") if known[name] is not None
        }
        return cls(**known | paths)


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of a run."""

    key: str  #: the job's
    figures: dict[str, MetricValue] = field(default_factory=dict)  #: metrics and outcomes, equal on every machine
    error: str = ""  #: why there are none
    wall_s: float = 0.0  #: that the run took
    cpu_s: float = 0.0  #: of its process and those that it waited for
    peak_mb: float = 0.0  #: its process' greatest resident memory, 10^6 bytes, shared pages included
    said: str = ""  #: end of the output of a run with an error
    shared_s: float = 0.0  #: drive time up to which other runs were driven as one with it

    def to_json(self) -> str:
        """Return the result as one line of JSON; not-a-number and infinity become null."""
        return _line(asdict(self) | {"figures": {name: finite(value) for name, value in self.figures.items()}})

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Return the result of a line; raises ConfigError for a line of another version or content."""
        return cls(**_known(line, "result", _RESULT))


_NUMBER = (float, int)
_JOB: dict[str, tuple[type, ...]] = {
    "key": (str,), "name": (str,), "table": (dict,), "file": (str,), "working": (str,), "keep": (str, type(None)),
    "pose": (str, type(None)), "rig": (str, type(None)), "progress": (bool,), "time_limit_s": _NUMBER,
    "memory_limit_mb": _NUMBER, "driver": (str,), "driven": (dict,),
}  # fmt: skip
_RESULT: dict[str, tuple[type, ...]] = {
    "key": (str,), "figures": (dict,), "error": (str,), "wall_s": _NUMBER, "cpu_s": _NUMBER, "peak_mb": _NUMBER,
    "said": (str,), "shared_s": _NUMBER,
}  # fmt: skip


def line_of(jobs: Sequence[Job]) -> str:
    """Return one line of JSON for jobs that are driven as one; raises ConfigError as `Job.to_json` does."""
    return f"[{', '.join(job.to_json() for job in jobs)}]"


def jobs_of(line: str) -> list[Job]:
    """Return the jobs of a line that `line_of` made; raises ConfigError for a line of another version or content."""
    try:
        each: Any = json.loads(line)
    except ValueError as error:
        raise ConfigError(f"jobs: expected a line of JSON, {error}: {line[:80]!r}") from None
    if not isinstance(each, list) or not each:
        raise ConfigError(f"jobs: expected a list, got {line[:80]!r}")
    return [Job.from_json(json.dumps(one)) for one in each]


def progress_line(progress: DriveProgress) -> str:
    """Return the line of a progress."""
    return f"{PROGRESS_PREFIX}{progress.time!r} {progress.speed!r} {progress.s!r} {progress.length!r}"


def progress_of(line: str) -> DriveProgress | None:
    """Return the progress of a line; None for another line."""
    return DriveProgress(*map(float, line.split()[1:])) if line.startswith(PROGRESS_PREFIX) else None


def refused(job: Job, error: ConfigError) -> RunResult:
    """Return the result of a job that cannot be driven; its text does not depend on the folder."""
    message = str(error)
    for folder in (job.file.parent, job.working):
        message = message.replace(f"{folder}/", "")
    return RunResult(job.key, error=f"{CONFIG}{message}")


def _line(fields: dict[str, Any]) -> str:
    return json.dumps({"version": VERSION} | fields, allow_nan=False, default=_place)


def _place(value: object) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"got a {type(value).__name__}")


def _known(line: str, kind: str, fields: dict[str, tuple[type, ...]]) -> dict[str, Any]:
    """Return the fields of a line; raises ConfigError for missing, unknown or mistyped ones."""
    try:
        data: Any = json.loads(line, parse_constant=_refuse)
    except ValueError as error:
        raise ConfigError(f"{kind}: expected a line of JSON, {error}: {line[:80]!r}") from None
    version = data.pop("version", None) if isinstance(data, dict) else None
    if version != VERSION:
        raise ConfigError(f"{kind}: expected version {VERSION}, got {version!r}: another vve-sumo wrote it")
    if data.keys() != fields.keys():
        raise ConfigError(f"{kind}: expected the keys {', '.join(fields)}, got {', '.join(data)}")
    for name, types in fields.items():
        if type(data[name]) not in types:
            raise ConfigError(f"{kind}: {name}: expected a {types[0].__name__}, got {data[name]!r}")
    return dict(data)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def finite(value: MetricValue) -> MetricValue:
    """Return a value, or None for NaN and infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
