"""FMUs for tests: what pythonfmu and pythonfmu3 build of a brake that stops before the nearest detection."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

#: {base}: the class to derive from; {real}, {boolean}: types of variables; {causality}, {variability}: their enums
BRAKE = """
import math
from {module} import {base}, {causality}, {variability}, {real}, {boolean}

class Brake({base}):
    author = "test"

    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.speed = self.gap = self.desired = self.wanted = self.time = self.steps = 0.0
        self.rate, self.hard, self.latch = 2.0, False, True
        {time}
        for name in ("speed", "gap", "desired"):
            self.register_variable({real}(name, causality={causality}.input))
        self.register_variable({real}("rate", causality={causality}.parameter, variability={variability}.tunable))
        self.register_variable({boolean}("latch", causality={causality}.parameter, variability={variability}.tunable))
        for name in ("wanted", "steps"):
            self.register_variable({real}(name, causality={causality}.output))
        self.register_variable({boolean}("hard", causality={causality}.output, variability={variability}.discrete))

    def do_step(self, time, period):
        if abs(time - 0.02 * self.steps) > 1e-9 or abs(period - 0.02) > 1e-12:
            return False
        self.steps += 1.0
        allowed = min(self.desired, math.sqrt(max(0.0, 2.0 * self.rate * (self.gap - 6.0))))
        self.wanted = -2.0 if allowed < 0.5 else min(max(1.5 * (allowed - self.speed), -3.4), 1.5)
        self.hard = self.latch and self.gap < 0.0
        return True
"""

KINDS = {
    "2.0": {
        "module": "pythonfmu", "base": "Fmi2Slave", "real": "Real", "boolean": "Boolean",
        "causality": "Fmi2Causality", "variability": "Fmi2Variability", "time": "",
    },
    "3.0": {
        "module": "pythonfmu3", "base": "Fmi3Slave", "real": "Float64", "boolean": "Boolean",
        "causality": "Fmi3Causality", "variability": "Fmi3Variability",
        "time": 'self.register_variable(Float64("time", causality=Fmi3Causality.independent))',
    },
}  # fmt: skip


def available(version: str) -> bool:
    """Return whether what builds FMUs of an FMI version is installed."""
    return importlib.util.find_spec(KINDS[version]["module"]) is not None


def build(version: str, folder: Path) -> Path:
    """Build the FMU of an FMI version in a folder, and return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    kind = KINDS[version]
    source = folder / f"brake_{version[0]}.py"  # modules of both stand in one interpreter
    source.write_text(BRAKE.format(**kind))
    command = [sys.executable, "-m", kind["module"], "build", "-f", str(source), "-d", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (folder / "Brake.fmu").is_file(), done.stderr
    return folder / "Brake.fmu"
