"""`vve-sumo drive` from names to record, picture and table.

The only module of the room that looks at the wall clock or prints; everything it prints, it also records.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Protocol

import pyarrow as pa

from vve_sumo import workspace
from vve_sumo.controller import module, sources
from vve_sumo.drive import provenance
from vve_sumo.drive.lockstep import DriveEnd, Lockstep, Watch
from vve_sumo.drive.playback import Playback
from vve_sumo.drive.resolved_scenario import PERIOD, ResolvedScenario, resolve_scenario, versions
from vve_sumo.drive.termination import Outcome
from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.metrics import drive_metrics
from vve_sumo.path import Path
from vve_sumo.record.record import PROVENANCE, MemoryRecorder, Record, claim, hash_files, read_table, whole
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Band, Criteria, Scenario
from vve_sumo.values import ArmingState, Vehicle

#: what a figure that is missing because nothing was ever ahead is as good as; every other one that is missing fails
NOTHING_AHEAD = {"min_ttc_s": math.inf, "min_gap_m": math.inf, "max_drac_mps2": 0.0}
#: ticks between two looks at the progress bar
PROGRESS_TICKS = 25


class Shell(Protocol):
    """What lockstep and playback have in common."""

    epoch: float  #: GNSS second of drive time 0
    laid: dict[str, Any]  #: what ties the drive to time and earth

    def run(self, record: MemoryRecorder, watch: Watch) -> DriveEnd:
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
        """Whether it met its scenario's criteria; a playback has none to meet."""
        return self.summary["passed"] is not False


def choose(
    name: str,
    working: FilePath,
    *,
    seed: int | None = None,
    controller: str | None = None,
    vehicle: str | None = None,
) -> ResolvedScenario:
    """Return the setting of a scenario by name or file, with the command line's wishes laid over it.

    Raises ConfigError for whatever is missing or wrong.
    """
    file = workspace.find("scenario", name, working)
    scenario = load(file)
    if seed is not None:
        if not 0 <= seed < 2**31:
            raise ConfigError(f"--seed: expected 0 to 2147483647, got {seed}")
        scenario = scenario.model_copy(update={"seed": seed})
    if vehicle is not None:
        ego = scenario.ego.model_copy(update={"vehicle": vehicle})
        scenario = scenario.model_copy(update={"ego": ego})
    setting = resolve_scenario(file.name.removesuffix(".toml"), scenario, file, working)
    return setting if controller is None else setting.driven_by(controller)


def run(
    setting: ResolvedScenario,
    folder: FilePath,
    working: FilePath,
    *,
    pose: FilePath | None = None,
    kept: bool = True,
    watch: Watch = lambda tick, now, speed, station: None,
) -> Drive:
    """Drive a setting, or play the recording `pose` in it, into a new record folder.

    Raises ConfigError before anything is written. What breaks later is recorded as the outcome `broken`, and the
    keyboard's interrupt as `interrupted`. With `kept` false nothing is written at all: there is a summary, which lacks
    only the hashes of the record's files, and no folder.
    """
    if kept:
        claim(folder)
    shell: Shell = Lockstep(setting, working) if pose is None else Playback(setting, pose, working)
    try:
        if pose is not None:
            setting = replace(setting, files={**setting.files, "pose": pose})
        resolved = setting.resolved(working) | shell.laid
        record = Record(folder, resolved, shell.epoch) if kept else MemoryRecorder(resolved, shell.epoch)
        if kept:
            now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
            record.attach(PROVENANCE, provenance.text_of(provenance.provenance(setting, now)))
        try:
            done = guarded(shell, record, watch)
        except ConfigError:
            record.discard()
            raise
    finally:
        shell.close()
    parts = record.close()
    summary = summary_of(setting, done, record.tables["ticks"], record.tables["actors"], parts)
    if isinstance(record, Record):
        summary |= {"record_files_sha256": hash_files(folder)}
        record.summarise(summary)
    return Drive(folder, summary)


def guarded(shell: Shell, record: MemoryRecorder, watch: Watch) -> DriveEnd:
    """Drive to the end; whatever breaks under way is how the drive ended, but for a wrong input."""
    broken = DriveEnd(Outcome.BROKEN, ())
    try:
        return shell.run(record, watch)
    except KeyboardInterrupt:
        return replace(broken, outcome=Outcome.INTERRUPTED, reasons=("interrupted",))
    except ConfigError:
        raise
    except SimulationError as error:
        return replace(broken, reasons=("simulation_error",), text=str(error))
    except Exception as error:
        # A mistake of ours: the drive is over, its record is not lost, and the whole story lies in it.
        record.attach("traceback.txt", traceback.format_exc())
        return replace(broken, reasons=("internal_error",), text=f"{type(error).__name__}: {error}")


