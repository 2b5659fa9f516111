"""`vve-sumo study`: drives a standard study as a sweep and evaluates its rows."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli import gains_study, steering_study
from vve_sumo.cli.console import complain, note, plain_console
from vve_sumo.cli.parser import Parser, add_command, add_subcommands, numbers
from vve_sumo.errors import ConfigError, SimulationError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from vve_sumo.analysis.latency_margin import LatencyMargin
    from vve_sumo.sweep.plan import SweepQuery

EXIT_CODES = """exit codes:
  0  every run is a row, passed or not
  2  wrong use or configuration; nothing was driven
  4  every run broke, or the disk is full
  130  interrupted from the keyboard; --resume continues
"""

PICTURE = "latency_margin.png"
#: line width where there is no terminal [characters]
WIDTH = 120

SUMMARY = "standard studies of a scenario"
LATENCY_TEXT = """\
Drive a scenario repeatedly with increasing pose delay and noise, and report the delay at which its margin becomes
zero. The delay is hidden: fixes are older than their epoch says, as with a wrong clock, so that no predictor can
compensate it. The table also has the closed form, speed times delay, which is what an open-loop brake loses, and
the delay that the steering tolerates by design. The folder is a sweep's dataset with the picture
latency_margin.png.

The margin is the gap at rest, or the smallest gap of a drive that does not stop; zero or less after a contact. A
car that its gateway stopped early (unstable steering, wheel speed and pose inconsistent) has none.

examples:
  vve-sumo study latency parked_car --out late               0 to 500 ms, noise x 0, 1, 4, three seeds
  vve-sumo study latency seen_late --out seen_late --delays-ms 0,100,200,300 --noise 1 --seeds 5
  vve-sumo study latency delay_probe --out probe              open loop: exactly speed times delay
  vve-sumo study latency parked_car --out late --resume      continue after a kill

With --steering, the delay is one of the steering, and the study measures at which delay the steering loop becomes
unstable: at each speed, without and with an observer that bears delay, beside what the closed form predicts. SCENARIO
is then one of the controller steering_probe. The picture is steering_margin.png.

  vve-sumo study latency steering_probe --out margins --steering
  vve-sumo study latency steering_probe --out heavy --steering --speeds-mps 5,10 --mass-factors 1,1.3
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    studies = add_subcommands(parser)
    gains_study.add(studies)
    latency = add_command(
        studies,
        "latency",
        "delay and noise at which a scenario's margin becomes zero",
        LATENCY_TEXT,
        EXIT_CODES,
    )
    latency.add_argument("scenario", help="name or .toml file")
    latency.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the dataset, absent or empty"
    )
    latency.add_argument(
        "--delays-ms", type=numbers, metavar="MS,MS", help="hidden delays, 0 to 1000 (default: 0 to 500 by 50)"
    )
    latency.add_argument(
        "--noise",
        type=numbers,
        metavar="X,X",
        help="factors on the receiver's noise (default: 0,1,4; 0 where the scenario turns it off)",
    )
    latency.add_argument(
        "--seeds", type=int, metavar="N", help="drives of each step (default: 3; 1 if the scenario has no random input)"
    )
    latency.add_argument(
        "--steering", action="store_true", help="measure the delay at which the steering loop becomes unstable"
    )
    latency.add_argument(
        "--speeds-mps", type=numbers, metavar="X,X", help="with --steering: speeds, 3 to 16 (default: 4,7,10,13,16)"
    )
    latency.add_argument(
        "--mass-factors",
        type=numbers,
        metavar="X,X",
        help="with --steering: true over declared mass, 0.5 to 2 (default: 1)",
    )
    latency.add_argument("--rig", metavar="NAME", help="the simulated vehicle as this rig declares and calibrates it")
    latency.add_argument("--workers", type=int, metavar="N", help="runs in parallel (default: one a processor)")
    latency.add_argument("--resume", action="store_true", help="continue the study in DIR; finished runs are kept")
    latency.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    latency.set_defaults(run=_latency)


