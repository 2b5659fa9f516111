"""`vve-sumo drive` from names to record, picture and table.

The only module of the room that looks at the wall clock or prints; everything it prints, it also records.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Protocol

from vve_sumo import workspace
from vve_sumo.controller import companion
from vve_sumo.drive import figures
from vve_sumo.drive.ending import Outcome
from vve_sumo.drive.lockstep import Lockstep, Run, Watch
from vve_sumo.drive.playback import Playback
from vve_sumo.drive.record import Record, claim, read_table
from vve_sumo.drive.setting import EPOCH, PERIOD, Setting, resolve
from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Band, Criteria

#: ticks between two looks at the progress bar
PROGRESS_TICKS = 25


class Shell(Protocol):
    """What lockstep and playback have in common."""

    def run(self, record: Record, watch: Watch) -> Run:
        """Drive to the end."""
        ...

    def close(self) -> None:
        """End the simulation."""
        ...


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive that is over."""

    folder: FilePath  #: its record
    summary: dict[str, Any]  #: as in summary.json

    @property
    def passed(self) -> bool:
        """Whether it met its scenario's criteria."""
        return bool(self.summary["passed"])


def choose(name: str, working: FilePath, *, seed: int | None = None, controller: str | None = None) -> Setting:
    """Return the setting of a scenario by name or file, with the command line's wishes laid over it.

    Raises ConfigError for whatever is missing or wrong.
    """
    file = workspace.find("scenario", name, working)
    scenario = load(file)
    if seed is not None:
        if not 0 <= seed < 2**31:
            raise ConfigError(f"--seed: expected 0 to 2147483647, got {seed}")
        scenario = scenario.model_copy(update={"seed": seed})
    if controller is not None:
        tuning = scenario.controller.tuning if controller == scenario.controller.name else {}
        control = scenario.controller.model_copy(update={"name": controller, "tuning": tuning})
        scenario = scenario.model_copy(update={"controller": control})
    return resolve(file.name.removesuffix(".toml"), scenario, file, working)


def run(
    setting: Setting,
    folder: FilePath,
    working: FilePath,
    *,
    pose: FilePath | None = None,
    watch: Watch = lambda tick, now, speed, station: None,
) -> Drive:
    """Drive a setting, or play the recording `pose` in it, into a new record folder.

    Raises ConfigError before anything is written. What breaks later is recorded as the outcome `broken`, and the
    keyboard's interrupt as `interrupted`.
    """
    claim(folder)
    shell: Shell = Lockstep(setting, working) if pose is None else Playback(setting, pose, working)
    try:
        resolved = setting.resolved() | ({"pose": pose.name} if pose is not None else {})
        epoch = shell.epoch if isinstance(shell, Playback) else EPOCH
        record = Record(folder, resolved, epoch)
        done = _guarded(shell, record, watch)
    finally:
        shell.close()
    digest = record.close()
    summary = summarise(setting, done, folder, digest)
    record.summarise(summary)
    return Drive(folder, summary)


def _guarded(shell: Shell, record: Record, watch: Watch) -> Run:
    broken = Run(Outcome.BROKEN, False, (), 0, 0.0, 0.0, 0.0)
    try:
        return shell.run(record, watch)
    except KeyboardInterrupt:
        return replace(broken, outcome=Outcome.INTERRUPTED, reasons=("interrupted",))
    except SimulationError as error:
        return replace(broken, reasons=("simulation_error",), text=str(error))


def summarise(setting: Setting, done: Run, folder: FilePath, digest: str) -> dict[str, Any]:
    """Return what `summary.json` says of a drive."""
    ticks, actors = read_table(folder, "ticks"), read_table(folder, "actors")
    measured = figures.measure(ticks, actors, setting.path, setting.vehicle)
    summary: dict[str, Any] = {
        "scenario": setting.name,
        "title": setting.scenario.title,
        "seed": setting.scenario.seed,
        "controller": setting.scenario.controller.name,
        "outcome": done.outcome.value,
        "reasons": list(done.reasons),
        "collision": done.collided,
        **asdict(measured),
        "emergency_used": bool(any(ticks["emergency"].to_pylist())),
        "duration_s": done.duration,
        "ticks": done.ticks,
        "anchor_position_error_m": done.anchor_position_error,
        "anchor_speed_error_mps": done.anchor_speed_error,
        "text": done.text,
        "versions": setting.resolved()["versions"],
    }
    failed = judge(setting.scenario.criteria, summary)
    return summary | {"passed": not failed, "failed": failed, "record_sha256": digest}


def judge(criteria: Criteria, summary: dict[str, Any]) -> list[str]:
    """Return a line for every criterion that a drive's summary does not meet."""
    if summary["outcome"] == Outcome.PLAYED:
        return []
    failed = []
    for name, wanted in criteria:
        if wanted is None:
            continue
        got = summary[name]
        if isinstance(wanted, Band):
            low, high = wanted.min, wanted.max
            # A figure that there is none of (NaN) meets an upper limit on nothing, but no band that has a least value.
            good = (low is None or got >= low) and (high is None or not got > high)
            if not good:
                failed.append(f"{name} is {got:.3f}, expected {_band(wanted)}")
        elif got != wanted:
            failed.append(f"{name} is {got}, expected {wanted}")
    if summary["outcome"] in (Outcome.BROKEN, Outcome.INTERRUPTED):
        failed.append(f"the drive was {summary['outcome']}")
    return failed


def _band(band: Band) -> str:
    if band.min is None:
        return f"at most {band.max:g}"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"


