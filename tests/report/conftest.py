"""What the tests of the report's page share: folders with their reports, and a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser import chromium
from tests.once import once
from tests.report.made import Folders, cut_short, driven, spoiled, swept
from vve_sumo.report import write_report


@pytest.fixture(scope="package")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    def make(above: Path) -> None:
        drive = driven(tmp_path_factory, above / "drive")
        cut_short(drive, above / "killed")
        swept(above / "sweep")
        spoiled(drive, above / "hostile")
        for name in Folders._fields:
            write_report(above / name)

    above = once(tmp_path_factory, "reports", make)
    return Folders(*(above / name for name in Folders._fields))


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    yield from chromium()
