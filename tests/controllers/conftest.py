"""Loads the shipped controllers the way a drive does."""

from __future__ import annotations

import pytest

from tests.controllers.street import FUSION
from vve_sumo.controller import load, module


@pytest.fixture
def make(repository):
    """Make the shipped controller with some tuning."""
    return lambda **tuning: load("follow_and_stop", FUSION, tuning, [repository / "controllers"])


@pytest.fixture(scope="session")
def part(repository):
    """Import one of the shipped files."""
    return lambda name: module(name, [repository / "controllers"])