def draw(setting: Setting, drive: Drive) -> FilePath:
    """Write `drive.png` into a record and return its place."""
    from vve_sumo.drive.picture import Sheet, bounds
    from vve_sumo.drive.picture import draw as paint
    from vve_sumo.world.network import lane_shapes

    ticks, actors = read_table(drive.folder, "ticks"), read_table(drive.folder, "actors")
    summary = drive.summary
    gap = f", gap {summary['stop_gap_m']:.2f} m" if summary["stop_gap_m"] == summary["stop_gap_m"] else ""
    sheet = Sheet(
        title=setting.scenario.title,
        subtitle=f"{summary['outcome']}{gap} · seed {summary['seed']} · {'passed' if drive.passed else 'FAILED'}",
        ticks=ticks,
        actors=actors,
        seen=figures.ahead(ticks, actors, setting.path, setting.vehicle),
        path=setting.path,
        vehicle=setting.vehicle,
        lanes=lane_shapes(setting.network.path, bounds(ticks)),
    )
    file = drive.folder / "drive.png"
    paint(sheet, file)
    return file


@contextlib.contextmanager
def _progress(setting: Setting, quiet: bool) -> Iterator[Watch]:
    if quiet or not sys.stderr.isatty():
        yield lambda tick, now, speed, station: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[say]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(setting.name, total=setting.path.length, say="starting")
        begun = time.monotonic()

        def watch(tick: int, now: float, speed: float, station: float) -> None:
            if tick % PROGRESS_TICKS == 0 and station == station:
                faster = now / max(time.monotonic() - begun, 1e-3)
                say = f"{now:6.1f} s  {speed:5.1f} m/s  {faster:4.1f} x real time"
                bar.update(task, completed=station, say=say)

        yield watch


def _folder(setting: Setting, working: FilePath) -> FilePath:
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}_{setting.name}"
    names = (stem if number == 1 else f"{stem}_{number}" for number in range(1, 1000))
    return next(working / "runs" / name for name in names if not (working / "runs" / name).exists())


def _show(drive: Drive, picture: FilePath | None) -> None:
    from rich.console import Console
    from rich.table import Table

    summary = drive.summary
    table = Table(title=f"{summary['title']} (seed {summary['seed']})", title_justify="left", show_header=False)
    rows = {
        "outcome": summary["outcome"],
        "collision": "yes" if summary["collision"] else "no",
        "gap at rest": _say(summary["stop_gap_m"], "m"),
        "least time to collision": _say(summary["min_ttc_s"], "s"),
        "greatest lateral deviation": _say(summary["max_lateral_deviation_m"], "m"),
        "greatest deceleration": _say(summary["max_deceleration_mps2"], "m/s²"),
        "emergency layer": "braked" if summary["emergency_used"] else "not needed",
        "drive time": f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks of {PERIOD * 1000:.0f} ms",
        "record": str(drive.folder),
        "record hash": summary["record_sha256"][:16] + "…",
    }
    if picture is not None:
        rows["picture"] = str(picture)
    for name, value in rows.items():
        table.add_row(name, value)
    table.add_row("criteria", "[green]passed[/green]" if drive.passed else "[red]failed[/red]")
    console = Console(soft_wrap=True)
    console.print(table)
    for line in drive.summary["failed"]:
        console.print(f"failed: {line}", highlight=False)
    if summary["text"]:
        console.print(f"the controller said: {summary['text']}", highlight=False, markup=False)


def _say(value: float, unit: str) -> str:
    return "none" if value != value else f"{value:.2f} {unit}"


def drive(
    name: str,
    *,
    out: FilePath | None,
    seed: int | None,
    controller: str | None,
    pose: FilePath | None,
    quiet: bool,
) -> int:
    """Run the command: drive, draw, show; return the exit code."""
    working = FilePath.cwd()
    setting = choose(name, working, seed=seed, controller=controller)
    folder = out if out is not None else _folder(setting, working)
    with _progress(setting, quiet) as watch:
        done = run(setting, folder, working, pose=pose, watch=watch)
    picture = None
    with contextlib.suppress(VveError):
        picture = draw(setting, done) if done.summary["ticks"] else None
    _show(done, picture)
    if done.summary["outcome"] == Outcome.BROKEN:
        print(f"vve-sumo: the simulation broke: {done.summary['text']}", file=sys.stderr)
        return SimulationError.exit_code
    return 0 if done.passed else 1


def design(name: str, latency: float) -> int:
    """Print the margins of a scenario's preview steering; refuse what a latency [s] would make unstable."""
    if not latency >= 0.0:
        raise ConfigError(f"--latency-ms: expected 0 or more, got {1000.0 * latency:g}")
    working = FilePath.cwd()
    setting = choose(name, working)
    tuning = setting.scenario.controller.tuning
    if tuning.get("steering", "preview") != "preview":
        raise ConfigError(f"{name}: the design knows the preview steering, got {tuning['steering']!r}")
    gains = companion("design", workspace.controller_folders(working))
    named = {"look_ahead_time": "look_ahead_time_s", "look_ahead_least": "look_ahead_least_m"}
    preview = replace(gains.DEFAULT, **{ours: float(tuning[key]) for ours, key in named.items() if key in tuning})
    rows = gains.margins(setting.vehicle, preview)
    print(gains.table(rows))
    gains.check(rows, latency)
    worst = min(row.delay_margin for row in rows)
    print(f"bears the stated {1000.0 * latency:.0f} ms at every speed; the least margin is {1000.0 * worst:.0f} ms")
    return 0
