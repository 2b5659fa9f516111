"""The doctor's checks of a scenario's real people: how far their fields are from the lot, and who reaches the page.

Computes from the files alone; nobody has to be there.
"""

from __future__ import annotations

import ipaddress

from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.people.separation import distance_to_fence
from vve_sumo.rig.schema import Rig


def people(resolved: ResolvedScenario, rig: Rig) -> list[Check]:
    """Return a check for every person of a scenario that was resolved with the rig, and one of the page."""
    checks = []
    for setup in resolved.people:
        distance = distance_to_fence(0.0, 0.0, setup.fence)
        room = distance - setup.least_distance
        observed = f"{setup.id}: field's anchor {distance:.0f} m from the lot, {room:.0f} m more than must be kept"
        checks.append(Check("people", observed))
    if any(setup.pages for setup in resolved.people) and ipaddress.ip_address(rig.people_page.address).is_loopback:
        advice = "set people_page.address to this computer's on their network, with a certificate"
        observed = f"page on {rig.people_page.address}: no phone reaches it"
        checks.append(Check("people's page", observed, CheckResult.NOTE, advice))
    return checks
