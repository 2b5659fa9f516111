"""`vve-sumo hunt`: timelines of faults, driver, keys and brain under which the safety layer breaks an invariant."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli.parser import Parser, names
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.hunt.episode import EpisodePhase
    from vve_sumo.hunt.simulation import EpisodeDrive
    from vve_sumo.hunt.truth import TruthSample

EXIT_CODES = """exit codes:
  0  no invariant was broken
  1  an invariant was broken
  2  wrong use or configuration; nothing was written
  130  interrupted from the keyboard; finished episodes are kept, --resume continues
"""

SUMMARY = "search for faults and actions of driver, operator and brain that break a safety invariant"
TEXT = """\
Drive thousands of short episodes in lockstep, without SUMO: the real gateway, pipeline and tick, and the simulated
vehicle with faults injected into it. An episode is a timeline of up to three faults, driver's actions, operator's
keys and behaviours of the brain, which starts at a phase of the drive: arming, engaging, held, driving, bend,
braking, at_rest, stopped, released. Invariants are checked on the true state of the car, never on its reports: the
throttle closes when the driver brakes, the speed limit holds, the body stays in the lot, a stop ends within its bound
or raises the alarm, and more.

A search draws episodes at random, then near those that came closest to breaking an invariant. With --pairs, every
kind of fault is combined with every other, with every driver's action and with every behaviour of the brain. A
finding is shrunk to the shortest timeline that still breaks the invariant and written to DIR/found: a row that a test
replays, and a rig whose [[faults]] `vve-sumo drive --lockstep` injects.

examples:
  vve-sumo hunt --rig simulated --episodes 500           ten minutes: a first test
  vve-sumo hunt --rig rigs/ours.toml --hours 8 --out night    eight hours
  vve-sumo hunt --rig rigs/ours.toml --hours 8 --out night --resume    continue it
  vve-sumo hunt --rig simulated --pairs --phases driving,bend,braking,at_rest --out pairs
  vve-sumo hunt --rig simulated --show night/found/NAME.json   replay one, tick by tick where something changes
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument(
        "--rig", metavar="NAME", required=True, help="car, lot and limits: a name under rigs/ or a file"
    )
    parser.add_argument("--hours", type=float, metavar="H", help="end after so many hours")
    parser.add_argument(
        "--episodes", type=int, metavar="N", help="end after so many episodes, those of earlier runs included"
    )
    parser.add_argument("--pairs", action="store_true", help="try every pair instead of searching")
    parser.add_argument(
        "--phases", type=names, default=(), metavar="A,B", help="with --pairs: phases in which the pairs start"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="output folder, absent or empty (default: under runs/)")
    parser.add_argument("--resume", action="store_true", help="continue the hunt in --out")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the random draws (default: 1)")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="episodes driven in parallel (default: 2)")
    parser.add_argument("--show", type=Path, metavar="FILE", help="replay the episode of a file in DIR/found")
    parser.add_argument("--quiet", action="store_true", help="no progress, only the report at the end")


def run(arguments: argparse.Namespace) -> int:
    """Hunt, or show an episode; return the exit code."""
    if arguments.show is not None:
        return _show(arguments.scenario, arguments.rig, arguments.show)
    _check(arguments)
    from vve_sumo.drive.run import new_run_folder
    from vve_sumo.hunt.journal import REPORT
    from vve_sumo.hunt.report import text
    from vve_sumo.hunt.run import Hunt, HuntProgress, HuntQuery

    working = Path.cwd()
    query = HuntQuery(
        rig=arguments.rig,
        scenario=arguments.scenario,
        out=arguments.out if arguments.out is not None else new_run_folder("hunt", working),
        seed=arguments.seed,
        workers=arguments.workers,
        pairs=arguments.pairs,
        phases=_phases(arguments.phases),
        episodes=arguments.episodes,
        hours=arguments.hours,
        resume=arguments.resume,
    )
    with progress_bar.of_hunt(quiet=arguments.quiet) as shown:

        def watch(at: HuntProgress) -> None:
            shown(at.done, at.total, at.say())

        hunt = Hunt(query, working, watch)
        hunt.run()
    progress = hunt.progress
    report = text(
        hunt.journal.results,
        hunt.findings.all,
        total=progress.total if query.pairs else None,
        last_found=progress.last_found,
        rate=progress.rate,
        left_out=hunt.left_out,
    )
    (query.out / REPORT).write_text(report, encoding="utf-8")
    print(report, end="")
    print(f"written: {query.out}")
    return 1 if hunt.findings.all else 0


def _check(arguments: argparse.Namespace) -> None:
    if arguments.hours is None and arguments.episodes is None and not arguments.pairs:
        raise ConfigError("--hours or --episodes: expected one of them, or --pairs: a search does not end by itself")
    for key in ("hours", "episodes", "workers"):
        value = getattr(arguments, key)
        if value is not None and not value > 0:
            raise ConfigError(f"--{key}: expected more than 0, got {value:g}")
    if arguments.resume and arguments.out is None:
        raise ConfigError("--resume: expected --out, the folder of the hunt to continue")
    if arguments.phases and not arguments.pairs:
        raise ConfigError("--phases: expected --pairs too: a search draws its phases")


def _phases(requested: tuple[str, ...]) -> tuple[EpisodePhase, ...]:
    from vve_sumo.hunt.episode import EpisodePhase
    from vve_sumo.hunt.run import PAIR_PHASES

    every = [phase.value for phase in EpisodePhase]
    for name in requested:
        if name not in every:
            raise ConfigError(f"--phases: expected some of {', '.join(every)}, got {name!r}")
    return tuple(EpisodePhase(name) for name in requested) or PAIR_PHASES


def _show(scenario: str, rig: str, file: Path) -> int:
    """Replay the episode of a row, and print a line whenever something changes."""
    from vve_sumo.hunt.findings import read_row
    from vve_sumo.hunt.judging import Tolerances
    from vve_sumo.hunt.run import course_of
    from vve_sumo.hunt.runner import run_alone

    course, _ = course_of(scenario, rig, Path.cwd())
    invariant, episode = read_row(file)
    print(episode)
    last: list[object] = []

    def show(sample: TruthSample, _simulation: EpisodeDrive) -> None:
        driver, command = sample.driver, sample.command
        changed: list[object] = [sample.phase, tuple(sample.reasons), sorted(sample.due), driver, sample.enabled]
        if changed == last and round(sample.time / 0.02) % 25:
            return
        last[:] = changed
        enabled = "".join(letter if on else "-" for letter, on in zip("BTS", sample.enabled, strict=True))
        print(
            f"{sample.time:7.2f} s  {sample.pose.speed:5.2f} m/s  throttle {100.0 * command.throttle:3.0f} %  "
            f"brake {command.brake_torque:4.0f} Nm  {enabled} {sample.gear.name.lower():7}  {sample.phase}  "
            f"[{', '.join(sample.reasons)}]  {', '.join(sorted(sample.due))}"
        )

    result = run_alone(course, episode, Tolerances(), show)
    for violation in result.violations:
        print(f"{violation.invariant}, {violation.time:.2f} s after the onset: {violation.text}")
    print(f"{invariant}: {'broken' if invariant in result.broken else 'holds'}")
    return 1 if result.broken else 0
