"""Compiles the modules of every tick by mypyc while a wheel is built, from the same source; asked for, never by itself.

    HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 pip install .    a wheel
    python hatch_build.py                             in place, for tests and benchmarks of a copy of the repository

needs a C compiler and Python's headers. pyproject.toml lists the modules (`compiled`). They are compiled in one group,
so that calls between them stay in C, and each lies beside its source. A build that is not asked for this is pure
Python.

A frozen dataclass with slots is not what mypyc makes a native class of: slots make a second class, and fields are set
one call each. Before it is compiled, the text of such a class gets the constructor and the pickling that it would have
had, and loses `slots`; a native class has neither more attributes nor a `__dict__` anyway. A protocol gets a decorator
that does nothing: as a native class, only what inherits from it would be one.

What mypyc 2.4 does otherwise than Python, and a listed module therefore leaves out: a generator expression is computed
as a list, so an endless one never ends; a slice of a bytearray cannot be assigned to; a `Final` tuple that a
comprehension runs over needs its type; a native object cannot be copied by its parts; a value of another type than
declared raises; options in a class line are left out.
"""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE: Final = "vve_sumo"
#: decorator that has no meaning beside that of a plain class of a dataclass's kind
QUICK: Final = "fast_frozen"
#: text of the decorator of protocols, which mypyc leaves plain Python classes
PLAIN: Final = ("def _plain(made: type) -> type:", "    return made")
SETUP: Final = """
from mypyc.build import mypycify
from setuptools import setup
modules = mypycify(["--config-file=mypy.ini", *{modules!r}], group_name="{package}", multi_file=True, debug_level="0")
setup(name="{package}", packages=[], ext_modules=modules)
"""


def native_source(text: str) -> str:
    """Return the source of a module with its dataclasses and protocols as mypyc compiles them well."""
    lines, classes = text.split("\n"), [node for node in ast.parse(text).body if isinstance(node, ast.ClassDef)]
    for made in reversed(classes):
        if made.keywords:
            raise ValueError(f"{made.name}: options in a class line, which mypyc leaves out")
        if any(ast.unparse(base).split("[")[0] == "Protocol" for base in made.bases):
            lines.insert(made.lineno - 1, "@_plain")
        elif (call := _dataclass(made)) is not None:
            _make_native(lines, made, call)
    source = "\n".join(lines)
    if "\n@_plain\n" not in source:
        return source
    first = next(node for node in ast.parse(source).body if isinstance(node, (ast.ClassDef, ast.FunctionDef)))
    begin = min([first.lineno, *(decorator.lineno for decorator in first.decorator_list)]) - 1
    return "\n".join([*lines[:begin], *PLAIN, *lines[begin:]])


def _dataclass(made: ast.ClassDef) -> ast.Call | None:
    """Return the call of `dataclass` that decorates a class with slots."""
    calls = (one for one in made.decorator_list if isinstance(one, ast.Call) and ast.unparse(one.func) == "dataclass")
    return next((call for call in calls if any(option.arg == "slots" for option in call.keywords)), None)


def _make_native(lines: list[str], made: ast.ClassDef, call: ast.Call) -> None:
    """Change the lines of a dataclass: no slots, and where its fields are plain its own constructor."""
    options = {str(one.arg): ast.unparse(one.value) for one in call.keywords if one.arg != "slots"}
    fields = [node for node in made.body if isinstance(node, ast.AnnAssign)]
    if any(ast.unparse(field.annotation).startswith(("ClassVar", "InitVar", "Final")) for field in fields):
        raise ValueError(f"{made.name}: mypyc takes a ClassVar, InitVar or Final of a dataclass for one of its fields")
    methods = {node.name for node in made.body if isinstance(node, ast.FunctionDef)}
    body: list[str] = []
    if not made.bases and all(_is_argument(field) for field in fields):
        options["init"] = "False"
        body += _constructor(fields, "__post_init__" in methods)
    if "__reduce__" not in methods:
        values = "".join(f"self.{ast.unparse(field.target)}, " for field in fields)
        body.append("    def __reduce__(self) -> tuple[type, tuple[object, ...]]:")
        body.append(f"        return {made.name}, ({values})")
    assert made.end_lineno is not None
    lines[made.end_lineno : made.end_lineno] = body
    for decorator in reversed(made.decorator_list):
        if decorator is call:
            said = ", ".join(f"{name}={value}" for name, value in options.items())
            lines[decorator.lineno - 1 : decorator.end_lineno] = [f"@dataclass({said})"]
        elif ast.unparse(decorator) == QUICK:
            del lines[decorator.lineno - 1]


