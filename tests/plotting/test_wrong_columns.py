"""A column that is not there, or that holds texts, is one line that names it and those that exist."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from vve_sumo import plotting
from vve_sumo.errors import ConfigError

ROWS = pd.DataFrame(
    {
        "speed": [5.0, 5.0, 9.0, 9.0],
        "delay": [0.0, 0.1, 0.0, 0.1],
        "stop_gap_m": [5.0, 4.9, 4.8, 4.7],
        "outcome": ["stopped"] * 4,
        "collision": [False] * 4,
        "passed": [True] * 4,
        "error": [""] * 4,
        "seed": [1] * 4,
    }
)
PLOTS: list[tuple[Callable[..., Any], dict[str, str]]] = [
    (plotting.heat_map, {"x": "speed", "y": "delay", "figure": "stop_gap_m"}),
    (plotting.distribution, {"figure": "stop_gap_m", "by": "speed"}),
    (plotting.response, {"x": "speed", "figure": "stop_gap_m", "by": "delay"}),
    (plotting.gap_against_speed, {"by": "delay", "facet": "delay"}),
    (plotting.stopping_distance, {"by": "delay", "facet": "delay"}),
]


@pytest.mark.parametrize(
    ("plot", "asked", "wrong"),
    [pytest.param(plot, asked, key, id=f"{plot.__name__}-{key}") for plot, asked in PLOTS for key in asked],
)
def test_a_column_that_is_not_there_is_named_with_those_that_are(
    plot: Callable[..., Any], asked: dict[str, str], wrong: str
) -> None:
    rows = ROWS.assign(max_speed_mps=ROWS["speed"], stop_onset_speed_mps=ROWS["speed"], stop_distance_m=ROWS["speed"])
    with pytest.raises(ConfigError) as raised:
        plot(rows, **asked | {wrong: "nowhere"})
    assert "nowhere" in str(raised.value)
    assert "stop_gap_m" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("plot", [plotting.heat_map, plotting.distribution, plotting.response])
def test_a_figure_of_texts_is_named_with_those_of_numbers(plot: Callable[..., Any]) -> None:
    asked = next(asked for one, asked in PLOTS if one is plot)
    with pytest.raises(ConfigError, match="'outcome' holds texts, expected one of numbers; there are speed, delay"):
        plot(ROWS, **asked | {"figure": "outcome"})
