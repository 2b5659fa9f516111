"""What is made once in a session is made by one of the processes that want it, and anew where that failed."""

from __future__ import annotations

import time
from multiprocessing import get_context
from pathlib import Path

import pytest

from tests.once import once


def slowly(folder: Path) -> None:
    """Make a folder that says how often it was made."""
    folder.mkdir()
    with (folder.parent / "count").open("a") as file:
        file.write("made\n")
    time.sleep(0.2)
    (folder / "whole").touch()


def wants(factory: pytest.TempPathFactory, name: str) -> None:
    assert (once(factory, name, slowly) / "whole").exists()


def test_of_processes_that_want_it_one_makes_it(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> None:
    name = request.node.name
    tmp_path_factory.getbasetemp()  # each worker of a session has made its own before it wants anything
    context = get_context("fork")
    several = [context.Process(target=wants, args=(tmp_path_factory, name)) for _ in range(3)]
    for process in several:
        process.start()
    for process in several:
        process.join()
    assert [process.exitcode for process in several] == [0, 0, 0]
    assert (once(tmp_path_factory, name, slowly).parent / "count").read_text() == "made\n"


def test_what_failed_half_way_is_made_anew(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> None:
    def half(folder: Path) -> None:
        folder.mkdir()
        (folder / "half").touch()
        raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        once(tmp_path_factory, request.node.name, half)
    folder = once(tmp_path_factory, request.node.name, lambda folder: folder.mkdir())
    assert list(folder.iterdir()) == []
