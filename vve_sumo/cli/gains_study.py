"""`vve-sumo study gains`: for which gains a scenario's steering is D-stable, and a gain schedule from that."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.cli.console import plain_console
from vve_sumo.cli.parser import OF_FILES, Commands, add_command, numbers
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from rich.table import Table

    from vve_sumo.plotting.parameter_spaces import GainsPlane

SUMMARY = "gains for which the steering is D-stable over speed, mass and delay"
TEXT = """\
Compute for which gains of a scenario's preview steering all poles of the closed loop lie in the region D (decay at
least 0.15 1/s, damping at least 0.3), at each speed, for a light and a laden car, without and with the delay of the
pipeline. The boundaries are closed forms, with exact dead time. DIR receives the picture gains.png, the table gains.csv
and scheduled.py: a controller with the central gains over speed, to be driven by --controller DIR/scheduled.py:make.

A live drive whose gains lie outside is refused.

examples:
  vve-sumo study gains parked_car --out gains
  vve-sumo study gains parked_car --out gains --rig ours     the rig's car, the delay that its latency budget allows
  vve-sumo study gains parked_car --out late --delay-ms 120   a delay that was measured
"""
PICTURE, TABLE, SCHEDULE = "gains.png", "gains.csv", "scheduled.py"
#: of the table; the gains of the law, whether they are good, and the central ones
COLUMNS = (
    *("speed_mps", "look_ahead_m", "kp_rad_per_m", "kd_rad_s_per_m", "inside"),
    *("central_kp_rad_per_m", "central_kd_rad_s_per_m"),
)
MAX_DELAY_MS, SPEED_RANGE, MASS_RANGE = 1000.0, (1.0, 40.0), (0.5, 2.0)
#: line width where there is no terminal [characters]
WIDTH = 120

CONTROLLER = '''"""Steers by scheduled gains, the central ones of a parameter space; all else is follow_and_stop's.

Made by `vve-sumo study gains` for {vehicle}, delays up to {delay:.0f} ms.
"""

from vve_sumo.controller import settle
from vve_sumo.controllers import DelayTolerant, GainSchedule, PreviewSteering, delay_observers, follow_and_stop

#: speed [m/s], look-ahead [m], proportional [rad/m] and derivative gain [rad s/m]
SCHEDULE = [
{rows}
]
TUNING = {{**follow_and_stop.TUNING, **delay_observers.TUNING}}
RANGES = {{**follow_and_stop.RANGES, **delay_observers.RANGES}}
del TUNING["steering"]


def make(vehicle, tuning):
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    numbers = {{key: float(value) for key, value in settle(tuning, TUNING, RANGES).items()}}
    return DelayTolerant(vehicle, PreviewSteering(vehicle, GainSchedule(SCHEDULE)), numbers)
'''


def add(commands: Commands) -> None:
    """Add the command and its arguments."""
    gains = add_command(commands, "gains", SUMMARY, TEXT, OF_FILES)
    gains.add_argument("scenario", help="name or .toml file: whose steering, and whose car without a rig")
    gains.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder, absent or empty")
    gains.add_argument("--rig", metavar="NAME", help="the car as this rig declares and calibrates it, and its delay")
    gains.add_argument(
        "--delay-ms", type=float, metavar="MS", help="delay beyond the steering's own (default: the rig's, or 50)"
    )
    gains.add_argument("--speeds-mps", type=numbers, metavar="X,X", help="speeds (default: 2.2 to 20.1 in nine steps)")
    gains.add_argument(
        "--mass-factors", type=numbers, metavar="X,X", help="true over declared mass (default: 0.9,1.25)"
    )
    gains.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compute the planes of gains, write picture, table and schedule; return the exit code."""
    from vve_sumo import workspace
    from vve_sumo.drive import gain_region
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.plotting import parameter_space, save
    from vve_sumo.rig.load import load

    working, out, rig = Path.cwd(), arguments.out, arguments.rig
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out}: holds something else, expected an empty or absent folder")
    speeds = _within("--speeds-mps", arguments.speeds_mps, SPEED_RANGE)
    masses = _within("--mass-factors", arguments.mass_factors, MASS_RANGE)
    delay = gain_region.DEFAULT_DELAY
    if rig is not None:
        delay = gain_region.delay_of(load(workspace.find("rig", rig, working), working))
    if arguments.delay_ms is not None:
        if not 0.0 <= arguments.delay_ms <= MAX_DELAY_MS:
            raise ConfigError(f"--delay-ms: expected 0 to {MAX_DELAY_MS:g}, got {arguments.delay_ms:g}")
        delay = arguments.delay_ms / 1000.0
    resolved = resolve_by_name(arguments.scenario, working, rig=rig)
    found = gain_region.planes(resolved, working, delay=delay, speeds=speeds, mass_factors=masses)
    out.mkdir(parents=True, exist_ok=True)
    car = resolved.model.rig or resolved.model.name
    title = f"Gains of the steering of {resolved.name}: {car}, up to {1000.0 * delay:.0f} ms"
    save(parameter_space(title, [_drawn(one) for one in found]), out / PICTURE)
    _write_table(out / TABLE, found)
    plain_console(WIDTH).print(_table(title, found))
    lines = [f"picture: {out / PICTURE}", f"table: {out / TABLE}"]
    if all(one.central is not None for one in found):
        rows = "\n".join(f"    ({one.plane.speed:g}, {_three(one.central)})," for one in found)
        text = CONTROLLER.format(vehicle=car, delay=1000.0 * delay, rows=rows)
        (out / SCHEDULE).write_text(text, encoding="utf-8")
        lines.append(f"controller: {out / SCHEDULE}:make")
    else:
        lines.append("no schedule: at some speed no gains are good")
    print("\n".join(lines))
    return 0


