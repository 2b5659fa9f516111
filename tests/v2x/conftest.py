"""What several tests of V2X messages share."""

from __future__ import annotations

from types import ModuleType

import pytest

from tests.v2x.pycrate_release2 import compiled


@pytest.fixture(scope="session")
def release2(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """ETSI's release 2, as pycrate compiles it."""
    return compiled(tmp_path_factory)
