"""`vve-sumo drive`: a scenario driven in lockstep, live on a rig, or with a recorded drive."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli import live_drive
from vve_sumo.cli.console import INTERRUPTED, complain, note, notify
from vve_sumo.cli.drive_result import draw_and_show
from vve_sumo.cli.parser import Parser, add_json, add_speed, setting, values_of
from vve_sumo.errors import ConfigError, SimulationError

if TYPE_CHECKING:
    from vve_sumo.drive.brain import ExternalController
    from vve_sumo.drive.resolved_scenario import ResolvedScenario
    from vve_sumo.drive.run import Drive


SUMMARY = "drive a scenario: in lockstep, live on a rig, or with a recorded drive"
TEXT = """\
Drive a scenario in lockstep with the simulated vehicle: NCOM bytes in, drive-by-wire CAN frames out,
traffic by SUMO. With --rig, drive it live: real time, real buses, a real car. Leaves a record folder with
summary.json and drive.png.

examples:
  vve-sumo drive                                the paper's drive: a car parked in the middle of the road
  vve-sumo drive parked_car --seed 7 --out a    another seed, record in folder a
  vve-sumo drive --set 'ego.speed=25 mph' --set controller.tuning.gap_m=8   other values of any key
  vve-sumo drive --speed '25 km/h'              another speed of the ego
  vve-sumo drive --controller mine.py:make      your own controller
  vve-sumo drive --vehicle lincoln_mkz          another car
  vve-sumo drive --rig rigs/ours.toml --lockstep   the simulated vehicle as the rig calibrates it
  vve-sumo drive --rig foreign --lockstep       an external controller over UDP, in lockstep (docs/brains.md)
  vve-sumo drive --pose drive.csv               a recorded drive through the same pipeline; no car is commanded
  vve-sumo drive --rig simulated                live, with the simulated vehicle as a process of its own
  vve-sumo drive --rig simulated --view         the same with a page in a browser, which has a stop button
  vve-sumo drive mine.toml --rig a --rig second=b   live, two real cars in two lots on one street (docs/live.md)
  vve-sumo drive parked_car --rig rigs/ours.toml --rehearse   live, the real car's rig on simulated wires
  vve-sumo drive parked_car --rig rigs/ours.toml --shadow   live, with every enable bit off

