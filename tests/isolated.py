"""Runs a function in a process of its own, so that a native crash is one red test and not a dead pytest."""

from __future__ import annotations

import multiprocessing
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, TypeVar

Result = TypeVar("Result")


class IsolatedError(AssertionError):
    """The function raised, hung or died in its own process."""


def _call(pipe: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        pipe.send((True, function(*arguments)))
    except BaseException:
        pipe.send((False, traceback.format_exc()))


def isolated(function: Callable[..., Result], *arguments: Any, timeout: float = 300.0) -> Result:
    """Return what the module-level `function` returns when called in a freshly spawned process.

    Raises IsolatedError with the child's traceback, its exit code, or the time-out in seconds.
    """
    context = multiprocessing.get_context("spawn")
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