def _within(option: str, values: Sequence[float] | None, bounds: tuple[float, float]) -> list[float] | None:
    """Return numbers in order, each once; raises ConfigError for one outside the bounds."""
    if values is None:
        return None
    wrong = next((value for value in values if not bounds[0] <= value <= bounds[1]), None)
    if wrong is not None:
        raise ConfigError(f"{option}: expected numbers from {bounds[0]:g} to {bounds[1]:g}, got {wrong:g}")
    return sorted(set(values))


def _drawn(one: Any) -> GainsPlane:
    """Return what is drawn of a plane of gains of the parameter space."""
    from vve_sumo.plotting.parameter_spaces import GainsPlane

    central = None if one.central is None else one.central[1:]
    grid = one.proportional, one.derivative, one.good
    return GainsPlane(one.plane.speed, *grid, one.boundaries, one.driven[1:], one.driven_is_good, central)


def _three(gains: Any) -> str:
    return ", ".join(f"{gain:.6g}" for gain in gains)


def _write_table(file: Path, planes: Sequence[Any]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for one in planes:
            central = ("", "") if one.central is None else (f"{one.central[1]:.6g}", f"{one.central[2]:.6g}")
            driven = [f"{gain:.6g}" for gain in one.driven]
            writer.writerow([f"{one.plane.speed:g}", *driven, str(one.driven_is_good).lower(), *central])


def _table(title: str, planes: Sequence[Any]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for head in ("speed [m/s]", "look-ahead [m]", "kp [rad/m]", "kd [rad s/m]", "D-stable", "central kp", "central kd"):
        table.add_column(head, justify="right", overflow="fold")
    for one in planes:
        central = ("none", "") if one.central is None else (f"{one.central[1]:.4f}", f"{one.central[2]:.4f}")
        driven = (f"{one.driven[0]:.2f}", f"{one.driven[1]:.4f}", f"{one.driven[2]:.4f}")
        table.add_row(f"{one.plane.speed:.1f}", *driven, "yes" if one.driven_is_good else "no", *central)
    return table
