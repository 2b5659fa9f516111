"""The hot path, compiled from the same source: its classes are the same to a user, and its list is sound.

One small module is compiled for this. That whole drives are the same to the byte `./check compiled` shows before a
release.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import json
import os
import pickle
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from copy import copy, deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "both"

REPOSITORY = Path(__file__).parent.parent
HOOK = REPOSITORY / "hatch_build.py"

SOURCE = '''
"""Classes of every kind that is made native."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Protocol

from quick import fast_frozen

LIMIT: Final = 9.0


class Wide(Protocol):
    """A port."""

    @property
    def width(self) -> float:
        """Width [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Body:
    """A box."""

    length: float  #: [m]
    width: float = 1.8
    name: str = "car"

    def __post_init__(self) -> None:
        if not self.length <= LIMIT:
            raise ValueError("too long")

    @property
    def area(self) -> float:
        return self.length * self.width


@fast_frozen
@dataclass(frozen=True, slots=True)
class Quick:
    x: float
    y: tuple[float, ...] = (1.0, 2.0)


@dataclass(slots=True)
class Open:
    x: float = 1.0
    listed: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Nothing:
    """It has no field."""


@dataclass(frozen=True, slots=True)
class Owner:
    wide: Wide
    others: dict[str, Body] = field(default_factory=dict)


def width_of(wide: Wide) -> float:
    return wide.width
'''


def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_build", HOOK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def imported(name: str, file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ModuleType, ModuleType]]:
    """The same module as plain Python and compiled."""
    if shutil.which("gcc") is None and shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("compiled")
    (folder / "quick.py").write_text("from vve_sumo.frozen import fast_frozen as fast_frozen\n", encoding="utf-8")
    (folder / "plain_classes.py").write_text(SOURCE, encoding="utf-8")
    (folder / "native_classes.py").write_text(hook().native_source(SOURCE), encoding="utf-8")
    setup = "from mypyc.build import mypycify\nfrom setuptools import setup\n"
    asked = ["--config-file=mypy.ini", "native_classes.py"]
    setup += f"setup(name='native', ext_modules=mypycify({asked}, opt_level='0'))\n"
    # What is compiled needs nothing of the package, all of which would be read for its types.
    (folder / "mypy.ini").write_text("[mypy]\n[mypy-quick]\nfollow_imports = skip\n", encoding="utf-8")
    (folder / "setup.py").write_text(setup, encoding="utf-8")
    ask = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    done = subprocess.run(ask, check=False, cwd=folder, capture_output=True, text=True)
    if "Python.h" in done.stderr:
        pytest.skip("Python's headers are not installed")
    assert done.returncode == 0, done.stdout + done.stderr
    sys.path.insert(0, str(folder))
    try:
        (native,) = folder.glob("native_classes.*.so")
        yield imported("plain_classes", folder / "plain_classes.py"), imported("native_classes", native)
    finally:
        sys.path.remove(str(folder))
        for name in ("plain_classes", "native_classes", "quick"):
            sys.modules.pop(name, None)


def made(module: ModuleType) -> list[Any]:
    """Objects of every class of a module."""
    body = module.Body(4.5)
    return [
        body, module.Body(4.5, 2.0, name="truck"), module.Quick(1.0), module.Quick(x=1.0, y=(3.0,)), module.Open(),
        module.Open(2.0, [3]), module.Nothing(), module.Owner(body), module.Owner(body, {"a": body})
    ]  # fmt: skip


@pytest.mark.thorough
def test_objects_look_and_compare_the_same(both: tuple[ModuleType, ModuleType]) -> None:
    plain, native = both
    for one, other, twin in zip(made(plain), made(native), made(native), strict=True):
        assert repr(one) == repr(other)
        assert other == twin
        assert other != object()
        assert type(other).__match_args__ == type(one).__match_args__
        assert dataclasses.asdict(one) == dataclasses.asdict(other)
        assert [field.name for field in dataclasses.fields(one)] == [field.name for field in dataclasses.fields(other)]
    assert native.Body(4.5) != native.Body(4.6)
    assert hash(native.Body(4.5)) == hash(native.Body(4.5)) == hash(plain.Body(4.5))
    assert native.width_of(native.Body(1.0, 2.5)) == native.width_of(plain.Body(1.0, 2.5)) == 2.5


def test_objects_can_be_copied_replaced_and_pickled(both: tuple[ModuleType, ModuleType]) -> None:
    for one in made(both[1]):
        for again in (copy(one), deepcopy(one), pickle.loads(pickle.dumps(one))):
            assert again == one
            assert type(again) is type(one)
    assert dataclasses.replace(both[1].Body(4.5), length=5.0) == both[1].Body(5.0)


@pytest.mark.parametrize("number", [0, 1])
def test_frozen_objects_stay_frozen_and_checked(both: tuple[ModuleType, ModuleType], number: int) -> None:
    module = both[number]
    for one in (module.Body(4.5), module.Quick(1.0)):
        name = dataclasses.fields(one)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(one, name, 2.0)
    with pytest.raises(AttributeError):
        module.Open().other = 1.0
    with pytest.raises(ValueError, match="too long"):
        module.Body(10.0)
    with pytest.raises(TypeError):
        module.Body()
    opened = module.Open()
    opened.x = 7.0
    assert opened.x == 7.0


def test_a_module_without_such_classes_stays_as_it_is() -> None:
    text = "from enum import Enum\n\n\nclass Kind(Enum):\n    A = 1\n\n\ndef f(x: float) -> float:\n    return x\n"
    assert hook().native_source(text) == text


@pytest.mark.parametrize("annotation", ["ClassVar[str]", "Final", "InitVar[str]"])
def test_what_mypyc_takes_for_a_field_is_refused(annotation: str) -> None:
    text = f"@dataclass(slots=True)\nclass Body:\n    length: float\n    kind: {annotation} = 'box'\n"
    with pytest.raises(ValueError, match=r"^Body: mypyc takes"):
        hook().native_source(text)


def listed() -> list[Path]:
    """The files that pyproject.toml has compiled."""
    table = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = table["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]["compiled"]
    files: list[Path] = []
    for pattern in patterns:
        found = list(REPOSITORY.glob(pattern))
        assert found, f"no module is {pattern}"
        files += found
    return files


@pytest.mark.thorough
def test_no_class_outside_inherits_from_a_compiled_one() -> None:
    """A class of plain Python cannot."""
    compiled = listed()
    names = {
        node.name
        for file in compiled
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not any("Protocol" in ast.unparse(base) for base in node.bases)
    }
    heirs = [
        f"{file.relative_to(REPOSITORY)}: {node.name}"
        for folder in ("vve_sumo", "controllers")
        for file in (REPOSITORY / folder).rglob("*.py")
        if file not in compiled
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any(ast.unparse(base).split("[")[0].split(".")[-1] in names for base in node.bases)
    ]
    assert not heirs


def test_no_function_of_a_compiled_module_catches_two_kinds_of_errors_by_one_name() -> None:
    """Such a name has the first kind for mypyc, and an error of another kind ends in a TypeError."""
    found = []
    for file in listed():
        for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef):
                handlers = [node for node in ast.walk(function) if isinstance(node, ast.ExceptHandler) and node.name]
                kinds = {(one.name, ast.unparse(one.type)) for one in handlers if one.type is not None}
                if len(kinds) > len({name for name, _kind in kinds}):
                    found.append(f"{file.relative_to(REPOSITORY)}: {function.name}")
    assert not found


def test_no_compiled_class_has_options_in_its_class_line() -> None:
    """Such as those of msgspec's structs: the compiled class would be without them, and nothing would say so."""
    with pytest.raises(ValueError, match="Sent: options"):
        hook().native_source("class Sent(Struct, array_like=True):\n    x: float\n")
    for file in listed():
        hook().native_source(file.read_text(encoding="utf-8"))


