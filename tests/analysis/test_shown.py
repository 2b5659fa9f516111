"""What the analysis finds by name when it is asked to show itself: every name leads to something that can be called."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.analysis.shown import shown

ANALYSIS = REPOSITORY / "vve_sumo" / "analysis"


def calls(file: Path) -> Iterator[ast.Call]:
    """Yield every call of `shown` in a file, whatever it is imported as a part of."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] == "shown":
            yield node


CALLS = [call for file in sorted(ANALYSIS.rglob("*.py")) for call in calls(file)]
NAMES = sorted({ast.unparse(call.args[0]) for call in CALLS})


def test_no_call_is_missed() -> None:
    """By text they are as many as by the tree, and not none."""
    text = "".join(file.read_text(encoding="utf-8") for file in ANALYSIS.rglob("*.py"))
    assert len(CALLS) == len(re.findall(r"(?<!def )\bshown\(", text)) > 0


@pytest.mark.parametrize("literal", NAMES)
def test_every_name_leads_to_something_that_can_be_called(literal: str) -> None:
    name = ast.literal_eval(literal)  # a name that is put together could not be checked here
    module, colon, function = name.partition(":")
    assert colon
    assert callable(getattr(importlib.import_module(f"vve_sumo.{module}"), function))


def test_a_name_that_leads_nowhere_is_an_error() -> None:
    with pytest.raises(ModuleNotFoundError):
        shown("nix:drive_overview")
    with pytest.raises(AttributeError):
        shown("plotting:nix")
