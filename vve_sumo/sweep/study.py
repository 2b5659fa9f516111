"""The standard study of delay and noise as a sweep, for any scenario.

It sets the axes and checks the options; the sweep drives. It must not know how the rows are evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sweep.plan import SweepQuery, planned

#: varied keys: a delay that is hidden from the pipeline, and a factor on the receiver's noise
DELAY, NOISE = "ego.car.gnss_hidden_delay_s", "ego.car.noise_factor"
#: default steps [ms]: up to half a second, beyond what the shipped steering tolerates
DELAYS_MS: Final = tuple(float(delay) for delay in range(0, 501, 50))
#: default factors: without noise, the receiver's stated noise, and far more
FACTORS: Final = (0.0, 1.0, 4.0)
SEEDS: Final = 3
MAX_DELAY_MS, MAX_FACTOR = 1000.0, 100.0  #: largest values of a scenario

#: in place of the sweep's file in messages
PLACEHOLDER_FILE: Final = Path("study latency")


def latency_study(
    name: str,
    working: Path,
    *,
    delays_ms: Sequence[float] | None = None,
    factors: Sequence[float] | None = None,
    seeds: int | None = None,
    rig: str | None = None,
) -> SweepQuery:
    """Return the sweep over hidden delays [ms] and factors on the receiver's noise; None takes the default.

    With a `rig`, the rig's car is simulated. Where the scenario turns the noise off, there is one factor, 0; without
    any random input, one seed. Raises ConfigError, naming the option or the scenario's key, for a wrong value.
    """
    scenario = load(workspace.find("scenario", name, working))
    delays = _ascending("--delays-ms", DELAYS_MS if delays_ms is None else delays_ms, MAX_DELAY_MS)
    spec_table: dict[str, Any] = {
        "title": f"Latency margin of {name}",
        "scenario": name,
        "seeds": _seeds(scenario) if seeds is None else _whole(seeds),
        "parameters": {DELAY: [delay / 1000.0 for delay in delays], NOISE: _factors(name, scenario, factors)},
    }
    return planned(spec_table, PLACEHOLDER_FILE, working, yes=False, rig=rig)


def _factors(name: str, scenario: Scenario, factors: Sequence[float] | None) -> list[float]:
    if scenario.ego.car.noise:
        return _ascending("--noise", FACTORS if factors is None else factors, MAX_FACTOR)
    if factors is not None and list(factors) != [0.0]:
        got = ",".join(f"{factor:g}" for factor in factors)
        raise ConfigError(f"--noise: {name} turns the noise off (ego.car.noise), expected 0, got {got}")
    return [0.0]


def _seeds(scenario: Scenario) -> int:
    steady = not scenario.ego.car.noise and scenario.radar.ideal and not scenario.road.demand
    certain = steady and not scenario.sensors  # whose noise is unknown here
    return 1 if certain else SEEDS


def _whole(seeds: int) -> int:
    if seeds < 1:
        raise ConfigError(f"--seeds: expected 1 or more, got {seeds}")
    return seeds


def _ascending(option: str, values: Sequence[float], greatest: float) -> list[float]:
    """Return numbers in order, each once; raises ConfigError where there is none, or one outside 0 to `greatest`."""
    wrong = next((value for value in values if not 0.0 <= value <= greatest), None)
    if wrong is not None or not values:
        got = "none" if wrong is None else f"{wrong:g}"
        raise ConfigError(f"{option}: expected numbers from 0 to {greatest:g}, got {got}")
    return sorted(set(values))
