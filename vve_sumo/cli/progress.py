"""The progress of many runs and of a single drive: a bar on a terminal, else a line now and then, on standard error."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vve_sumo.drive.lockstep import Watch
    from vve_sumo.drive.resolved_scenario import ResolvedScenario
    from vve_sumo.sweep.progress import Tally

#: between two lines where there is no terminal [s]
LINE_PERIOD = 10.0
#: ticks of a drive between two looks at the bar
TICKS_PER_LOOK = 25


@contextlib.contextmanager
def of_runs(*, quiet: bool) -> Iterator[Callable[[Tally], None]]:
    """Give what takes the tally before the first run and after every run, and shows it, but not too often."""
    if quiet:
        yield lambda tally: None
    elif sys.stderr.isatty():
        with _bar() as show:
            yield show
    else:
        printed_at = time.monotonic()

        def line(tally: Tally) -> None:
            nonlocal printed_at
            if time.monotonic() - printed_at >= LINE_PERIOD:
                printed_at = time.monotonic()
                print(tally.say(), file=sys.stderr, flush=True)

        yield line


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[Tally], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (BarColumn(bar_width=20), TextColumn("{task.fields[say]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, say="")

        def show(tally: Tally) -> None:
            bar.update(task, total=tally.total, completed=tally.finished, say=tally.say())

        yield show


@contextlib.contextmanager
def of_drive(resolved: ResolvedScenario, *, quiet: bool) -> Iterator[Watch]:
    """Give what looks on while a scenario is driven, and shows how far along its path the car is."""
    if quiet or not sys.stderr.isatty():
        yield lambda tick, now, speed, station: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[say]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(resolved.name, total=resolved.path.length, say="starting")
        begun = time.monotonic()

        def watch(tick: int, now: float, speed: float, station: float) -> None:
            if tick % TICKS_PER_LOOK == 0 and station == station:
                faster = now / max(time.monotonic() - begun, 1e-3)
                say = f"{now:6.1f} s  {speed:5.1f} m/s  {faster:4.1f} x real time"
                bar.update(task, completed=station, say=say)

        yield watch
