"""How a drive went, in lockstep or live: its picture and its table."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.errors import VveError

if TYPE_CHECKING:
    from vve_sumo.drive.resolved_scenario import ResolvedScenario
    from vve_sumo.drive.run import Drive

#: metrics that the screen shows, in its order
SHOWN = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2", "max_lateral_deviation_m", "max_deceleration_mps2")


def draw_and_show(resolved: ResolvedScenario, drive: Drive) -> None:
    """Draw `drive.png` into a record, where that can be done, and print how the drive went."""
    from vve_sumo.plotting.drive_record import draw_drive

    picture = None
    with contextlib.suppress(VveError, OSError):
        picture = draw_drive(resolved, drive) if drive.summary["ticks"] else None
    show_drive(drive, picture)


def show_drive(drive: Drive, picture: Path | None) -> None:
    """Print how a drive went, as a table."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.drive.resolved_scenario import PERIOD
    from vve_sumo.metrics.metric import unit_of
    from vve_sumo.metrics.table import label_of

    summary = drive.summary
    title = Text(f"{summary['title']} (seed {summary['seed']})")
    table = Table(title=title, title_justify="left", show_header=False)
    rows = {
        "outcome": summary["outcome"],
        "collision": f"yes, at {_say(summary['impact_speed_mps'], 'm/s')}" if summary["collision"] else "no",
        **{label_of(name): _say(summary[name], unit_of(name)) for name in SHOWN},
        label_of("emergency_used"): "braked" if summary["emergency_used"] else "not needed",
        label_of("duration_s"): f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks of {PERIOD * 1000:.0f} ms",
        **_playback_rows(summary),
        "record hash": summary["record_sha256"][:16] + "…",
    }
    for name, value in rows.items():
        table.add_row(name, value)
    judged = {True: "[green]passed[/green]", False: "[red]failed[/red]", None: "not judged: a playback"}
    table.add_row("criteria", judged[summary["passed"]])
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(f"record:  {drive.folder}", highlight=False, markup=False)
    if picture is not None:
        console.print(f"picture: {picture}", highlight=False, markup=False)
    for line in summary["failed"]:
        console.print(f"failed: {line}", highlight=False, markup=False)
    if summary["text"]:
        console.print(f"what went wrong, in its own words: {summary['text']}", highlight=False, markup=False)


def _playback_rows(summary: dict[str, Any]) -> dict[str, str]:
    from vve_sumo.drive.termination import Outcome

    if summary["outcome"] != Outcome.PLAYED:
        return {}
    mean, greatest = (summary[f"prediction_error_100ms_{which}_m"] for which in ("mean", "max"))
    return {"prediction over 100 ms": f"{_say(mean, 'm')} off on average, {_say(greatest, 'm')} at most"}


def _say(value: float, unit: str) -> str:
    return "none" if value != value else f"{value:.3f} {unit}"
