"""A ride without faults, which the rides with one are compared with."""

from __future__ import annotations

import pytest

from tests.plant.faulty_ride import Ride


@pytest.fixture(scope="session")
def plain() -> Ride:
    return Ride()
