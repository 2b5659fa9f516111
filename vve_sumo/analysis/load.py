"""From a folder to what it holds, a drive's record or a sweep's dataset; whatever else it holds is named in one line.

Knows what lies in such folders; nothing of what is in the files.
"""

from __future__ import annotations

from pathlib import Path

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.record.sweep_folder import earlier_layout

WANTED = "expected a drive's record (scenario.json) or a sweep's folder (sweep.json)"


def load(path: Path | str) -> Run | Sweep:
    """Return the drive or the sweep whose folder this is; its tables are read when they are asked for.

    Raises ConfigError in one line where there is none, or one that cannot be read.

    >>> import vve_sumo as vve
    >>> vve.load("mine").title
    "The paper's drive: a car parked in the middle of the road"
    """
    folder = Path(path)
    try:
        if _is_sweep(folder):
            return Sweep(folder)
        if _is_record(folder):
            return Run(folder)
        raise ConfigError(f"{folder}: {_instead(folder)}")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be read: {error.strerror}") from None


def _is_sweep(folder: Path) -> bool:
    return (folder / "sweep.json").is_file()


def _is_record(folder: Path) -> bool:
    return (folder / "scenario.json").is_file()


def _instead(folder: Path) -> str:
    """Return what is there in place of a record or a dataset, and what to do about it where that can be told."""
    if not folder.exists():
        return f"not there; {WANTED}"
    for above in (folder.parent, folder.parent.parent):
        if _is_sweep(above):
            return f"a part of a sweep; load its folder, {above}"
    if _is_record(folder.parent):
        return f"a part of a record; load its folder, {folder.parent}"
    if not folder.is_dir():
        return f"a file; {WANTED}"
    files = sorted(folder.iterdir())
    if not files:
        return f"an empty folder; {WANTED}"
    if any(file.stem in SCHEMAS for file in files):
        return "a drive's tables without their scenario.json: a part of a record is missing"
    inside = next(
        (file for file in (*files, *sorted(folder.glob("records/*"))) if _is_sweep(file) or _is_record(file)), None
    )
    hint = f"; it holds others, such as {inside}" if inside else ""
    if earlier := earlier_layout(folder):
        return earlier + hint
    return f"neither a record nor a dataset{hint or '; ' + WANTED}"
