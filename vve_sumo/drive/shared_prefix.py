"""Drives several scenarios as one until they differ: those whose controllers, actors and criteria alone may differ.

One car drives on one road. At each tick the controller and the actors of every scenario answer what they are asked;
while all answers are the same to the bit, so are the drives. Where answers differ, the process is forked, and each
process goes on with the scenarios of one answer. Knows neither SUMO nor how a process is forked, which is passed in.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Generic, Protocol, TypeVar

from vve_sumo.controller import Guarded, GuardedController
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.values import ActorState, ControlCommand, Observation, Pose

Part = TypeVar("Part")
Answer = TypeVar("Answer")

#: called with the numbers of the scenarios that go another way; returns true in the process that goes on with them,
#: and false in the one that goes on with the others
Fork = Callable[[tuple[int, ...]], bool]


class ActorEngine(Protocol):
    """The actors of a scenario, as `vve_sumo.scenario.engine.ScenarioEngine` is."""

    @property
    def ended(self) -> bool:
        """Whether the trigger that ends the drive has fired."""
        ...

    def step(self, now: float, pose: Pose | None) -> tuple[ActorState, ...]:
        """Advance to a time [s] since the drive began; `pose` is that of the ego's front bumper."""
        ...


class Variants:
    """Scenarios that this process drives as one."""

    def __init__(self, scenarios: Sequence[ResolvedScenario], fork: Fork) -> None:
        """`scenarios` differ in their controllers, their criteria and their actors alone, not in the actors' ids."""
        self.scenarios = tuple(scenarios)
        self.together = tuple(range(len(self.scenarios)))  #: numbers of those that this process still drives
        self.forked: Callable[[], None] = lambda: None  #: called in each new process, before anything else
        self._fork = fork

    def controller(self, make: Callable[[ResolvedScenario], Guarded]) -> GuardedController:
        """Return what answers for the controllers of all scenarios; `make` makes a scenario's."""
        return _Controllers(_Asked(self, (repr(one.scenario.controller) for one in self.scenarios), make))

    def engine(self, make: Callable[[ResolvedScenario], ScenarioEngine]) -> ActorEngine:
        """Return what answers for the actors of all scenarios; `make` makes a scenario's."""
        return _Engines(_Asked(self, (repr(one.scenario.actors) for one in self.scenarios), make))

    def settle(self, ways: Sequence[tuple[int, ...]]) -> int:
        """Go on with the scenarios of one of several ways, each in a process; return the number of the way taken here.

        Every scenario that this process drives is in one of the `ways`.
        """
        for number, way in enumerate(ways[1:], 1):
            if self._fork(way):
                self.together = way
                self.forked()
                return number
        self.together = ways[0]
        return 0


class _Asked(Generic[Part]):
    """One part of every scenario: the same object for scenarios whose parts are made from the same."""

    def __init__(
        self, variants: Variants, made_from: Iterable[Hashable], make: Callable[[ResolvedScenario], Part]
    ) -> None:
        """`made_from`: for each scenario, what its part is made from."""
        self._variants = variants
        made: dict[Hashable, Part] = {}
        self._parts: list[Part] = []
        for scenario, source in zip(variants.scenarios, made_from, strict=True):
            if source not in made:
                made[source] = make(scenario)
            self._parts.append(made[source])

    @property
    def first(self) -> Part:
        """The part of the first scenario that this process drives."""
        return self._parts[self._variants.together[0]]

    def answer(self, ask: Callable[[Part], Answer]) -> Answer:
        """Ask every part once; where answers differ in any bit, go on with the scenarios of one of them."""
        by_part: dict[int, tuple[Answer, list[int]]] = {}
        for number in self._variants.together:
            part = self._parts[number]
            if id(part) not in by_part:
                by_part[id(part)] = ask(part), []
            by_part[id(part)][1].append(number)
        if len(by_part) == 1:
            return next(iter(by_part.values()))[0]
        # `repr` tells -0.0 from 0.0, and NaN is the same as NaN.
        ways: dict[str, tuple[Answer, list[int]]] = {}
        for answer, numbers in by_part.values():
            ways.setdefault(repr(answer), (answer, []))[1].extend(numbers)
        if len(ways) == 1:
            return next(iter(ways.values()))[0]
        taken = self._variants.settle([tuple(sorted(numbers)) for _answer, numbers in ways.values()])
        return list(ways.values())[taken][0]


class _Controllers:
    """The controllers of all scenarios, as one."""

    def __init__(self, asked: _Asked[Guarded]) -> None:
        self._asked = asked

    @property
    def text(self) -> str:
        return self._asked.first.text

    def step(self, observation: Observation) -> tuple[ControlCommand | None, tuple[str, ...]]:
        command, failures, _text = self._asked.answer(lambda one: (*one.step(observation), one.text))
        return command, failures


class _Engines:
    """The actors of all scenarios, as one."""

    def __init__(self, asked: _Asked[ScenarioEngine]) -> None:
        self._asked = asked

    @property
    def ended(self) -> bool:
        return self._asked.answer(lambda one: one.ended)

    def step(self, now: float, pose: Pose | None) -> tuple[ActorState, ...]:
        return self._asked.answer(lambda one: one.step(now, pose))