def _latency(arguments: argparse.Namespace) -> int:
    """Drive the unfinished runs, show the latency margin and draw it; return the exit code."""
    if arguments.steering:
        return steering_study.run(arguments)
    for option in ("speeds_mps", "mass_factors"):
        if getattr(arguments, option) is not None:
            raise ConfigError(f"--{option.replace('_', '-')}: is for --steering")
    from vve_sumo.sweep.fill import engine_of, fill
    from vve_sumo.sweep.study import latency_study

    name, out = arguments.scenario, arguments.out
    delays_ms, factors, seeds = arguments.delays_ms, arguments.noise, arguments.seeds
    steps = _steps(delays_ms, factors, seeds)
    resume_command = f"vve-sumo study latency {shlex.quote(name)} --out {shlex.quote(str(out))}{steps}"
    resume_command += f" --rig {shlex.quote(arguments.rig)} --resume" if arguments.rig else " --resume"
    query = latency_study(name, Path.cwd(), delays_ms=delays_ms, factors=factors, seeds=seeds, rig=arguments.rig)
    for line in query.notes:
        note(line)
    engine, keep = engine_of(arguments.workers, None), query.spec.keep
    with progress_bar.of_runs(quiet=arguments.quiet) as shown:
        fill(
            out,
            query,
            engine,
            keep,
            resume=arguments.resume,
            resume_command=resume_command,
            progress=shown,
            notify=complain,
        )
    return _conclude(name, out, query, arguments.rig)


def _steps(delays_ms: Sequence[float] | None, factors: Sequence[float] | None, seeds: int | None) -> str:
    """Return the given options that set the steps."""
    given = {"--delays-ms": delays_ms, "--noise": factors, "--seeds": None if seeds is None else [seeds]}
    return "".join(
        f" {key} {','.join(f'{one:.15g}' for one in ones)}" for key, ones in given.items() if ones is not None
    )


def _conclude(name: str, out: Path, query: SweepQuery, rig: str | None) -> int:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.latency_margin import keep_design_margin, latency_margin_of
    from vve_sumo.plotting import latency_margin, save

    delay, reason = _design_margin(name, Path(query.plan.working), rig)
    keep_design_margin(out, delay)
    margin = latency_margin_of(Sweep(out))
    _show(margin, reason)
    save(latency_margin(margin), out / PICTURE)
    print(f"rows: {out / 'rows'}\npicture: {out / PICTURE}")
    return SimulationError.exit_code if not margin.steps["judged"].any() else 0


def _design_margin(name: str, working: Path, rig: str | None) -> tuple[float, str]:
    """Return the delay that the steering tolerates by design [s], or NaN and why it is unknown."""
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.steering_margins import margins_at_speed

    resolved = resolve_by_name(name, working, rig=rig)
    try:
        return margins_at_speed(resolved, working).delay, ""
    except ConfigError as error:
        return math.nan, str(error)


def _show(margin: LatencyMargin, reason: str) -> None:
    console = plain_console(WIDTH)
    console.print(_table(margin.title, margin.steps))
    for line in [*margin.verdicts(), *filter(None, [reason])]:
        console.print(line)


def _table(title: str, steps: pd.DataFrame) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    heads = ("noise x", "delay [ms]", "margin [m]", "least [m]", "v x delay [m]", "lateral [m]", "passed", "missed")
    for head in heads:
        table.add_column(head, justify="left" if head == "missed" else "right", overflow="fold")
    for row in steps.to_dict("records"):
        passed = f"{round(row['passed_share'] * row['judged'])}" if row["judged"] else "0"
        lengths = ("mean_margin_m", "least_margin_m", "closed_form_m", "lateral_deviation_m")
        table.add_row(
            f"{row['noise_factor']:g}",
            f"{1000.0 * row['delay_s']:g}",
            *(_length(row[length]) for length in lengths),
            f"{passed} of {row['runs']}",
            row["missed"].replace("+", ", "),
        )
    return table


def _length(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "none"