def summarise(setting: ResolvedScenario, done: DriveEnd, folder: FilePath, parts: dict[str, str]) -> dict[str, Any]:
    """Return what `summary.json` says of the drive whose record lies in `folder`; `parts` are its hashes."""
    told = summary_of(setting, done, read_table(folder, "ticks"), read_table(folder, "actors"), parts)
    return told | {"record_files_sha256": hash_files(folder)}


class Driven(Protocol):
    """What a drive's figures are judged by: a setting, or what a record says of one."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        ...

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        ...

    @property
    def path(self) -> Path:
        """Where the rear axle was to go, in the street's map."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The car as declared."""
        ...


def summary_of(
    setting: Driven, done: DriveEnd, ticks: pa.Table, actors: pa.Table, parts: dict[str, str]
) -> dict[str, Any]:
    """Return what a summary says of a drive, but for the hashes of files; `parts` are those of its record."""
    measured = drive_metrics.measure(ticks, actors, setting.path, setting.vehicle)
    summary: dict[str, Any] = {
        "scenario": setting.name,
        "title": setting.scenario.title,
        "seed": setting.scenario.seed,
        "controller": setting.scenario.controller.name,
        "outcome": done.outcome.value,
        "reasons": list(done.reasons),
        "collision": any(ticks["contacts"].to_pylist()),
        **asdict(measured),
        "emergency_used": emergency_used(ticks),
        "duration_s": float(ticks["time_s"][-1].as_py() - ticks["time_s"][0].as_py()) if ticks.num_rows else 0.0,
        "ticks": ticks.num_rows,
        "anchor_position_error_m": greatest(ticks["anchor_position_error_m"]),
        "anchor_speed_error_mps": greatest(ticks["anchor_speed_error_mps"]),
        **done.extra,
        "removed_at_entry": list(done.cleared),
        "removed_after_standoff": list(done.standoffs),
        "sumo_warnings": list(done.warnings),
        "text": done.text,
        "versions": versions(),
    }
    failed = judge(setting.scenario.criteria, summary)
    passed = None if done.outcome is Outcome.PLAYED else not failed
    hashes = {"record_sha256": whole(parts), "record_parts_sha256": parts}
    return summary | {"passed": passed, "failed": failed} | hashes


def greatest(column: pa.ChunkedArray) -> float:
    """Return the greatest number of a column; NaN where it holds none."""
    values = [value for value in column.to_pylist() if value == value]
    return max(values, default=math.nan)


def emergency_used(ticks: pa.Table) -> bool:
    """Whether the car was braked by the emergency layer, not merely asked to be while nobody obeyed."""
    engaged = ArmingState.ENGAGED.value
    return any(
        asked and state == engaged
        for asked, state in zip(ticks["emergency"].to_pylist(), ticks["state"].to_pylist(), strict=True)
    )


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
            got = NOTHING_AHEAD.get(name, got) if math.isnan(got) else got
            good = (wanted.min is None or got >= wanted.min) and (wanted.max is None or got <= wanted.max)
            if not good:
                failed.append(f"{name} is {got:.3f}, expected {_band(wanted)}")
        elif got != wanted:
            failed.append(f"{name} is {got}, expected {wanted}")
    if summary["outcome"] in (Outcome.BROKEN, Outcome.INTERRUPTED):
        failed.append(f"the drive was {summary['outcome']}")
    if summary["outcome"] == Outcome.FAULT and criteria.outcome is None:
        failed.append("a fault ended the drive")
    return failed


def _band(band: Band) -> str:
    if band.min is None:
        return f"at most {band.max:g}"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"


def draw(setting: ResolvedScenario, drive: Drive) -> FilePath:
    """Write `drive.png` into a record and return its place."""
    from vve_sumo.plotting.drive_page import bounds
    from vve_sumo.plotting.drive_page import draw as paint
    from vve_sumo.plotting.page import Sheet, said
    from vve_sumo.world.network import lane_shapes

    ticks, actors = read_table(drive.folder, "ticks"), read_table(drive.folder, "actors")
    sheet = Sheet(
        title=setting.scenario.title,
        subtitle=said(drive.summary),
        ticks=ticks,
        actors=actors,
        seen=drive_metrics.ahead(ticks, actors, setting.path, setting.vehicle),
        path=setting.path,
        vehicle=setting.vehicle,
        lanes=lane_shapes(setting.network.path, bounds(ticks)),
    )
    file = drive.folder / "drive.png"
    paint(sheet, file)
    return file


@contextlib.contextmanager
def _progress(setting: ResolvedScenario, quiet: bool) -> Iterator[Watch]:
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


