"""How controllers are found, what is said when they are not, and what becomes of one that fails."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from tests.controllers.street import FUSION
from tests.setpoints import setpoint
from vve_sumo.controller import Guarded, known, load, module, origin, settle, sources
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.values import ControlCommand, Detections, Observation, Point, Pose

POSE = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PATH = ReferencePath.from_points([0.0, 9.0], [0.0, 0.0])
NOTHING = Detections(-math.inf, np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int8))
OBSERVATION = Observation(0, 0.0, POSE, PATH, 5.0, {"radar": NOTHING}, math.nan)

CONSTANT = """
from vve_sumo.values import ControlCommand

class Constant:
    def __init__(self, acceleration):
        self.acceleration = acceleration
    def step(self, observation):
        return ControlCommand(0.0, self.acceleration)

def make(vehicle, tuning):
    return Constant({acceleration})

def other(vehicle, tuning):
    return Constant(0.25)
"""


@pytest.fixture
def folders(tmp_path):
    first, second = tmp_path / "mine", tmp_path / "shipped"
    first.mkdir()
    second.mkdir()
    (first / "gentle.py").write_text(CONSTANT.format(acceleration=-1.0))
    (second / "gentle.py").write_text(CONSTANT.format(acceleration=-2.0))
    (second / "harsh.py").write_text(CONSTANT.format(acceleration=-3.0))
    (second / "numbers.py").write_text("DECELERATION = -1.75\n")
    (second / "relative.py").write_text(
        "from .numbers import DECELERATION\n" + CONSTANT.format(acceleration="DECELERATION")
    )
    return [first, second]


def asked(name, folders):
    return load(name, FUSION, {}, folders).step(OBSERVATION).acceleration


def test_the_first_folder_that_has_the_name_wins(folders):
    assert asked("gentle", folders) == -1.0
    assert asked("gentle", folders[::-1]) == -2.0
    assert asked("harsh", folders) == -3.0


def test_a_file_and_a_function_can_be_named(folders):
    assert asked(f"{folders[0]}/gentle.py:other", []) == 0.25
    assert asked(f"{folders[1]}/relative.py:make", []) == -1.75


def test_neighbours_are_imported_relatively_and_nothing_leaks(folders):
    before, modules = list(sys.path), set(sys.modules)
    assert asked("relative", folders) == -1.75
    assert sys.path == before
    assert all(name.startswith("vve_sumo_workspace_") for name in set(sys.modules) - modules)
    assert not {"relative", "numbers_", "gentle", "controllers.follow_and_stop"} & (set(sys.modules) - modules)


def test_an_edited_file_is_read_afresh(folders):
    assert asked("gentle", folders) == -1.0
    (folders[0] / "gentle.py").write_text(CONSTANT.format(acceleration=-0.125))
    assert asked("gentle", folders) == -0.125


def test_an_entry_point_is_found_after_the_folders(folders, monkeypatch):
    package = folders[0].parent / "plugin"
    metadata = package / "vve_test_plugin-1.0.dist-info"
    metadata.mkdir(parents=True)
    (package / "vve_test_plugin.py").write_text(CONSTANT.format(acceleration=-0.5))
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: vve-test-plugin\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[vve_sumo.controllers]\nplugged = vve_test_plugin:make\nbroken = vve_test_plugin:absent\n"
    )
    monkeypatch.syspath_prepend(package)
    assert asked("plugged", folders) == -0.5
    assert known(folders) == ("broken", "fmu", "gentle", "harsh", "plugged", "relative")
    with pytest.raises(ConfigError, match="controller broken: its entry point raised AttributeError"):
        load("broken", FUSION, {}, folders)


def test_the_sources_are_the_files_that_were_imported(folders):
    asked("relative", folders)
    assert sources("relative", folders) == {name: folders[1] / f"{name}.py" for name in ("numbers", "relative")}
    asked("harsh", folders)
    assert sources("harsh", folders) == {"harsh": folders[1] / "harsh.py"}
    assert sources("absent", folders) == {}


def test_where_code_lies_is_found_without_running_it(folders):
    """As an import would find it, where several things have the name."""
    (folders[0] / "bomb.py").write_text("raise SystemExit('run')\n")
    for name in ("bomb", f"{folders[0] / 'bomb.py'}:make"):
        place = origin(name, folders)
        assert (place.root, place.main, place.file("bomb")) == (folders[0], "bomb", folders[0] / "bomb.py")
    package = folders[0] / "bomb"
    package.mkdir()
    (package / "__init__.py").write_text("raise SystemExit('run')\n")
    assert place.file("bomb") == package / "__init__.py"
    with pytest.raises(ConfigError, match="SystemExit"):
        load("bomb", FUSION, {}, folders)
    assert [place.file(name) for name in ("absent", "", "..", "../mine/bomb", "/etc/passwd", "bomb.")] == [None] * 6
    with pytest.raises(ConfigError, match="controller absent: unknown; known are"):
        origin("absent", folders)


def test_an_installed_package_is_found_without_running_it(folders, monkeypatch):
    site = folders[0].parent / "site"
    metadata, package = site / "vve_test_bomb-1.0.dist-info", site / "vve_test_bomb"
    metadata.mkdir(parents=True)
    (package / "inner").mkdir(parents=True)
    for place in ("__init__.py", "main.py", "inner/__init__.py", "inner/law.py"):
        (package / place).write_text("raise SystemExit('run')\n")
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: vve-test-bomb\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[vve_sumo.controllers]\nbombed = vve_test_bomb.main:make\n")
    monkeypatch.syspath_prepend(site)
    assert origin("bombed", folders).file("vve_test_bomb.main") == package / "main.py"
    assert sources("bombed", folders) == {
        "vve_test_bomb": package / "__init__.py",
        "vve_test_bomb.inner": package / "inner" / "__init__.py",
        "vve_test_bomb.inner.law": package / "inner" / "law.py",
        "vve_test_bomb.main": package / "main.py",
    }
    assert "vve_test_bomb" not in sys.modules


@pytest.mark.parametrize(
    ("name", "source", "says"),
    [
        ("absent", None, "controller absent: unknown; known are fmu, gentle, harsh, relative"),
        ("absent.py:make", None, "controller absent.py:make: there is no file absent.py"),
        ("bad", "x = 1\n", r"bad\.py offers no function make\(vehicle, tuning\)"),
        ("bad", "def make(:\n", r"reading .*bad\.py raised SyntaxError"),
        ("bad", "import no_such_module\n", "raised ModuleNotFoundError: No module named 'no_such_module'"),
        ("bad", "def make(vehicle, tuning):\n    return 1 / 0\n", "make raised ZeroDivisionError: division by zero"),
        ("bad", "def make(vehicle, tuning):\n    return 7\n", r"make returned a int without step\(observation\)"),
        ("bad", "def make(vehicle):\n    return 7\n", "make raised TypeError"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(folders, name, source, says):
    if source is not None:
        (folders[0] / f"{name}.py").write_text(source)
    with pytest.raises(ConfigError, match=says) as refused:
        load(name, FUSION, {}, folders)
    assert "\n" not in str(refused.value)


def test_a_neighbour_can_be_read_by_itself(folders):
    assert module("numbers", folders).DECELERATION == -1.75
    with pytest.raises(ConfigError, match=r"controller file absent\.py: not in"):
        module("absent", folders)


def test_tuning_is_laid_over_the_defaults():
    defaults = {"gap_m": 5.0, "law": "preview", "on": True}
    assert settle({"gap_m": 6, "on": False}, defaults) == {"gap_m": 6.0, "law": "preview", "on": False}
    assert isinstance(settle({"gap_m": 6}, defaults)["gap_m"], float)
    assert settle({"gap_m": 9.0}, defaults, {"gap_m": (1.0, 9.0)})["gap_m"] == 9.0
    with pytest.raises(ConfigError, match=r"tuning key 'gap_m' must be 1 to 9, got 9\.5"):
        settle({"gap_m": 9.5}, defaults, {"gap_m": (1.0, 9.0)})


@pytest.mark.parametrize(
    ("tuning", "says"),
    [
        ({"gap": 5.0}, "tuning key 'gap' is unknown, did you mean 'gap_m'?; allowed are gap_m, law, on"),
        ({"gap_m": "5"}, "tuning key 'gap_m' must be a finite number, got '5'"),
        ({"gap_m": True}, "tuning key 'gap_m' must be a finite number, got True"),
        ({"gap_m": math.nan}, "tuning key 'gap_m' must be a finite number, got nan"),
        ({"law": 1.0}, "tuning key 'law' must be a str, got 1.0"),
        ({"on": 1.0}, "tuning key 'on' must be a bool, got 1.0"),
    ],
)
def test_wrong_tuning_names_the_key(tuning, says):
    with pytest.raises(ConfigError) as refused:
        settle(tuning, {"gap_m": 5.0, "law": "preview", "on": True})
    assert str(refused.value) == says


class Answers:
    def __init__(self, answer):
        self.answer = answer

    def step(self, observation):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "code", "text"),
    [
        (ValueError("no\nway"), "controller_raised", "ValueError: no way"),
        (RecursionError(), "controller_raised", "RecursionError: "),
        (None, "controller_wrong_type", "got None, expected a ControlCommand of floats"),
        (setpoint(0.0, 0.0), "controller_wrong_type", "got Setpoint(steering=0.0, acceleration=0.0, emergency=False"),
        ((0.0, 0.0), "controller_wrong_type", "got (0.0, 0.0), expected a ControlCommand of floats"),
        (ControlCommand(None, 0.0), "controller_wrong_type", "expected a ControlCommand of floats"),
        (ControlCommand(0.0, "-1"), "controller_wrong_type", "expected a ControlCommand of floats"),
        (ControlCommand(math.nan, -1.0), "controller_not_finite", "steering nan, acceleration -1.0"),
        (ControlCommand(0.0, -math.inf), "controller_not_finite", "steering 0.0, acceleration -inf"),
    ],
)
def test_a_failure_is_a_value(answer, code, text):
    guarded = Guarded(Answers(answer))
    assert guarded.step(OBSERVATION) == (None, (code,))
    assert text in guarded.text


def test_a_good_setpoint_passes_untouched():
    setpoint = ControlCommand(np.float64(0.1), -1, note="ok")
    assert Guarded(Answers(setpoint)).step(OBSERVATION) == (setpoint, ())


def test_the_shipped_controller_has_its_name_and_says_what_it_cannot_take(repository):
    search = [repository / "controllers"]
    assert "follow_and_stop" in known(search)
    with pytest.raises(
        ConfigError, match=r"follow_and_stop: tuning key 'gap' is unknown, did .*; allowed are comfort, emerg"
    ):
        load("follow_and_stop", FUSION, {"gap": 4.0}, search)
    with pytest.raises(ConfigError, match="'steering' must be preview, pure_pursuit, stanley or lqr, got 'mpc'"):
        load("follow_and_stop", FUSION, {"steering": "mpc"}, search)
    with pytest.raises(ConfigError, match=r"'look_ahead_time_s' must be 0\.1 to 5"):
        load("follow_and_stop", FUSION, {"look_ahead_time_s": 0.0}, search)
