"""Vehicle in Virtual Environment testing on SUMO: a real drive-by-wire car, a virtual road.

    import vve_sumo as vve

    run = vve.drive("parked_car", speed=12, seed=3)
    run.plot()

What is here is for scripts and notebooks; docs/python.md is its page. Nothing is imported before it is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from vve_sumo.errors import ConfigError, RigError, SimulationError, VveError
from vve_sumo.version import __version__ as __version__

if TYPE_CHECKING:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.run import Run
    from vve_sumo.api.drive import drive
    from vve_sumo.api.scenario import Scenario, scenarios
    from vve_sumo.api.sweep import sweep

__all__ = [
    "ConfigError",
    "RigError",
    "Run",
    "Scenario",
    "SimulationError",
    "Sweep",
    "VveError",
    "drive",
    "load",
    "scenarios",
    "sweep",
]

#: modules of what is imported when it is first used
_MODULES = {
    "Run": "vve_sumo.analysis.run",
    "Scenario": "vve_sumo.api.scenario",
    "Sweep": "vve_sumo.analysis.dataset",
    "drive": "vve_sumo.api.drive",
    "load": "vve_sumo.analysis.load",
    "scenarios": "vve_sumo.api.scenario",
    "sweep": "vve_sumo.api.sweep",
}

# Two packages in here have the names of functions. Python sets a package's name here once, when it is first imported:
# that is now (they are empty), and the name is taken away again, for the function.
for _package in ("drive", "sweep"):
    importlib.import_module(f"vve_sumo.{_package}")
    del globals()[_package]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*(name for name in globals() if name.startswith("__")), *__all__])