def _is_argument(field: ast.AnnAssign) -> bool:
    """Whether a field is one argument of the constructor, with a plain default or none."""
    return field.value is None or not ast.unparse(field.value).startswith("field(")


def _constructor(fields: Sequence[ast.AnnAssign], checked: bool) -> list[str]:
    arguments = ["self"]
    for field in fields:
        default = "" if field.value is None else f" = {ast.unparse(field.value)}"
        arguments.append(f"{ast.unparse(field.target)}: {ast.unparse(field.annotation)}{default}")
    body = [f"    def __init__({', '.join(arguments)}) -> None:"]
    # mypy calls the fields of a frozen dataclass read-only, also here.
    names = (ast.unparse(field.target) for field in fields)
    body += [f"        self.{name} = {name}  # type: ignore" for name in names]
    if checked or not fields:
        body.append("        self.__post_init__()" if checked else "        pass")
    return body


def compile_package(root: Path, folder: Path) -> dict[Path, str]:
    """Compile the modules that pyproject.toml of the repository `root` lists, in an empty `folder`.

    Returns the compiled files, and the place of each in a wheel and in the repository. Raises
    subprocess.CalledProcessError with what mypyc and the C compiler wrote.
    """
    tools = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    patterns = tools["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]["compiled"]
    skipped = [name for override in tools["mypy"]["overrides"] for name in override["module"]]
    shutil.copytree(root / PACKAGE, folder / PACKAGE, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    modules = []
    for pattern in patterns:
        found = sorted(folder.glob(pattern))
        if not found:
            raise ValueError(f"pyproject.toml: compiled: no module is {pattern}")
        modules += [file for file in found if file.name != "__init__.py" and file not in modules]
    for file in modules:
        file.write_text(native_source(file.read_text(encoding="utf-8")), encoding="utf-8")
    config = "[mypy]\nfollow_imports = silent\n"
    config += "".join(f"[mypy-{name}]\nignore_missing_imports = True\nfollow_imports = skip\n" for name in skipped)
    (folder / "mypy.ini").write_text(config, encoding="utf-8")
    named = [file.relative_to(folder).as_posix() for file in modules]
    (folder / "setup.py").write_text(SETUP.format(modules=named, package=PACKAGE), encoding="utf-8")
    built = folder / "built"
    ask = [sys.executable, "setup.py", "--quiet", "build_ext", "--build-lib", str(built)]
    done = subprocess.run(ask, check=False, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise subprocess.CalledProcessError(done.returncode, ask, done.stdout)
    return {file: file.relative_to(built).as_posix() for file in sorted(built.rglob("*.so"))}


class CompiledWheel(BuildHookInterface[Any]):
    """Adds the compiled modules to a wheel; an editable install stays pure Python."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say what belongs into the wheel and for which Python and machine it is."""
        if version == "editable":
            return
        self._folder = tempfile.mkdtemp(prefix=f"{PACKAGE}-")
        try:
            compiled = compile_package(Path(self.root), Path(self._folder))
        except subprocess.CalledProcessError as error:
            self.app.display_error(error.output)
            shutil.rmtree(self._folder)
            raise
        build_data["force_include"] |= {str(file): place for file, place in compiled.items()}
        build_data["pure_python"] = False
        version_tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
        machine = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"{version_tag}-{version_tag}-{machine}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Delete what was built on the way."""
        if version != "editable":
            shutil.rmtree(self._folder)


def main() -> None:
    """Compile in place: a compiled module is imported instead of the source beside it."""
    root = Path(__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        try:
            compiled = compile_package(root, Path(folder))
        except subprocess.CalledProcessError as error:
            sys.exit(error.output)
        for file, place in compiled.items():
            shutil.copy(file, root / place)


if __name__ == "__main__":
    main()
