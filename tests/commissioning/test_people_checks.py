"""What the doctor says of the people of a scenario."""

from __future__ import annotations

from pathlib import Path

from tests.conftest import REPOSITORY
from tests.drive.street import altered
from tests.drive.test_people import anna, changes, rig, walk_file
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.people_checks import people


def test_the_room_between_field_and_lot_is_said_and_a_page_that_no_phone_reaches(tmp_path: Path) -> None:
    """The anchor is 92.9 m from the lot's outline; 50 m are to be kept."""
    resolved = altered(changes(anna(walk_file(tmp_path, (0.0, 0.0, 0.0)))))
    by_phone = rig(source="phone")
    room, page = people(resolved.with_rig(by_phone, REPOSITORY, live=True), by_phone)
    assert room.observed == "anna: field's anchor 93 m from the lot, 43 m more than must be kept"
    assert room.finding is CheckResult.GO
    assert page.finding is CheckResult.NOTE
    assert "no phone reaches it" in page.observed
    nobody = rig()
    assert len(people(resolved.with_rig(nobody, REPOSITORY, live=True), nobody)) == 1
    assert people(altered(changes()).with_rig(nobody, REPOSITORY, live=True), nobody) == []
