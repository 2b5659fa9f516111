"""The wheel holds what its help and its pages send people to, and a workspace of it is whole."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.cli.dispatch import COMMANDS
from vve_sumo.workspace import CONFORMANCE_SUITES, WORKSPACE_FOLDERS

SHIPPED = "vve_sumo/shipped"
#: of a page's links, those to another file
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")
#: subclasses of the suites as a page shows them, for the toys that are shipped beside
MINE = """
from tests.ports.metric import MetricConformance
from tests.ports.sensor import SensorConformance

class TestMine(SensorConformance):
    kind = "tests/ports/toy/range_finder.py:make"

class TestMyMetrics(MetricConformance):
    name = "tests/ports/toy/lateral_comfort.py:make"
"""


def imported(file: Path) -> Iterator[str]:
    """Yield the files of `tests/` that a module of the tests imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "tests":
            for name in (node.module, *(f"{node.module}.{one.name}" for one in node.names)):
                place = f"{name.replace('.', '/')}.py"
                yield from (place,) if (REPOSITORY / place).is_file() else ()


def test_the_suites_come_with_all_that_they_import() -> None:
    shipped = [file for file in CONFORMANCE_SUITES if file.endswith(".py")]
    assert {f"tests/ports/{name}.py" for name in ("metric", "receiver", "sensor", "vehicle_interface")} <= {*shipped}
    assert {place for file in shipped for place in imported(REPOSITORY / file)} <= {*shipped}
    assert all(f"{Path(file).parent}/__init__.py" in shipped for file in shipped)


def test_the_wheel_has_what_a_workspace_is_laid_out_of() -> None:
    with (REPOSITORY / "pyproject.toml").open("rb") as file:
        included = tomllib.load(file)["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert included == {name: f"{SHIPPED}/{name}" for name in (*WORKSPACE_FOLDERS, *CONFORMANCE_SUITES, "docs")}


def test_the_wheel_has_the_modules_of_v2x_messages_and_their_licence(installed: Path) -> None:
    source = REPOSITORY / "vve_sumo" / "v2x" / "asn1"
    packed = {file.name: file.read_bytes() for file in (installed / "vve_sumo" / "v2x" / "asn1").iterdir()}
    assert packed == {file.name: file.read_bytes() for file in source.iterdir()}
    assert {"LICENSE.txt", "TS102894-2v241-CDD.asn"} <= packed.keys()


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's content, built from this checkout."""
    pytest.importorskip("hatchling", reason="building the wheel needs hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=REPOSITORY, check=True, capture_output=True, timeout=300)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    return folder / "site"


def run(installed: Path, folder: Path, *arguments: str) -> str:
    """Return what Python says that knows the wheel's content and not this checkout."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, *arguments]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_page_that_a_help_names_is_where_it_says(installed: Path, tmp_path: Path) -> None:
    names = [command.__name__.rpartition(".")[2].replace("_", "-") for command in COMMANDS]
    code = (
        "import sys\nfrom vve_sumo.cli import main\n"
        "for name in ['', *sys.argv[1:]]:\n"
        "    try: main([*filter(None, [name]), '--help'])\n"
        "    except SystemExit: print('=====')\n"
    )
    helps = run(installed, tmp_path, "-c", code, *names).split("=====\n")
    naming = 0
    for text in helps:
        pages = re.findall(r"\bdocs/(\w+\.md)", text)
        naming += bool(pages)
        (said,) = set(re.findall(r"^docs/ is (.+)$", text, re.MULTILINE)) if pages else ("",)
        assert all((Path(said) / page).is_file() for page in pages)
        assert not pages or Path(said).is_relative_to(installed)
    assert naming >= 3


def test_the_pages_links_lead_to_files(installed: Path) -> None:
    pages = sorted((installed / SHIPPED / "docs").glob("**/*.md"))
    assert len(pages) >= 28
    for page in pages:
        for link in LINK.findall(page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


@pytest.mark.thorough
def test_a_workspace_has_examples_and_suites_that_run(installed: Path, tmp_path: Path) -> None:
    run(installed, tmp_path, "-m", "vve_sumo.cli", "init", "mine")
    brains = tmp_path / "mine" / "examples" / "brains"
    assert _names(brains) == _names(REPOSITORY / "examples" / "brains")
    for file in brains.glob("*.py"):
        compile(file.read_text(encoding="utf-8"), str(file), "exec")
    (tmp_path / "mine" / "test_mine.py").write_text(MINE, encoding="utf-8")
    said = run(installed, tmp_path / "mine", "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_mine.py")
    assert re.search(r"\d+ passed", said)
    for suite in ("receiver", "vehicle_interface"):
        run(installed, tmp_path / "mine", "-c", f"import tests.ports.{suite} as t; assert 'mine' in t.__file__")


def _names(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.glob("**/*") if "__pycache__" not in file.parts}
