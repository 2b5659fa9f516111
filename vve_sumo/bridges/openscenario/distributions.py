"""Files of OpenSCENARIO that vary a scenario's parameters: every set of values that they name.

Knows no scenario's content.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.bridges.openscenario.document import read_openscenario
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.errors import ConfigError

#: sets of values of one file at most
MAX_SETS: Final = 1000
Values = dict[str, str]


class Variation(NamedTuple):
    """A scenario file, and the values with which it is driven one after the other."""

    file: Path
    sets: list[Values]


def read_variation(file: Path) -> Variation:
    """Return the scenario that a file varies, with every set of values; a scenario file is varied by nothing.

    Raises ConfigError naming the element for a distribution that is not taken, such as a stochastic one.
    """
    root = read_openscenario(file)
    varied = root.child("ParameterValueDistribution")
    if varied is None:
        return Variation(file, [{}])
    scope = Scope()
    try:
        reference = varied.child("ScenarioFile")
        if reference is None:
            raise NotTakenError(varied, "expected a <ScenarioFile>")
        scenario = file.parent / scope.text(reference, "filepath")
        if not scenario.is_file():
            raise NotTakenError(reference, f"{scenario} does not exist")
        stochastic = varied.child("Stochastic")
        if stochastic is not None:
            raise NotTakenError(stochastic, "stochastic distributions are not taken")
        choices = [list(_choices(one, scope)) for one in (varied.child("Deterministic") or varied).children]
        count = math.prod(map(len, choices))
        if not 1 <= count <= MAX_SETS:
            raise NotTakenError(varied, f"expected 1 to {MAX_SETS} sets of values, got {count}")
    except NotTakenError as error:
        raise ConfigError(str(error)) from None
    sets = [{name: value for one in chosen for name, value in one.items()} for chosen in itertools.product(*choices)]
    return Variation(scenario, sets)


def _choices(of: Element, scope: Scope) -> Iterator[Values]:
    if of.tag == "ScenarioFile":
        yield {}
        return
    if of.tag == "DeterministicMultiParameterDistribution":
        holder = of.child("ValueSetDistribution")
        for one in [] if holder is None else holder.all("ParameterValueSet"):
            yield {
                scope.text(pair, "parameterRef").removeprefix("$"): scope.text(pair, "value") for pair in one.children
            }
        return
    if of.tag != "DeterministicSingleParameterDistribution" or not of.children:
        raise NotTakenError(of, "this distribution is not taken")
    name, inner = scope.text(of, "parameterName").removeprefix("$"), of.children[0]
    if inner.tag == "DistributionSet":
        for one in inner.all("Element"):
            yield {name: scope.text(one, "value")}
    elif inner.tag == "DistributionRange":
        limits, step = inner.child("Range"), scope.number(inner, "stepWidth")
        if limits is None or step <= 0.0:
            raise NotTakenError(inner, "expected a <Range> and a stepWidth above 0")
        low, high = scope.number(limits, "lowerLimit"), scope.number(limits, "upperLimit")
        count = math.floor((high - low) / step + 1e-9) + 1
        if not 1 <= count <= MAX_SETS:
            raise NotTakenError(inner, f"expected 1 to {MAX_SETS} values, got {count}")
        for n in range(count):
            yield {name: f"{round(low + n * step, 9):g}"}
    else:
        raise NotTakenError(inner, "this distribution is not taken")
