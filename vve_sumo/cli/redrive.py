"""`vve-sumo redrive`: runs another controller on a record's inputs, open loop."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import OF_FILES, Parser

if TYPE_CHECKING:
    from vve_sumo.live.review import RedriveResult

EXIT_CODES = OF_FILES

SUMMARY = "run another controller on a record's inputs, open loop"
TEXT = """\
Feed a record's pose bytes, car reports and actors to another controller and compare its commands with the
recorded ones, tick by tick. Open loop: the car followed the recorded controller. Writes redrive.png into DIR.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("record", type=Path, metavar="DIR", help="folder of a drive, in lockstep or live, or cut off")
    parser.add_argument("--controller", metavar="NAME", required=True, help="shipped name, file.py:make or entry point")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="commands of both controllers at every tick, as .parquet or .csv"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run another controller on a record's inputs, print and draw its commands; return the exit code."""
    from vve_sumo.drive import redrive
    from vve_sumo.live import review
    from vve_sumo.plotting.redrive import draw

    folder, out = arguments.record, arguments.out
    if out is not None:
        redrive.require_writable(out)
    for each in review.altered_since(folder) or ():
        notify(f"note: {each}")
    redriven = review.redrive_with(folder, arguments.controller, Path.cwd())
    scenario = redriven.resolved.scenario
    # The full path of a file.py:make would fill the screen.
    names = (scenario.controller.name.rpartition("/")[2], arguments.controller.rpartition("/")[2])
    _show(redriven, names)
    picture = folder / "redrive.png"
    draw(redriven.table, redriven.comparison, f"{scenario.title} (seed {scenario.seed})", names, picture)
    print(f"picture: {picture}")
    if out is not None:
        redrive.write(redriven.table, out)
        print(f"table:   {out}")
    return 0


def _show(redriven: RedriveResult, names: tuple[str, str]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.drive.redrive import BRAKING_THRESHOLD

    comparison = redriven.comparison
    title = Text(f"open loop: the car followed {names[0]}; the commands of {names[1]} had no effect")
    table = Table(title=title, title_justify="left")
    for head in ("", *names):
        table.add_column(Text(head))
    pair = (comparison.recorded, comparison.other)
    table.add_row(f"first brakes (> {BRAKING_THRESHOLD:g} m/s²)", *(_at(one.first_braking_time) for one in pair))
    table.add_row("first requests emergency braking", *(_at(one.first_emergency_time) for one in pair))
    table.add_row("notes", *(Text(", ".join(one.notes)) for one in pair))
    if any(one.first_failure is not None for one in pair):
        table.add_row("first fails to return a command", *(_tick(one.first_failure) for one in pair))
    console = Console(soft_wrap=True)
    console.print(table)
    plain: dict[str, Any] = {"highlight": False, "markup": False}
    console.print(
        f"{comparison.ticks} ticks compared; first tick that differs: {_tick(comparison.first_difference)}", **plain
    )
    for name, difference in (("greatest", comparison.greatest), ("rms", comparison.rms)):
        steering, acceleration = math.degrees(difference["steering_rad"]), difference["acceleration_mps2"]
        console.print(f"{name} difference: steering {steering:.3f}°, acceleration {acceleration:.3f} m/s²", **plain)
    if redriven.failure:
        console.print(f"the last failure of {names[1]}: {redriven.failure}", **plain)


def _at(time: float) -> str:
    return "never" if math.isnan(time) else f"{time:.2f} s"


def _tick(tick: int | None) -> str:
    return "none" if tick is None else f"tick {tick}"