live keys: e engages, g starts, any other key stops; so do Ctrl-C and closing the terminal. The emergency stop is
the driver's brake pedal.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="record folder, absent or empty (default: under runs/)")
    parser.add_argument("--seed", type=int, metavar="N", help="override the scenario's seed")
    parser.add_argument(
        "--set",
        type=setting,
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="values",
        help="override a value of the scenario: a dotted key such as ego.speed_mps, or a parameter that it declares; "
        "a number may have a unit, such as 'ego.speed=25 mph'; may be given several times",
    )
    add_speed(parser)
    parser.add_argument("--controller", metavar="NAME", help="shipped name, file.py:make or entry point")
    parser.add_argument(
        "--vehicle", metavar="NAME", help="override the scenario's vehicle: a name under vehicles/ or a .toml file"
    )
    parser.add_argument(
        "--pose",
        type=Path,
        metavar="FILE",
        help="feed a recorded drive to the pipeline, its start aligned with the path's start: a receiver's log (NCOM, "
        "UBX, SBF, NovAtel, NMEA), or CSV with time_s,latitude_deg,longitude_deg,heading_deg,speed_mps; commands are "
        "computed and recorded, not sent",
    )
    parser.add_argument(
        "--rig",
        action="append",
        metavar="NAME",
        dest="rigs",
        help="drive live on this rig: a name under rigs/ or a .toml file. Given again as ID=NAME, the rig of a further "
        "real car, that of the scenario's ego with this id",
    )
    parser.add_argument(
        "--lockstep",
        action="store_true",
        help="with --rig: drive in lockstep, not live, with the simulated vehicle as the rig declares and calibrates "
        "it and with the rig's faults injected; an external controller of the rig is awaited at every tick",
    )
    parser.add_argument(
        "--shadow", action="store_true", help="live, with every enable bit off: the car is not commanded"
    )
    parser.add_argument(
        "--rehearse",
        action="store_true",
        help="live, with the rig of a real car on simulated wires: emulated bus, simulated receiver of the rig's kind, "
        "the rig's car, calibration, mounting, lot and alignment; no hardware can be opened",
    )
    parser.add_argument("--view", action="store_true", help="live, with a page in a browser; its address is printed")
    parser.add_argument(
        "--foxglove",
        action="store_true",
        help="live, with --view, and topics for Foxglove and Lichtblick; the address to connect to is printed",
    )
    parser.add_argument("--operator", metavar="NAME", help="live, for the record: name of the operator at the console")
    parser.add_argument("--driver", metavar="NAME", help="live, for the record: name of the safety driver")
    live_drive.override_argument(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    add_json(parser, "the drive's summary, with the folder of its record,")


def run(arguments: argparse.Namespace) -> int:
    """Drive, draw, show; return the exit code."""
    arguments.rig, arguments.further_rigs = _rigs_of(arguments.rigs or [])
    if arguments.rig is not None and arguments.vehicle is not None:
        raise ConfigError("--vehicle: a rig brings its own vehicle; leave out one of --vehicle and --rig")
    if arguments.rig is not None and not arguments.lockstep:
        return _live(arguments)
    if arguments.rig is None and arguments.lockstep:
        raise ConfigError(
            "--lockstep: expected --rig with the rig whose car is simulated; without a rig every drive is in lockstep"
        )
    if arguments.rehearse:
        raise ConfigError("--rehearse: only a live drive has wires; name the rig with --rig, without --lockstep")
    if arguments.shadow:
        raise ConfigError("--shadow: only a live drive sets enable bits; name the rig with --rig")
    if arguments.view:
        raise ConfigError("--view: only a live drive has a page while it runs; vve-sumo view shows a record")
    if arguments.foxglove:
        raise ConfigError("--foxglove: only a live drive has topics; vve-sumo export DIR mcap makes a file of a record")
    for role in ("operator", "driver"):
        if getattr(arguments, role) is not None:
            raise ConfigError(f"--{role}: only a live drive has an operator and a driver; name the rig with --rig")
    if arguments.override_doctor is not None:
        raise ConfigError("--override-doctor: only a live drive arms a car; name the rig with --rig")
    return _lockstep(arguments)


def _rigs_of(given: list[str]) -> tuple[str | None, dict[str, str]]:
    """Return the rig of [ego], and those of further egos by their ids."""
    further: dict[str, str] = {}
    for one in given[1:]:
        ego, equals, name = one.partition("=")
        if not (equals and ego and name) or ego in further:
            raise ConfigError(f"--rig {one}: expected ID=NAME with the id of another one of the scenario's [[egos]]")
        further[ego] = name
    return (given[0] if given else None), further


def _lockstep(arguments: argparse.Namespace) -> int:
    from vve_sumo.drive.progress import progress_callback
    from vve_sumo.drive.run import new_run_folder, resolve_by_name, run
    from vve_sumo.drive.termination import Outcome

    if arguments.further_rigs:
        raise ConfigError("--lockstep: takes one --rig, that of [ego]; further egos have the scenario's cars")
    working = Path.cwd()
    resolved = resolve_by_name(
        arguments.scenario,
        working,
        seed=arguments.seed,
        controller=arguments.controller,
        vehicle=arguments.vehicle,
        rig=arguments.rig,
        speed=arguments.speed,
        values=values_of(arguments.values),
    )
    for fault in resolved.faults if arguments.pose is None else ():
        notify(f"injected: {fault}")
    if resolved.note:
        note(resolved.note)
    folder = arguments.out if arguments.out is not None else new_run_folder(resolved.name, working)
    controller = nullcontext(None) if arguments.rig is None else _brain(arguments, resolved, working)
    with controller as brain, progress_bar.of_drive(resolved.name, quiet=arguments.quiet) as show:
        on_tick = progress_callback(resolved.path.length, show)
        done = run(resolved, folder, working, pose=arguments.pose, brain=brain, on_tick=on_tick)
    draw_and_show(resolved, done, as_json=arguments.json)
    if done.summary["outcome"] == Outcome.BROKEN:
        complain(f"the simulation broke: {done.summary['text']}")
        return SimulationError.exit_code
    return _exit_code(done)


def _brain(
    arguments: argparse.Namespace, resolved: ResolvedScenario, working: Path
) -> AbstractContextManager[ExternalController | None]:
    """Return the context that opens the wires to the rig's brain; a recorded drive is played without wires."""
    from vve_sumo import workspace
    from vve_sumo.live.brain_link import refuse_controller
    from vve_sumo.live.external_lockstep import open_external_controller
    from vve_sumo.rig.load import load

    loaded = load(workspace.find("rig", arguments.rig, working), working)
    refuse_controller(loaded, arguments.controller)
    if arguments.pose is None:
        return open_external_controller(loaded, resolved, working)
    if loaded.brain.kind != "own":
        raise ConfigError(
            f"--pose: a recorded drive has no external controller, and brain.kind of the rig is {loaded.brain.kind!r}; "
            "leave out one of --pose and --rig"
        )
    return nullcontext(None)


def _exit_code(done: Drive) -> int:
    """Return the exit code of a drive that did not break: passed, failed, or ended from the keyboard."""
    from vve_sumo.drive.termination import Outcome

    if done.summary["outcome"] == Outcome.INTERRUPTED:
        return INTERRUPTED
    return 0 if done.passed else 1


def _live(arguments: argparse.Namespace) -> int:
    if arguments.pose is not None:
        raise ConfigError("--pose: a live drive has its pose from the rig; leave out one of --pose and --rig")
    if not arguments.rehearse:
        return _driven(arguments, None)
    import tempfile

    from vve_sumo.live.simulated_wires import forbid_hardware

    forbid_hardware()
    with tempfile.TemporaryDirectory(prefix="vve_sumo_rehearsal_") as links:
        return _driven(arguments, Path(links))


def _driven(arguments: argparse.Namespace, rehearse: Path | None) -> int:
    """Drive live to the end; `rehearse` is the folder of a rehearsal's links."""
    from vve_sumo.drive.run import Drive
    from vve_sumo.drive.termination import Outcome
    from vve_sumo.live import session

    plan = session.plan(
        arguments.scenario,
        arguments.rig,
        Path.cwd(),
        out=arguments.out,
        seed=arguments.seed,
        controller=arguments.controller,
        shadow=arguments.shadow,
        speed=arguments.speed,
        values=values_of(arguments.values),
        view=arguments.view or arguments.foxglove,
        foxglove=arguments.foxglove,
        rehearse=rehearse,
        further=arguments.further_rigs,
    )
    for line in plan.rehearsal:
        notify(line)
    # Before names are asked for.
    doctors = {one.ego: live_drive.examined(one, arguments.override_doctor) for one in plan.cars}
    if plan.resolved.note:
        note(plan.resolved.note)
    plan = live_drive.named(plan, arguments.operator, arguments.driver)
    with session.removed_when_empty(plan.folder):
        done = Drive(plan.folder, live_drive.drive(plan, doctors))
    draw_and_show(plan.resolved, done, as_json=arguments.json)
    if done.summary["outcome"] == Outcome.BROKEN:
        return SimulationError.exit_code
    return _exit_code(done)
