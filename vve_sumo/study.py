"""`vve-sumo study`: a standard study driven by the sweep and read by the analysis, which know nothing of each other.

The only module that joins the two; it prints what stands in the tables, and measures nothing itself.
"""

from __future__ import annotations

import json
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.drive.command import choose, design_at
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep.command import engine_of, fill
from vve_sumo.sweep.plan import SweepQuery
from vve_sumo.sweep.study import cliff_study

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from vve_sumo.analysis.latency_margin import LatencyMargin

PICTURE = "cliff.png"


def cliff(
    name: str,
    *,
    out: Path,
    delays_ms: Sequence[float] | None,
    factors: Sequence[float] | None,
    seeds: int | None,
    workers: int | None,
    resume: bool,
    quiet: bool,
) -> int:
    """Run the command: drive what is not finished, show the cliff and draw it; return the exit code."""
    steps = _steps(delays_ms, factors, seeds)
    again = f"vve-sumo study cliff {shlex.quote(name)} --out {shlex.quote(str(out))}{steps} --resume"
    wanted = cliff_study(name, Path.cwd(), delays_ms=delays_ms, factors=factors, seeds=seeds)
    try:
        fill(out, wanted, engine_of(workers, None), wanted.spec.keep, resume=resume, quiet=quiet, again=again)
    except KeyboardInterrupt as interrupt:
        print(f"vve-sumo: {interrupt}", file=sys.stderr)
        return 130
    return _conclude(name, out, wanted)


def _steps(delays_ms: Sequence[float] | None, factors: Sequence[float] | None, seeds: int | None) -> str:
    """Return the options that say the steps, as far as they were given."""
    given = {"--delays-ms": delays_ms, "--noise": factors, "--seeds": None if seeds is None else [seeds]}
    return "".join(
        f" {key} {','.join(f'{one:.15g}' for one in ones)}" for key, ones in given.items() if ones is not None
    )


def _conclude(name: str, out: Path, wanted: SweepQuery) -> int:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.latency_margin import NOTE, latency_margin_of
    from vve_sumo.plotting.latency_margins import latency_margin as drawn
    from vve_sumo.plotting.style import save

    margin, why = _design(name, wanted)
    note = {"design_delay_margin_s": margin if math.isfinite(margin) else None}
    (out / NOTE).write_text(json.dumps(note) + "\n", encoding="utf-8")
    found = latency_margin_of(Sweep(out))
    _show(found, why)
    save(drawn(found), out / PICTURE)
    print(f"rows: {out / 'rows'}\npicture: {out / PICTURE}")
    return SimulationError.exit_code if not found.steps["judged"].any() else 0


def _design(name: str, wanted: SweepQuery) -> tuple[float, str]:
    """Return the delay that the steering bears by its design [s], or NaN and why nobody knows."""
    setting = choose(name, Path(wanted.plan.working))
    try:
        return design_at(setting, Path(wanted.plan.working)).delay_margin, ""
    except ConfigError as error:
        return math.nan, f"no design margin: {error}"


def _show(found: LatencyMargin, why: str) -> None:
    from rich.console import Console

    console = Console(soft_wrap=True, highlight=False, markup=False, width=None if sys.stdout.isatty() else 120)
    console.print(_table(found.title, found.steps))
    for line in [*found.verdicts(), *filter(None, [why])]:
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
