"""Linden's network, for every test of this room."""

from __future__ import annotations

from pathlib import Path

import pytest
import sumolib


@pytest.fixture(scope="session")
def linden(repository: Path) -> Path:
    return repository / "networks" / "linden.net.xml"


@pytest.fixture(scope="session")
def reference(linden: Path):
    """The network as sumolib reads it."""
    return sumolib.net.readNet(str(linden), withInternal=True)
