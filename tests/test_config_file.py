"""Files that a user edits: whatever stands in them, they are loaded or refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.errors import ConfigError
from vve_sumo.rig import load as rigs
from vve_sumo.scenario import load as scenarios
from vve_sumo.vehicle import load as vehicles


@pytest.mark.parametrize("load", [rigs.load, scenarios.load, vehicles.load])
@given(data=st.binary(max_size=200))
def test_whatever_a_file_holds_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, load: Callable[[Path], Any], data: bytes
) -> None:
    file = tmp_path_factory.mktemp("any") / "x.toml"
    file.write_bytes(data)
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert "\n" not in str(caught.value)
