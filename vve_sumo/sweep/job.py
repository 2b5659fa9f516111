"""One run of a sweep as plain data: what it needs and what came of it, each a line of JSON.

Knows neither how a run is driven nor the sweep that it belongs to.
"""

from __future__ import annotations

import errno
import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import ConfigError

VERSION = 4  #: of the lines that jobs and results travel as

AT = "at "  #: how a line begins that says how far a run has come: then time, speed, s and the path's length
READY = "ready"  #: the line by which a server says that it may be given jobs
CHUNK = 65536  #: what is read from a pipe at once [bytes]

#: how the error of a run begins that cannot be driven; what is wrong follows
CONFIG = "config: "
#: how an error begins that every further run would meet as well
DISK_FULL = "disk_full"
DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT)  #: what a full disk and a full quota say

Figure = float | int | str | bool | None


@dataclass(frozen=True, slots=True)
class Job:
    """What a run needs."""

    key: str  #: of the run within its sweep
    name: str  #: of the scenario
    table: dict[str, Any]  #: the scenario as in a TOML file, all values laid in
    file: Path  #: the scenario's, named in complaints; relative names are looked up beside it
    working: Path  #: folder in which names are looked up first
    keep: Path | None = None  #: where the record goes; None: it is thrown away
    pose: Path | None = None  #: recording that is played instead of a simulated vehicle
    rig: Path | None = None  #: file of the rig whose car drives; None: the scenario's vehicle
    progress: bool = False  #: whether the run says on the way how far it has come
    time_limit_s: float = 3600.0  #: wall time that the run may take
    memory_limit_mb: float = 4096.0  #: resident, 10^6 bytes, with everything that the run starts

    def to_json(self) -> str:
        """Return the job as one line of JSON; raises ConfigError where the table holds what JSON has no word for."""
        try:
            return _line(asdict(self))
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"{self.file}: expected texts, finite numbers, truth values, lists and tables: {error}"
            ) from None

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Return the job that a line holds; raises ConfigError where it is none of this version."""
        known = _known(line, "job", _JOB)
        paths = {
            name: Path(known[name]) for name in ("file", "working", "keep", "pose", "rig") if known[name] is not None
        }
        return cls(**known | paths)


@dataclass(frozen=True, slots=True)
class RunResult:
    """What came of a run."""

    key: str  #: the job's
    figures: dict[str, Figure] = field(default_factory=dict)  #: what is the same whenever and wherever it is driven
    error: str = ""  #: why there are no figures
    wall_s: float = 0.0  #: that the run took
    cpu_s: float = 0.0  #: of its process and those that it waited for
    peak_mb: float = 0.0  #: its process' greatest resident memory, 10^6 bytes, shared pages included
    said: str = ""  #: the last that a run with an error printed

    def to_json(self) -> str:
        """Return the result as one line of JSON; not-a-number and infinity become null."""
        return _line(asdict(self) | {"figures": {name: finite(value) for name, value in self.figures.items()}})

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Return the result that a line holds; raises ConfigError where it is none of this version."""
        return cls(**_known(line, "result", _RESULT))


_NUMBER = (float, int)
_JOB: dict[str, tuple[type, ...]] = {
    "key": (str,), "name": (str,), "table": (dict,), "file": (str,), "working": (str,), "keep": (str, type(None)),
    "pose": (str, type(None)), "rig": (str, type(None)), "progress": (bool,), "time_limit_s": _NUMBER,
    "memory_limit_mb": _NUMBER,
}  # fmt: skip
_RESULT: dict[str, tuple[type, ...]] = {
    "key": (str,), "figures": (dict,), "error": (str,), "wall_s": _NUMBER, "cpu_s": _NUMBER, "peak_mb": _NUMBER,
    "said": (str,),
}  # fmt: skip


def progress_line(progress: DriveProgress) -> str:
    """Return progress as the line that it travels as."""
    return f"{AT}{progress.time!r} {progress.speed!r} {progress.s!r} {progress.length!r}"


def progress_of(line: str) -> DriveProgress | None:
    """Return the progress that a line holds; None for another line."""
    return DriveProgress(*map(float, line.split()[1:])) if line.startswith(AT) else None


def refused(job: Job, error: ConfigError) -> RunResult:
    """Return the result of a job that cannot be driven, in words that do not tell in which folder it was tried."""
    said = str(error)
    for folder in (job.file.parent, job.working):
        said = said.replace(f"{folder}/", "")
    return RunResult(job.key, error=f"{CONFIG}{said}")


def _line(fields: dict[str, Any]) -> str:
    return json.dumps({"version": VERSION} | fields, allow_nan=False, default=_place)


def _place(value: object) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"got a {type(value).__name__}")


def _known(line: str, kind: str, fields: dict[str, tuple[type, ...]]) -> dict[str, Any]:
    """Return the fields in a line; raises ConfigError unless they are the ones wanted, each of its type."""
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


def finite(value: Figure) -> Figure:
    """Return a figure, or None for one that is no number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
