"""Looks up what the hazard analysis names: code of the package, tests, headings of the documentation.

Reads the sources and imports none of them.
"""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

from tests.conftest import REPOSITORY

DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


@functools.cache
def defined(file: Path) -> frozenset[str]:
    """Return what a source defines: names at its top, and `Class.name` for what stands in a class."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found = set(_names(tree.body))
    for one in tree.body:
        if isinstance(one, ast.ClassDef):
            found |= {f"{one.name}.{name}" for name in _names(one.body)}
    return frozenset(found)


def _names(body: list[ast.stmt]) -> list[str]:
    names = [one.name for one in body if isinstance(one, DEFINITIONS)]
    for one in body:
        targets = one.targets if isinstance(one, ast.Assign) else [one.target] if isinstance(one, ast.AnnAssign) else []
        names += [target.id for target in targets if isinstance(target, ast.Name)]
    return names


def is_code(reference: str) -> bool:
    """Whether `module:name` or `module:Class.name` is in the package."""
    module, _, name = reference.partition(":")
    file = REPOSITORY / f"{module.replace('.', '/')}.py"
    return file.is_file() and name in defined(file)


def is_test(node: str) -> bool:
    """Whether a node of pytest, `tests/FILE.py::TEST` or `tests/FILE.py::Class::TEST`, is there."""
    file, _, name = node.partition("::")
    there = REPOSITORY / file
    return (
        there.is_file() and name.rpartition("::")[2].startswith("test_") and name.replace("::", ".") in defined(there)
    )


def has_anchor(place: str) -> bool:
    """Whether a page of the documentation, and the heading that an anchor names, are there."""
    file, _, anchor = place.partition("#")
    page = REPOSITORY / file
    return page.is_file() and (not anchor or anchor in anchors(page))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MkDocs make them."""
    heads = re.findall(r"(?m)^#+ (.+)$", page.read_text(encoding="utf-8"))
    bare = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in heads]
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", head.lower()).strip()) for head in bare}
