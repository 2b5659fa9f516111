"""Every reason code that can come up has plain words: those found in the sources, and no others."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from vve_sumo.drive.reasons import ALL, DRIVE_REASONS, in_words
from vve_sumo.pose import trust
from vve_sumo.vehicle import arming

PACKAGE = Path(arming.__file__).parent.parent
ROOMS = ("drive", "live", "world", "lot", "controller.py")

CODE = re.compile(r"[a-z]+(_[a-z]+)+$")
#: where codes come up: a statement in which one of these words occurs
PLACES = re.compile(r"fault|found|reason|refus|fail|waits|edge|not_ready|\) if .* else \(\)", re.IGNORECASE)
#: codes that stand where no scan sees them, each with its source
HIDDEN = {
    "world/ego_sync.py": ("pose_not_front_bumper", "pose_not_finite", "pose_out_of_bounds", "ego_sync_position"),
    "live/recorder.py": ("record_failed",),
    "live/start_processes.py": ("path_leaves_lot",),
}
#: calls that take a code
TAKERS = frozenset({"append", "_fail", "_refused"})
#: words in tuples of such statements that are no codes
OTHERS = frozenset(
    {
        "emergency_used",
        "removed_at_entry",
        "removed_after_standoff",
        "sumo_warnings",
        "driver_has_control",
        "pose_reasons",
    }
)
UNIT = re.compile(r".*_(m|s|ms|mps|mps2|rad|radps|deg|nm|percent)$")


def codes(source: str) -> set[str]:
    """Words with an underscore that stand alone, in a tuple, list or call, in statements that deal with faults."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        statement = isinstance(node, (ast.Assign, ast.AugAssign, ast.AnnAssign, ast.Return, ast.Expr))
        if statement and PLACES.search(ast.unparse(node)):
            found |= {word for word in _words(node) if CODE.match(word) and not UNIT.match(word)}
    return found - OTHERS


def _words(statement: ast.AST) -> set[str]:
    held: list[ast.AST] = []
    for node in ast.walk(statement):
        match node:
            case ast.Tuple() | ast.List() | ast.Set():
                held += node.elts
            case ast.Call(func=ast.Attribute(attr=name)) if name in TAKERS:
                held += node.args
            case ast.IfExp():
                held += [node.body, node.orelse]
    return {one.value for one in held if isinstance(one, ast.Constant) and isinstance(one.value, str)}


def used() -> dict[str, set[str]]:
    """Codes in each source file."""
    files = [
        file for room in ROOMS for file in ([PACKAGE / room] if room.endswith(".py") else PACKAGE.glob(f"{room}/*.py"))
    ]
    return {str(file.relative_to(PACKAGE)): codes(file.read_text()) for file in files if file.name != "reasons.py"}


def test_the_scan_finds_codes():
    assert codes('self._faults.append("ego_not_placed")') == {"ego_not_placed"}
    assert codes('found = ("bus_down",) if deaf else ()') == {"bus_down"}
    assert codes('names = ("ego_sync_speed", "speed_mps")  # of faults\n') == set()
    assert codes('fault = "pose_not_finite" if wrong else ""') == {"pose_not_finite"}
    assert codes('row = {"some_key": reasons}\n"""a_docstring of reasons"""') == set()
    assert len(set().union(*used().values())) > 20


def test_every_code_has_words():
    unknown = {file: sorted(found - ALL.keys()) for file, found in used().items() if found - ALL.keys()}
    assert unknown == {}
    for file, hidden in HIDDEN.items():
        source = (PACKAGE / file).read_text()
        assert all(f'"{code}"' in source for code in hidden)
        assert ALL.keys() >= set(hidden)


def test_no_words_are_left_without_a_code():
    text = "\n".join(file.read_text() for file in PACKAGE.rglob("*.py") if file.name != "reasons.py")
    assert [code for code in DRIVE_REASONS if f'"{code}"' not in text and code not in text] == []


def test_words_stand_in_order_and_in_one_place():
    assert list(DRIVE_REASONS) == sorted(DRIVE_REASONS)
    assert not DRIVE_REASONS.keys() & (arming.REASONS.keys() | trust.REASONS.keys())
    assert all(words == words.strip() and "_" not in words for words in DRIVE_REASONS.values())


def test_a_code_without_words_stands_for_itself():
    assert in_words("overrun").startswith("the drive's loop")
    assert in_words("never_heard_of") == "never_heard_of"
