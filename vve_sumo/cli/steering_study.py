"""`vve-sumo study latency --steering`: drives with delayed steering, and where the loop becomes unstable."""

from __future__ import annotations

import argparse
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo import progress_bar
from vve_sumo.cli.console import complain, plain_console
from vve_sumo.errors import ConfigError, SimulationError

if TYPE_CHECKING:
    from rich.table import Table

    from vve_sumo.analysis.steering_study import SteeringStudy

PICTURE = "steering_margin.png"
#: options of the other study
OTHERS = ("delays_ms", "noise", "seeds")
#: line width where there is no terminal [characters]
WIDTH = 120


def run(arguments: argparse.Namespace) -> int:
    """Drive the unfinished runs, show the margins and draw them; return the exit code."""
    from vve_sumo.sweep.conclusion import write_search_result
    from vve_sumo.sweep.fill import engine_of, fill
    from vve_sumo.sweep.steering_study import steering_study

    for option in OTHERS:
        if getattr(arguments, option) is not None:
            raise ConfigError(f"--{option.replace('_', '-')}: the delay margin of a steering is searched without it")
    name, out, rig = arguments.scenario, arguments.out, arguments.rig
    query = steering_study(name, Path.cwd(), speeds=arguments.speeds_mps, mass_factors=arguments.mass_factors, rig=rig)
    with progress_bar.of_runs(quiet=arguments.quiet) as shown:
        search = fill(
            out,
            query,
            engine_of(arguments.workers, None),
            query.spec.keep,
            resume=arguments.resume,
            resume_command=_again(arguments),
            progress=shown,
            notify=complain,
        )
    assert search is not None
    assert search.result is not None
    write_search_result(out, search.result)
    return _conclude(name, out, Path(query.plan.working), rig, search.result["errors"] == search.result["runs"])


def _again(arguments: argparse.Namespace) -> str:
    """Return the command that continues the study."""
    words = ["vve-sumo", "study", "latency", arguments.scenario, "--out", str(arguments.out), "--steering"]
    for option in ("speeds_mps", "mass_factors"):
        if (values := getattr(arguments, option)) is not None:
            words += [f"--{option.replace('_', '-')}", ",".join(f"{value:.15g}" for value in values)]
    words += ["--rig", arguments.rig] if arguments.rig else []
    return shlex.join([*words, "--resume"])


def _conclude(name: str, out: Path, working: Path, rig: str | None, broke: bool) -> int:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.steering_study import keep_prediction, steering_study_of
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.steering_margins import predicted_margin
    from vve_sumo.plotting import save, steering_margin

    resolved, reason = resolve_by_name(name, working, rig=rig), ""
    try:
        predicted_margin(resolved, working, resolved.scenario.ego.speed_mps, 1.0, 0.0)
    except ConfigError as error:
        reason = str(error)
    sweep = Sweep(out)
    keep_prediction(sweep, lambda *line: predicted_margin(resolved, working, *line), reason)
    study = steering_study_of(sweep)
    console = plain_console(WIDTH)
    console.print(_table(study))
    for line in study.verdicts():
        console.print(line)
    save(steering_margin(study), out / PICTURE)
    print(f"rows: {out / 'rows'}\npicture: {out / PICTURE}")
    return SimulationError.exit_code if broke else 0


def _table(study: SteeringStudy) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=study.title, title_justify="left", box=box.SIMPLE)
    for head in ("speed [m/s]", "mass x", "observer [s]", "predicted [ms]", "measured [ms]", "difference [%]"):
        table.add_column(head, justify="right", overflow="fold")
    for row in study.margins.to_dict("records"):
        observer = f"{row['observer_s']:g}" if row["observer_s"] > 0.0 else "none"
        apart = f"{row['difference_percent']:+.1f}" if math.isfinite(row["difference_percent"]) else ""
        texts = (f"{row['speed_mps']:g}", f"{row['mass_factor']:g}", observer, _predicted(row), _measured(row), apart)
        table.add_row(*texts)
    return table


def _predicted(row: dict[Any, Any]) -> str:
    margin = row["predicted_s"]
    return "none" if math.isinf(margin) else "unknown" if math.isnan(margin) else f"{1000.0 * margin:.0f}"


def _measured(row: dict[Any, Any]) -> str:
    stable, unstable = row["stable_to_s"], row["unstable_from_s"]
    if math.isnan(stable):
        return "never stable"
    if math.isnan(unstable):
        return f"above {1000.0 * stable:.0f}"
    return f"{1000.0 * stable:.0f} to {1000.0 * unstable:.0f}"
