"""The progress of many runs and of a single drive as it is shown: a bar on a terminal, a bar in Jupyter's cell.

Where there is neither, many runs have a line on standard error now and then, and a drive has none.
"""

from __future__ import annotations

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vve_sumo.drive.progress import DriveProgress
    from vve_sumo.sweep.progress import Tally

#: between two lines where there is no bar [s]
LINE_PERIOD = 10.0
#: between two messages to Jupyter [s]
CELL_PERIOD = 0.1

#: takes how much is done, of how much (None where nobody knows), and a text beside the bar
Bar = Callable[[float, float | None, str], None]


@contextlib.contextmanager
def of_runs(*, quiet: bool) -> Iterator[Callable[[Tally], None]]:
    """Give what takes the tally before the first run and after every run, and shows it."""
    with _shown("", quiet=quiet, otherwise=_lines) as bar:
        yield lambda tally: bar(tally.finished, tally.total, tally.text())


@contextlib.contextmanager
def of_drive(name: str, *, quiet: bool) -> Iterator[Callable[[DriveProgress], None]]:
    """Give what takes the progress of a drive of the scenario `name`, and shows how far along its path the car is."""
    with _shown(name, quiet=quiet, otherwise=_nothing) as bar:
        begun = time.monotonic()
        bar(0.0, None, "starting")

        def show(at: DriveProgress) -> None:
            faster = at.time / max(time.monotonic() - begun, 1e-3)
            bar(at.s, at.length, f"{at.time:6.1f} s  {at.speed:5.1f} m/s  {faster:4.1f} x real time")

        yield show


@contextlib.contextmanager
def of_pictures(total: int) -> Iterator[Callable[[int], None]]:
    """Give what takes the number of pictures that are drawn, of `total`, and shows it."""
    with _shown("drawing", quiet=False, otherwise=_nothing) as bar:
        yield lambda done: bar(done, total, f"{done} of {total}")


@contextlib.contextmanager
def of_hunt(*, quiet: bool) -> Iterator[Bar]:
    """Give what takes the number of episodes done, of how many, and a text, and shows them."""
    with _shown("", quiet=quiet, otherwise=_lines) as bar:
        yield bar


@contextlib.contextmanager
def _shown(title: str, *, quiet: bool, otherwise: Callable[[], Bar]) -> Iterator[Bar]:
    """Give a bar that goes with the place where the program runs, and that is taken away at the end."""
    if quiet:
        yield _nothing()
    elif _in_jupyter():
        with _cell(title) as bar:
            yield bar
    elif sys.stderr.isatty():
        with _terminal(title) as bar:
            yield bar
    else:
        yield otherwise()


def _nothing() -> Bar:
    return lambda done, total, text: None


def _lines() -> Bar:
    from rich.console import Console

    console, printed_at = Console(stderr=True, soft_wrap=True, highlight=False, markup=False), time.monotonic()

    def show(done: float, total: float | None, text: str) -> None:
        nonlocal printed_at
        if time.monotonic() - printed_at >= LINE_PERIOD:
            printed_at = time.monotonic()
            console.print(text)

    return show


@contextlib.contextmanager
def _terminal(title: str) -> Iterator[Bar]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20), TextColumn("{task.fields[say]}"))
    with Progress(*columns if title else columns[1:], console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None, say="")
        yield lambda done, total, text: bar.update(task, total=total, completed=done, say=text)


def _in_jupyter() -> bool:
    """Whether a Jupyter kernel runs this process; without one nothing is imported to find out."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


@contextlib.contextmanager
def _cell(title: str) -> Iterator[Bar]:
    # Rich's own bar in Jupyter needs ipywidgets and is nothing without a front end that runs them.
    from IPython.display import HTML, display

    handle: Any = display(HTML(""), display_id=True)
    shown_at = 0.0

    def show(done: float, total: float | None, text: str) -> None:
        nonlocal shown_at
        if time.monotonic() - shown_at >= CELL_PERIOD:
            shown_at = time.monotonic()
            share = "" if total is None else f' value="{done:.6g}" max="{total:.6g}"'
            label = html.escape(f"{title} {text}".strip())
            handle.update(HTML(f"<progress{share}></progress> <code>{label}</code>"))

    try:
        yield show
    finally:
        handle.update(HTML(""))
