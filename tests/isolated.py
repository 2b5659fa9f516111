"""Runs a function in a process of its own, so that a native crash is one red test and not a dead pytest.

The process is forked from a server that has imported SUMO and the drive and nothing else has happened in: what takes a
second to import is imported once. What must differ between processes (hash seeds) needs a fresh one: test_determinism.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any, TypeVar

import pytest

Result = TypeVar("Result")
REPOSITORY = Path(__file__).parent.parent
#: of the server, or forking would not be safe
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "JE_ARROW_MALLOC_CONF": "background_thread:false",
}
#: the module that it imports first
WARM = "tests.warm"


class IsolatedError(AssertionError):
    """The function raised, hung or died in its own process."""


def _call(pipe: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        pipe.send((True, function(*arguments)))
    except BaseException:
        pipe.send((False, traceback.format_exc()))


def _server() -> ForkServerContext:
    """Return the context whose processes are forked from the warm server, which is started on first use."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([WARM])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(REPOSITORY)
        for name, value in ONE_THREAD.items():
            patch.setenv(name, value)
        forkserver.ensure_running()
    return context


def isolated(function: Callable[..., Result], *arguments: Any, timeout: float = 300.0) -> Result:
    """Return what the module-level `function` returns when called in a process of its own.

    Raises IsolatedError with the child's traceback, its exit code, or the time-out in seconds.
    """
    context = _server()
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_call, args=(there, function, arguments))
    child.start()
    there.close()
    try:
        if not here.poll(timeout):
            raise IsolatedError(f"{function.__name__} gave no answer within {timeout} s")
        good, answer = here.recv()
    except EOFError:
        child.join(10.0)
        raise IsolatedError(f"{function.__name__} died with exit code {child.exitcode}") from None
    finally:
        child.kill()
        child.join(10.0)
    if not good:
        raise IsolatedError(answer)
    return answer  # type: ignore[no-any-return]


def _be_the_command(arguments: tuple[str, ...], folder: str) -> tuple[int, str, str]:
    from vve_sumo.cli import main

    os.chdir(folder)
    os.environ.clear()
    os.environ.update({"PATH": "/usr/bin:/bin", "PYTHONPATH": str(REPOSITORY), "HOME": folder})
    sys.argv = ["vve-sumo", *arguments]
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        os.dup2(sys.stdin.fileno(), 0)
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        try:
            code: Any = main(list(arguments))
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
        sys.stderr.flush()
        out.seek(0)
        err.seek(0)
        return int(code or 0), out.read(), err.read()


def command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `vve-sumo` in a folder; nobody is at its keyboard, and it need not import anything first."""
    return subprocess.CompletedProcess(arguments, *isolated(_be_the_command, arguments, str(cwd)))
