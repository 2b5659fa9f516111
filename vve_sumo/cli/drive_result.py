"""How a drive went, in lockstep or live: its picture and its table."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.errors import VveError

if TYPE_CHECKING:
    from vve_sumo.drive.resolved_scenario import ResolvedScenario
    from vve_sumo.drive.run import Drive


def draw_and_show(resolved: ResolvedScenario, drive: Drive, *, as_json: bool = False) -> None:
    """Draw `drive.png` into the record of every ego, where that can be done, and print how the drive went."""
    picture = _drawn(drive)
    others = {ego: _drawn(one) for ego, one in drive.others.items()}
    if as_json:
        summary = json.loads((drive.folder / "summary.json").read_text(encoding="utf-8"))
        print(json.dumps({"record": str(drive.folder)} | summary))
    else:
        show_drive(drive, picture)
        for ego, one in drive.others.items():
            show_drive(one, others[ego], ego)


def _drawn(drive: Drive) -> Path | None:
    from vve_sumo.plotting.drive_record import draw_drive

    with contextlib.suppress(VveError, OSError):
        return draw_drive(drive) if drive.summary["ticks"] else None
    return None


def show_drive(drive: Drive, picture: Path | None, ego: str = "") -> None:
    """Print how a drive went, as a table; `ego` is the id of a further ego whose drive it is."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.metrics.key_figures import key_figures

    summary = drive.summary
    title = Text(f"{f'ego {ego}, ' if ego else ''}{summary['title']} (seed {summary['seed']})")
    table = Table(title=title, title_justify="left", show_header=False)
    for name, value in key_figures(summary).items():
        table.add_row(name, value)
    table.add_row("record hash", summary["record_sha256"][:16] + "…")
    unjudged = "not judged: " + ("nothing was commanded" if summary.get("shadow") else "a playback")
    judged = {True: "[green]passed[/green]", False: "[red]failed[/red]", None: unjudged}
    table.add_row("criteria", judged[summary["passed"]])
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(f"record:  {drive.folder}", highlight=False, markup=False)
    if picture is not None:
        console.print(f"picture: {picture}", highlight=False, markup=False)
    for line in summary["failed"]:
        console.print(f"failed: {line}", highlight=False, markup=False)
    for line in summary.get("metric_errors", {}).values():
        console.print(f"not measured: {line}", highlight=False, markup=False)
    if summary["text"]:
        console.print(f"error message: {summary['text']}", highlight=False, markup=False)