def test_no_compiled_module_declares_a_port_that_is_checked_while_a_program_runs() -> None:
    """A compiled protocol is none to `isinstance`."""
    assert not [file for file in listed() if "@runtime_checkable" in file.read_text(encoding="utf-8")]


@pytest.mark.skipif("VVE_PURE" not in os.environ, reason="`./check compiled` runs it, in a compiled copy")
@pytest.mark.parametrize(
    "scenario",
    [
        *(f.stem for f in sorted((REPOSITORY / "scenarios").glob("*.toml"))),
        "parked_car --seed 2",
        "parked_car --seed 3",
    ],
)
def test_a_compiled_drive_is_the_same_to_the_byte(scenario: str, tmp_path: Path) -> None:
    """The code from which this copy was made, as plain Python, drives to the same record hash."""
    hashes: dict[str, str] = {}
    compiled: dict[str, bool] = {}
    for place in (os.environ["VVE_PURE"], str(REPOSITORY)):
        out = tmp_path / str(len(hashes))
        ask = [sys.executable, "-m", "vve_sumo.cli", "drive", *scenario.split(), "--quiet", "--out", str(out)]
        done = subprocess.run(ask, check=False, cwd=place, env=os.environ | {"PYTHONPATH": place}, capture_output=True)
        assert done.returncode in (0, 1), done.stderr  # 1: it drove, and failed its criteria
        hashes[place] = json.loads((out / "summary.json").read_text(encoding="utf-8"))["record_sha256"]
        compiled[place] = json.loads((out / "provenance.json").read_text(encoding="utf-8"))["code"]["compiled"]
    assert list(compiled.values()) == [False, True]
    assert len(set(hashes.values())) == 1
