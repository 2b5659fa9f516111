"""The certificate's own safety limits for a brain; they are not those of a scenario or controller.

Values only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from vve_sumo.errors import ConfigError, did_you_mean


@dataclass(frozen=True, slots=True)
class CertificateLimits:
    """The limits of every drive of a certificate, in addition to the reaction that its case requires."""

    #: least gap at rest to the obstacle [m]: half a metre for errors of pose and radar, and as much in reserve
    min_left_m: float = 1.0
    #: largest gap at rest [m], without a fault and where the brain must carry on: a brain that stops farther away has
    #: stopped for something else
    max_left_m: float = 30.0
    #: of the rear axle from the path [m], at any time: a car of 1.9 m in a lane of 3.2 m has 0.65 m on either side
    max_deviation_m: float = 0.5
    #: faster than the scenario's `ego.speed_mps` by [m/s], at most
    max_overspeed_mps: float = 1.0

    def __post_init__(self) -> None:
        """Raise ConfigError for limits that are not above 0 or contradict each other."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0.0):
                raise ConfigError(f"--limit {field.name}: expected a number above 0, got {value!r}")
        if self.max_left_m <= self.min_left_m:
            raise ConfigError(
                f"--limit max_left_m: expected more than min_left_m ({self.min_left_m:g}), got {self.max_left_m:g}"
            )

    def to_dict(self) -> dict[str, float]:
        """Return the limits by name."""
        return {field.name: float(getattr(self, field.name)) for field in fields(self)}


def limits_of(values: Mapping[str, Any]) -> CertificateLimits:
    """Return the limits with some overridden; raises ConfigError for an unknown name."""
    known = tuple(field.name for field in fields(CertificateLimits))
    for name in values:
        if name not in known:
            near = did_you_mean(name, known)
            raise ConfigError(
                f"--limit: {name!r} is no limit, expected one of {', '.join(known)}{f'; {near}' if near else ''}"
            )
    return replace(CertificateLimits(), **values)
