"""What the tests of the pages in a browser share: records of their own, and the browser of the report's tests."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.browser import chromium
from tests.isolated import isolated
from tests.once import once
from tests.report.made import driven, spoiled, swept
from tests.view.made import Made, traffic
from vve_sumo.view.server import PageServer, replay_server


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    yield from chromium()


@pytest.fixture(scope="package")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    above = tmp_path_factory.mktemp("viewed")
    shutil.copytree(
        once(tmp_path_factory, "traffic_drive", lambda record: isolated(traffic, str(record))), above / "traffic"
    )
    drive = driven(tmp_path_factory, above / "drive")
    return Made(drive, above / "traffic", swept(above / "sweep"), spoiled(drive, above / "hostile"))


@contextmanager
def serving(server: PageServer) -> Iterator[PageServer]:
    """Serve in a thread until the end of the block."""
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.close()
        thread.join(10.0)
        assert not thread.is_alive()


@pytest.fixture(scope="package")
def replay(made: Made) -> Iterator[PageServer]:
    """The page of the drive through traffic."""
    with serving(replay_server([Path(made.traffic)])) as server:
        yield server


@pytest.fixture
def copied() -> Callable[[Path, Path], None]:
    """What copies a folder."""

    def copy(source: Path, target: Path) -> None:
        shutil.copytree(source, target)

    return copy


def holds(page: Any, condition: str) -> bool:
    """Return whether a JavaScript condition holds on a page now.

    Waiting is the caller's: the page's policy forbids what Playwright's own waiting evaluates again.
    """
    return bool(page.evaluate(f"() => Boolean({condition})"))
