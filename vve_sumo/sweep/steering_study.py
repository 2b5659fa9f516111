"""The study of a steering loop's delay margin as a search: the delay at which a step's answer no longer dies out.

It sets the axes and checks the options; the sweep drives. It must not know how the margins are computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load
from vve_sumo.sweep.plan import SweepQuery, planned

SPEED, MASS = "ego.speed_mps", "ego.car.mass_factor"
#: time constant of the observer that bears delay [s], 0 for none
OBSERVER = "controller.tuning.cdob_time_constant_s"
DELAY = "ego.car.steering_delay_s"
#: the controller whose drives show whether a steering loop is stable
PROBE: Final = "steering_probe"
SPEEDS: Final = (4.0, 7.0, 10.0, 13.0, 16.0)
SPEED_RANGE: Final = (3.0, 16.0)  #: on a straight of 1.6 km [m/s]
MASS_RANGE: Final = (0.5, 2.0)
TIME_CONSTANT: Final = 0.1  #: of the observer where the scenario's tuning states none [s]
#: delays that are searched, and what is driven of them first [s]
MAX_DELAY, DELAY_STEP, SCAN = 3.0, 0.01, 7
#: in place of the sweep's file in messages
PLACEHOLDER_FILE: Final = Path("study latency")


def steering_study(
    name: str,
    working: Path,
    *,
    speeds: Sequence[float] | None = None,
    mass_factors: Sequence[float] | None = None,
    rig: str | None = None,
) -> SweepQuery:
    """Return the search over delays of the steering at speeds [m/s], without and with the observer that bears delay.

    `mass_factors` are true over declared mass. With a `rig`, the rig's car is simulated. Raises ConfigError, naming the
    option or the scenario's key, for a wrong value and for a scenario whose controller is another than the probe.
    """
    control = load(workspace.find("scenario", name, working)).controller
    if control.name != PROBE:
        raise ConfigError(
            f"--steering: {name}: controller.name: expected {PROBE!r}, whose drives show whether the steering is "
            f"stable, got {control.name!r}; take the scenario {PROBE}"
        )
    stated = control.tuning.get(OBSERVER.rpartition(".")[2], 0.0)
    observer = stated if isinstance(stated, float) and stated > 0.0 else TIME_CONSTANT
    spec_table: dict[str, Any] = {
        "title": f"Delay margin of the steering of {name}",
        "scenario": name,
        "parameters": {
            SPEED: _ascending("--speeds-mps", SPEEDS if speeds is None else speeds, SPEED_RANGE),
            MASS: _ascending("--mass-factors", (1.0,) if mass_factors is None else mass_factors, MASS_RANGE),
            OBSERVER: [0.0, observer],
            DELAY: {"from": 0.0, "to": MAX_DELAY, "step": DELAY_STEP},
        },
        "search": {"along": DELAY, "criterion": "passed", "scan": SCAN},
    }
    return planned(spec_table, PLACEHOLDER_FILE, working, yes=False, rig=rig)


def _ascending(option: str, values: Sequence[float], bounds: tuple[float, float]) -> list[float]:
    """Return numbers in order, each once; raises ConfigError where there is none, or one outside the bounds."""
    least, greatest = bounds
    wrong = next((value for value in values if not least <= value <= greatest), None)
    if wrong is not None or not values:
        got = "none" if wrong is None else f"{wrong:g}"
        raise ConfigError(f"{option}: expected numbers from {least:g} to {greatest:g}, got {got}")
    return sorted(set(values))
