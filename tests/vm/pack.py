"""Names every file of this machine that the virtual machine needs, for cpio: the interpreter, packages, checkout, `ip`.

Run by the interpreter that is to be taken along. What is needed is found by importing what the suite imports and by
asking the dynamic linker; names go to standard output, each ended by a zero byte, folders before what lies in them.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType

CHECKOUT = Path(__file__).resolve().parents[2]
IMPORTED = ("tests.vm.guest", "vve_sumo.live.simulated_vehicle", "vve_sumo.live.gateway", "can.interfaces.socketcan")
#: Names of folders and files that nothing at run time comes from.
LEFT_OUT = re.compile(
    r"tests?|site-packages|dist-packages|config-.*|idlelib|tkinter|_tkinter.*|turtledemo|lib2to3|ensurepip"
    r"|.*\.opt-[12]\.pyc|.*\.pyi"
)


def tree(folder: Path) -> Iterator[Path]:
    """Every file below a folder, but for what is left out."""
    for path, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not LEFT_OUT.fullmatch(name)]
        yield from (Path(path, name) for name in names if not LEFT_OUT.fullmatch(name))


def packages() -> Iterator[Path]:
    """Every file of the installed packages that are loaded now, with the shared libraries that wheels bring along."""
    sites = {Path(sysconfig.get_path(name)) for name in ("purelib", "platlib")}
    for name in {name.partition(".")[0] for name in sys.modules}:
        for site in sites:
            for folder in (site / name, site / f"{name}.libs"):
                yield from tree(folder)
            yield from site.glob(f"{name}.py")
            yield from site.glob(f"{name}.*.so")
            yield from site.glob(f"__pycache__/{name}.*.pyc")


def loaded(package: str) -> list[ModuleType]:
    """The package and its modules, as far as they are imported now."""
    return [module for name, module in sorted(sys.modules.items()) if f"{name}.".startswith(f"{package}.")]


def linked(files: Iterable[Path]) -> Iterator[Path]:
    """Every shared library that programs and libraries are linked with."""
    said = subprocess.run(["ldd", *files], capture_output=True, text=True, check=False).stdout
    yield from (Path(name) for name in sorted(set(re.findall(r"(/\S+) \(0x", said))))


def steps(path: Path) -> Iterator[Path]:
    """The path, and every folder and link on the way to it."""
    there = Path("/")
    for position, part in enumerate(path.parts[1:], 2):
        there = Path(os.path.normpath(there / part))
        yield there
        if there.is_symlink():
            yield from steps(Path(os.path.normpath(there.parent / there.readlink()), *path.parts[position:]))
            return


def main() -> None:
    """Write all names."""
    sys.path.insert(0, str(CHECKOUT))
    for module in IMPORTED:
        importlib.import_module(module)
    ip = shutil.which("ip")
    assert ip is not None
    files = [Path(sys.executable), Path(sys.prefix, "pyvenv.cfg"), Path(ip)]
    files += [Path(module.__file__) for module in loaded("tests") if module.__file__ is not None]
    files += tree(Path(sysconfig.get_path("stdlib")))
    files += packages()
    for folder in ("vve_sumo", "vehicles", "tests/vm"):
        files += tree(CHECKOUT / folder)
    programs = [file for file in files if file in (Path(sys.executable), Path(ip)) or ".so" in file.suffixes]
    names = {str(step) for file in [*files, *linked(programs)] if file.exists() for step in steps(file)}
    sys.stdout.write("".join(f"{name}\0" for name in sorted(names)))


if __name__ == "__main__":
    main()
