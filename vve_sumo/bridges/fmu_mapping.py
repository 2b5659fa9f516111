"""The file that says which variables of an FMU are what a controller observes and commands.

Knows names; neither what an FMU holds nor how it is run.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from vve_sumo.bridges.observed_numbers import FEATURES
from vve_sumo.config_file import Finite, Table, complaint, read
from vve_sumo.errors import ConfigError, did_you_mean

Name = Annotated[str, Field(min_length=1)]


class Outputs(Table):
    """Which variables of the FMU are the command."""

    acceleration_mps2: Name  #: along the heading, braking negative
    steering_rad: Name | None = None  #: road-wheel angle, left positive; without it another controller steers
    emergency: Name | None = None  #: whether the emergency envelope is asked for


class FmuMapping(Table):
    """The variables of an FMU, by what they mean."""

    inputs: Mapping[Name, str]  #: from variables of the FMU to names of observed numbers
    outputs: Outputs
    parameters: Mapping[Name, Finite | bool] = Field(default_factory=dict)  #: set before the FMU begins
    steered_by: Name = "follow_and_stop"  #: the controller that steers where no variable does


def read_mapping(file: Path) -> FmuMapping:
    """Read a mapping file; raises ConfigError naming file and key for what is wrong."""
    try:
        mapping = FmuMapping.model_validate(read(file, "mapping"))
    except ValidationError as error:
        raise ConfigError(complaint(file, error, FmuMapping)) from None
    known = [feature.name for feature in FEATURES]
    for variable, observed in mapping.inputs.items():
        if observed not in known:
            near = did_you_mean(observed, known)
            unknown = f"{file}: inputs.{variable}: {observed!r} is not observed{f', {near}' if near else ''}"
            raise ConfigError(f"{unknown}; observed are {', '.join(known)}")
    return mapping
