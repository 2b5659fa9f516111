"""What the tests of the report's page share: folders with their reports, and a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser import chromium
from tests.isolated import isolated
from tests.report.made import Folders, cut_short, drive, spoiled, swept
from vve_sumo.report import write_report


@pytest.fixture(scope="package")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    above = tmp_path_factory.mktemp("reports")
    isolated(drive, str(above / "drive"))
    told = Folders(
        above / "drive",
        cut_short(above / "drive", above / "killed"),
        swept(above / "sweep"),
        spoiled(above / "drive", above / "hostile"),
    )
    for folder in told:
        write_report(folder)
    return told


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    yield from chromium()
