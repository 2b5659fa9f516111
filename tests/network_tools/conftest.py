"""Linden's network, as in the tests of the street."""

from tests.world.conftest import linden, reference

__all__ = ["linden", "reference"]
