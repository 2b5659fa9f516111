"""The log of a first hour: its commands are whole, and its lines are those that the program still prints."""

from __future__ import annotations

import re

from tests.conftest import REPOSITORY
from tests.test_docs_commands import commands, is_whole, words

PAGE = REPOSITORY / "docs" / "first_hour.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"```text\n(.*?)```", TEXT, flags=re.DOTALL)
SOURCES = "".join(
    file.read_text(encoding="utf-8")
    for folder in ("commissioning", "live", "cli", "drive", "plotting", "report", "safety", "vehicle")
    for file in sorted((REPOSITORY / "vve_sumo" / folder).rglob("*.py"))
)


def test_its_commands_are_whole_and_go_through_the_first_step() -> None:
    """That each is taken with its options, `tests/test_docs_commands.py` tests of every page."""
    typed = [line for line in commands(PAGE) if line.startswith("vve-sumo ")]
    shown = [line.removeprefix("$ ") for block in BLOCKS for line in block.splitlines() if line.startswith("$ vve")]
    assert len(shown) >= 15
    assert any("--rehearse" in line for line in shown)
    assert {*shown} <= {*typed}
    assert all(is_whole(words(line)) for line in shown)
    wanted = {"init", "doctor", "vehicle", "network", "path", "align", "drive", "replay", "report", "dossier"}
    assert {line.split()[1] for line in shown} == wanted


def test_every_line_of_a_check_is_one_that_the_program_makes() -> None:
    names = {
        found[1].strip()
        for block in BLOCKS
        for line in block.splitlines()
        if (found := re.match(r"(?:go|note|NO-GO) +(\S.{16}) ", line))
    }
    assert len(names) > 20
    assert {name for name in names if f'"{name}"' not in SOURCES} == set()


def test_every_state_on_the_screen_is_one_that_the_screen_has() -> None:
    states = set(re.findall(r"^ +\d+\.\d\d s  ([A-Z][A-Z :,]+[A-Z])(?::|$)", TEXT, flags=re.MULTILINE))
    assert "DRIVING: ANY KEY STOPS" in states
    written = SOURCES.lower()  # the screen writes them in capitals
    missing = {state for state in states if not all(part.lower() in written for part in state.split(": ", 1))}
    assert missing == set()
