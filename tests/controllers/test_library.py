"""Parts of the shipped controllers in a file of a user's own: importable, and hashed with it."""

from __future__ import annotations

import inspect

from tests.controllers.street import FUSION
from vve_sumo import controller, controllers
from vve_sumo.drive.plugged_in import CONTROLLER, PluggedIn, digests

MINE = """
from vve_sumo.controllers import IntelligentDriver, Tracker
from vve_sumo.values import ControlCommand

class Mine:
    def step(self, observation):
        return ControlCommand(0.0, 0.0)

def make(vehicle, tuning):
    Tracker(vehicle)
    return Mine()
"""


def test_every_part_is_where_it_says_and_is_documented(repository):
    for name in controllers.__all__:
        part = getattr(controllers, name)
        assert inspect.getdoc(part)
        assert part.__module__ == f"vve_sumo.controllers.{controllers.PARTS[name]}"
        assert inspect.getsourcefile(part) == str(repository / "controllers" / f"{controllers.PARTS[name]}.py")
    page = (repository / "docs" / "controllers.md").read_text(encoding="utf-8")
    named = {name for name in controllers.__all__ if f"`{name}" in page or f"{name}(" in page}
    assert set(controllers.__all__) - named <= {"CarFollowing", "SteeringLaw"}


def test_the_parts_that_a_controller_uses_are_among_its_code(repository, tmp_path):
    """With what the parts themselves are made of; a part that is not used is not there."""
    file = tmp_path / "mine.py"
    file.write_text(MINE, encoding="utf-8")
    name = f"{file}:make"
    controller.load(name, FUSION, {}, [])
    part = PluggedIn(controller.PORT, name, CONTROLLER)
    files = part.files()
    library = {role.removeprefix("controller_vve_sumo.controllers.") for role in files} - {"controller_mine"}
    assert {"car_following", "tracks", "crossing", "parting", "trend"} <= library
    assert not {"lqr", "follow_and_stop"} & library
    assert files["controller_vve_sumo.controllers.tracks"] == repository / "controllers" / "tracks.py"

    recorded = {role: [digest] for role, digest in digests(files).items()}
    assert part.changed(recorded) == []
    changed = recorded | {"controller_vve_sumo.controllers.tracks": ["of another file"]}
    assert part.changed(changed) == ["controller_vve_sumo.controllers.tracks has changed since"]


def test_a_controller_without_them_has_none_of_them(tmp_path):
    file = tmp_path / "plain.py"
    file.write_text(
        MINE.replace("from vve_sumo.controllers import IntelligentDriver, Tracker\n", "").replace(
            "    Tracker(vehicle)\n", ""
        ),
        encoding="utf-8",
    )
    controller.load(f"{file}:make", FUSION, {}, [])
    assert list(PluggedIn(controller.PORT, f"{file}:make", CONTROLLER).files()) == ["controller_plain"]