def folder_for(setting: ResolvedScenario, working: FilePath) -> FilePath:
    """Return a record folder that is not there yet, named by the time and the scenario."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}_{setting.name}"
    names = (stem if number == 1 else f"{stem}_{number}" for number in range(1, 1000))
    return FilePath("runs") / next(name for name in names if not (working / "runs" / name).exists())


def show(drive: Drive, picture: FilePath | None) -> None:
    """Print how a drive went, as a table."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    summary = drive.summary
    title = Text(f"{summary['title']} (seed {summary['seed']})")
    table = Table(title=title, title_justify="left", show_header=False)
    rows = {
        "outcome": summary["outcome"],
        "collision": f"yes, at {_say(summary['impact_speed_mps'], 'm/s')}" if summary["collision"] else "no",
        "gap at rest": _say(summary["stop_gap_m"], "m"),
        "least gap": _say(summary["min_gap_m"], "m"),
        "least time to collision": _say(summary["min_ttc_s"], "s"),
        "greatest deceleration needed": _say(summary["max_drac_mps2"], "m/s²"),
        "greatest lateral deviation": _say(summary["max_lateral_deviation_m"], "m"),
        "greatest deceleration": _say(summary["max_deceleration_mps2"], "m/s²"),
        "emergency layer": "braked" if summary["emergency_used"] else "not needed",
        "drive time": f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks of {PERIOD * 1000:.0f} ms",
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
    for line in drive.summary["failed"]:
        console.print(f"failed: {line}", highlight=False, markup=False)
    if summary["text"]:
        console.print(f"what went wrong, in its own words: {summary['text']}", highlight=False, markup=False)


def _playback_rows(summary: dict[str, Any]) -> dict[str, str]:
    if summary["outcome"] != Outcome.PLAYED:
        return {}
    mean, greatest = (summary[f"prediction_error_100ms_{which}_m"] for which in ("mean", "max"))
    return {"prediction over 100 ms": f"{_say(mean, 'm')} off on average, {_say(greatest, 'm')} at most"}


def _say(value: float, unit: str) -> str:
    return "none" if value != value else f"{value:.3f} {unit}"


def drive(
    name: str,
    *,
    out: FilePath | None,
    seed: int | None,
    controller: str | None,
    pose: FilePath | None,
    quiet: bool,
    vehicle: str | None = None,
    rig: str | None = None,
) -> int:
    """Run the command: drive, draw, show; return the exit code."""
    working = FilePath.cwd()
    setting = choose(name, working, seed=seed, controller=controller, vehicle=vehicle)
    if rig is not None:
        from vve_sumo.rig.load import load as load_rig

        setting = setting.with_rig(load_rig(workspace.find("rig", rig, working), working), working)
    folder = out if out is not None else folder_for(setting, working)
    with _progress(setting, quiet) as watch:
        done = run(setting, folder, working, pose=pose, watch=watch)
    picture = None
    with contextlib.suppress(VveError):
        picture = draw(setting, done) if done.summary["ticks"] else None
    show(done, picture)
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
    setting.controller(working)  # refuses tuning that nobody could drive with
    gains, preview = _designed(setting, working)
    rows = gains.margins(setting.vehicle, preview)
    print(gains.table(rows))
    gains.check(rows, latency)
    worst = min(row.delay_margin for row in rows)
    print(f"bears the stated {1000.0 * latency:.0f} ms at every speed; the least margin is {1000.0 * worst:.0f} ms")
    return 0


def design_at(setting: ResolvedScenario, working: FilePath) -> Any:
    """Return the row of the design's table at the scenario's speed: its `delay_margin` [s] and the rest.

    Raises ConfigError where the scenario's controller does not steer by the preview law, which alone the design knows.
    """
    named = setting.scenario.controller.name
    setting.controller(working)
    if "preview" not in sources(setting.scenario.controller.name, workspace.controller_folders(working)):
        raise ConfigError(f"the design knows the preview steering, which {named} does not use")
    gains, preview = _designed(setting, working)
    return gains.margins(setting.vehicle, preview, [setting.scenario.ego.speed_mps])[0]


def _designed(setting: ResolvedScenario, working: FilePath) -> tuple[Any, Any]:
    """Return the module of the gain design and the scenario's tuning of the preview steering."""
    tuning = setting.scenario.controller.tuning
    if tuning.get("steering", "preview") != "preview":
        raise ConfigError(f"{setting.name}: the design knows the preview steering, got {tuning['steering']!r}")
    gains: Any = module("design", workspace.controller_folders(working))
    named = {"look_ahead_time": "look_ahead_time_s", "look_ahead_least": "look_ahead_least_m"}
    stated = {ours: float(tuning[key]) for ours, key in named.items() if key in tuning}
    return gains, replace(gains.DEFAULT, **stated)
