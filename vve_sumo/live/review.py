"""`vve-sumo replay` and `vve-sumo redrive`: from a record's folder, of a lockstep or a live drive, to what is printed.

Finds out of which kind the record is and says what came of it; compares nothing itself.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from vve_sumo.drive import redrive
from vve_sumo.drive import replay as lockstep
from vve_sumo.drive.lockstep import assemble
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.redrive import BRAKES, Comparison
from vve_sumo.drive.replay import (
    Difference,
    PipelineInputs,
    answers,
    changed_controller,
    changed_since,
    read_pipeline_inputs,
)
from vve_sumo.drive.resolved_scenario import EPOCH, ResolvedScenario
from vve_sumo.drive.verify import alterations
from vve_sumo.live import replay as live
from vve_sumo.live.assembly import from_dict
from vve_sumo.plotting.redrive import draw


@dataclass(frozen=True, slots=True)
class Found:
    """What came of a replay."""

    what: str  #: was replayed
    notes: list[str]  #: what could not be replayed
    differences: list[str]  #: the first one of each part


def replayed(folder: FilePath) -> int:
    """Run the command: verify a record, then replay it and say where it first differs; return the exit code.

    Nothing of the recorded controller is run before every hash of the record and of the controller's files was found
    in order.
    """
    working, is_live = FilePath.cwd(), live.is_live(folder)
    altered = alterations(folder)
    for each in altered or ():
        print(each)
    if altered:
        print("not replayed: only a record that is as the drive left it is fed to the controller that it names")
        return 1
    setting = from_dict(live.resolved_of(folder), working)[0] if is_live else lockstep.setting_of(folder, working)
    notes = ["no hashes: the drive was never finished, so the replay alone can tell"] if altered is None else []
    for line in notes + changed_since(folder, setting):
        print(f"note: {line}", file=sys.stderr)
    if changed := changed_controller(folder, setting, working):
        print(*changed, sep="\n")
        print(f"not replayed: vve-sumo redrive {folder} --controller NAME asks a controller as it is now")
        return 1
    found = _live(folder) if is_live else _lockstep(folder, setting)
    for line in found.notes:
        print(f"note: {line}", file=sys.stderr)
    for line in found.differences:
        print(line)
    if not found.differences:
        print(f"{found.what} of {folder} replayed: every setpoint and every frame is the same")
    return 1 if found.differences else 0


def _lockstep(folder: FilePath, setting: ResolvedScenario) -> Found:
    inputs = read_pipeline_inputs(folder)
    difference = lockstep.replay(setting, inputs, lockstep.read_car_frames(folder, EPOCH), FilePath.cwd())
    return Found(f"{len(inputs.ticks)} ticks", _torn(inputs), _told("tick", inputs.ticks, difference))


def _live(folder: FilePath) -> Found:
    inputs = live.read_live_inputs(folder)
    ticks, steps = inputs.pipeline.ticks, inputs.steps
    notes = _torn(inputs.pipeline)
    if inputs.torn:
        notes.append(f"the last {inputs.torn} steps of the gateway come after a gap in gateway or can.log")
    differences = _told("tick", ticks, live.replay_drive(inputs, FilePath.cwd()))
    differences += _told("step", steps, live.replay_gateway(inputs))
    return Found(f"{len(ticks)} ticks and {len(steps)} steps of the gateway", notes, differences)


def _torn(inputs: PipelineInputs) -> list[str]:
    if not inputs.torn:
        return []
    return [f"the last {inputs.torn} ticks come after a gap in pose.bin, actors or detections"]


def _told(kind: str, rows: list[dict[str, Any]], difference: Difference | None) -> list[str]:
    """Say where something differs, and how."""
    if difference is None:
        return []
    when = next((f" ({row['time_s']:.2f} s)" for row in rows if row[kind] == difference.number), "")
    whose = "of the gateway " if kind == "step" else ""
    return [
        f"{kind} {difference.number}{when} {whose}differs in {difference.what}:",
        f"  recorded {difference.recorded}",
        f"  replayed {difference.replayed}",
    ]


def redriven(folder: FilePath, controller: str, out: FilePath | None) -> int:
    """Run the command: ask another controller on a record's inputs, say and draw how it answers; the exit code."""
    if out is not None:
        redrive.writable(out)
    is_live = live.is_live(folder)
    for each in alterations(folder) or ():
        print(f"note: {each}", file=sys.stderr)
    setting, inputs, pipeline = _with(folder, is_live, controller)
    table = redrive.side_by_side(answers(pipeline, inputs))
    comparison = redrive.compared(table)
    # Of a file.py:make the file's place would fill the screen.
    names = (setting.scenario.controller.name.rpartition("/")[2], controller.rpartition("/")[2])
    _show(comparison, names, pipeline.failure)
    picture = folder / "redrive.png"
    draw(table, comparison, f"{setting.scenario.title} (seed {setting.scenario.seed})", names, picture)
    print(f"picture: {picture}")
    if out is not None:
        redrive.write(table, out)
        print(f"table:   {out}")
    return 0


def _with(folder: FilePath, is_live: bool, controller: str) -> tuple[ResolvedScenario, PipelineInputs, Pipeline]:
    """Return a record's setting and inputs, and its pipeline with another controller in it."""
    working = FilePath.cwd()
    if is_live:
        inputs = live.read_live_inputs(folder)
        setting, _rig = from_dict(inputs.resolved, working)
        return setting, inputs.pipeline, live.rebuilt_pipeline(inputs.resolved, working, controller)
    setting = lockstep.setting_of(folder, working)
    other = setting.driven_by(controller)
    return setting, read_pipeline_inputs(folder), assemble(other, working).pipeline


def _show(comparison: Comparison, names: tuple[str, str], failure: str) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    title = Text(f"open loop: the car did what {names[0]} said, whatever {names[1]} would have said")
    table = Table(title=title, title_justify="left")
    for head in ("", *names):
        table.add_column(Text(head))
    pair = (comparison.recorded, comparison.other)
    table.add_row(f"first brakes (> {BRAKES:g} m/s²)", *(_at(one.brakes_at) for one in pair))
    table.add_row("first asks for emergency", *(_at(one.emergency_at) for one in pair))
    table.add_row("its words", *(Text(", ".join(one.notes)) for one in pair))
    if any(one.failed_at is not None for one in pair):
        table.add_row("first fails to answer", *(_tick(one.failed_at) for one in pair))
    console = Console(soft_wrap=True)
    console.print(table)
    say: dict[str, Any] = {"highlight": False, "markup": False}
    console.print(f"{comparison.ticks} ticks compared; first tick that differs: {_tick(comparison.differs_at)}", **say)
    for what, of in (("greatest", comparison.greatest), ("rms", comparison.rms)):
        steering, acceleration = math.degrees(of["steering_rad"]), of["acceleration_mps2"]
        console.print(f"{what} difference: steering {steering:.3f}°, acceleration {acceleration:.3f} m/s²", **say)
    if failure:
        console.print(f"the last failure of {names[1]}, in its own words: {failure}", **say)


def _at(time: float) -> str:
    return "never" if math.isnan(time) else f"{time:.2f} s"


def _tick(tick: int | None) -> str:
    return "none" if tick is None else f"tick {tick}"
