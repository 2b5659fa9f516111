"""Stands in for the people of a scenario: simulated phones that report the walks that it names.

Each has a random number generator of its own, seeded by the scenario's seed and the person's id.
"""

from __future__ import annotations

from collections.abc import Iterable

from vve_sumo.drive.assembly import seed_of
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.people.reports import PositionReport
from vve_sumo.people.setup import PersonSetup
from vve_sumo.people.simulated_phone import PhoneErrors, SimulatedPhone
from vve_sumo.people.walk import Walk
from vve_sumo.scenario.road_users import Person


class SimulatedPeople:
    """All who stand in for somebody, on one clock."""

    def __init__(self, phones: Iterable[SimulatedPhone]) -> None:
        self._phones = tuple(phones)

    def until(self, now: float) -> list[tuple[float, PositionReport]]:
        """Return the reports that arrive up to drive time `now` [s], each with its time of arrival, in that order."""
        came = [one for phone in self._phones for one in phone.until(now)]
        return sorted(came, key=lambda one: (one[0], one[1].person))


def everybody_simulated(resolved: ResolvedScenario) -> SimulatedPeople:
    """Return who stands in for all people of a scenario; raises ConfigError for one for whom nobody does."""
    for person in resolved.scenario.people:
        if person.simulated is None:
            raise ConfigError(
                f"{resolved.file}: key 'people.{person.id}.simulated' is missing: without a live rig nobody else walks"
            )
    return simulated(resolved, {person.id for person in resolved.scenario.people})


def simulated(resolved: ResolvedScenario, names: Iterable[str]) -> SimulatedPeople:
    """Return who stands in for these people of a scenario, by their ids; each must have a walk."""
    persons = {person.id: person for person in resolved.scenario.people}
    setups = {setup.id: setup for setup in resolved.people}
    return SimulatedPeople(_phone(resolved, persons[name], setups[name]) for name in sorted(names))


def _phone(resolved: ResolvedScenario, person: Person, setup: PersonSetup) -> SimulatedPhone:
    assert person.simulated is not None
    errors = PhoneErrors(person.simulated.accuracy_m, person.simulated.period_s)
    walk = Walk(resolved.walks[person.id], setup.heading)
    seeds = seed_of(resolved.scenario.seed, f"person {person.id}")
    return SimulatedPhone(person.id, walk, setup.frame(), errors, seeds)
