"""The D-stable region of a scenario's preview steering over speed, mass and delay; refuses gains outside of it.

The parameter space is a file among the controllers, found by the workspace. A controller says itself that it steers by
the preview law; of any other steering nothing is known, and nothing is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.controller import module
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.steering_margins import DeclaredSteering, declared_steering
from vve_sumo.errors import ConfigError
from vve_sumo.pose.predict import Tuning as PredictorTuning
from vve_sumo.rig.schema import Rig
from vve_sumo.timing import PERIOD

#: delay beyond the steering's own where nobody measured one [s]: the budget that a rig has by default
DEFAULT_DELAY: Final = 0.04 + 0.5 * PERIOD


def delay_of(rig: Rig) -> float:
    """Return the delay from a pose to the wheels' command that a rig's drives may have [s].

    The latency monitor stops a drive whose ticks take longer than the rig's budget; a command is held for a tick, half
    of it on average. The steering's own dead time is the calibrated car's.
    """
    return rig.latency.budget_ms / 1000.0 + 0.5 * PERIOD


def speeds_up_to(design: Any, speed: float) -> list[float]:
    """Return the speeds of the parameter space below a drive's [m/s], and the drive's own.

    A drive slower than all of them is judged at the least one. Every drive passes through lower speeds on its way to
    rest; there an error decays with the distance travelled, so a decay in time asks what no gain can give.
    """
    return [*(below for below in design.SPEEDS if below < speed), max(speed, min(design.SPEEDS))]


def planes(
    resolved: ResolvedScenario,
    working: Path,
    *,
    delay: float,
    speeds: Sequence[float] | None = None,
    mass_factors: Sequence[float] | None = None,
) -> list[Any]:
    """Return the plane of gains of a scenario's steering at each speed [m/s], up to `delay` [s]; None: the defaults.

    Raises ConfigError where the controller does not declare that it steers by the preview law.
    """
    space, steering = _space(working), _steering(resolved, working)
    given = space.SPEEDS if speeds is None else speeds
    masses = space.MASS_FACTORS if mass_factors is None else mass_factors
    found: list[Any] = space.planes(
        resolved.vehicle, steering.gains, delay=delay, speeds=given, mass_factors=masses, **_loop(steering)
    )
    return found


def refuse_outside(resolved: ResolvedScenario, working: Path, delay: float) -> None:
    """Raise ConfigError where a drive's gains are not good at some of its speeds, with some mass, up to `delay` [s].

    Nothing is refused of a controller that does not steer by the preview law.
    """
    try:
        steering = _steering(resolved, working)
    except ConfigError:
        return
    space = _space(working)
    speeds = speeds_up_to(space, resolved.scenario.ego.speed_mps)
    space.refuse_outside(resolved.vehicle, steering.gains, delay=delay, speeds=speeds, **_loop(steering))


def _space(working: Path) -> Any:
    return module("parameter_space", workspace.controller_folders(working))


def _steering(resolved: ResolvedScenario, working: Path) -> DeclaredSteering:
    return declared_steering(resolved, working)


def _loop(steering: DeclaredSteering) -> dict[str, float]:
    known = {"yaw_rate_lag": PredictorTuning().rates}
    return known if steering.trim_share is None else known | {"trim_share": steering.trim_share}
