"""Writes a report: `report.html` in the folder of a record or dataset, and its plots beside, each whole or not at all.

Must not know what a report says.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from vve_sumo.analysis.load import load
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.report.page import ReportPage

PAGE = "report.html"
PICTURES = "report"


def report_of(folder: Path) -> ReportPage:
    """Return the report of a drive's record or a sweep's dataset; writes nothing.

    Raises ConfigError in one line where the folder holds neither, or what cannot be read.
    """
    held = load(folder)
    # Imported when needed: what a drive's report reads costs a sweep's a fifth of a second.
    if isinstance(held, Run):
        from vve_sumo.report import drive

        return drive.report(held)
    from vve_sumo.report import sweep

    if held.plan["design"] == "certificate":
        raise ConfigError(f"{folder}: its report.html is the certificate; vve-sumo certify … --resume writes it again")
    return sweep.report(held)


def write_report(folder: Path | str) -> Path:
    """Write the report of a drive's record or a sweep's dataset into its folder; return the page's path.

    The page is one file that needs no other; the plots lie in `report/` as well. Earlier ones are replaced. Raises
    ConfigError as `report_of` does; nothing is written then.
    """
    return save(report_of(Path(folder)), Path(folder))


def save(report: ReportPage, folder: Path) -> Path:
    """Write a report into a folder, the page last; return its path."""
    page = report.page().encode()
    if report.pictures:
        (folder / PICTURES).mkdir(exist_ok=True)
    wanted = {f"{picture.name}.png" for picture in report.pictures}
    for old in (folder / PICTURES).glob("*.png"):
        if old.name not in wanted:
            old.unlink()
    for picture in report.pictures:
        replace_file(folder / PICTURES / f"{picture.name}.png", picture.png)
    replace_file(folder / PAGE, page)
    return folder / PAGE


def replace_file(file: Path, content: bytes) -> None:
    """Replace a file; a reader finds the old one or the new one, never half of it."""
    beside = file.with_name(f".{file.name}.tmp")
    try:
        beside.write_bytes(content)
        os.replace(beside, file)  # noqa: PTH105
    except OSError:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise
