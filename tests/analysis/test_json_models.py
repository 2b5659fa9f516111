"""Files that are JSON and not what a drive, a sweep or a search writes: one line that names file and key."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from tests.analysis.made import write
from vve_sumo.analysis import json_models
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError

GONE = object()
SUMMARY = {"outcome": "stopped", "stop_gap_m": None, "min_gap_m": 2.0, "passed": True, "failed": []}
SWEEP: dict[str, Any] = {
    "spec": {"seeds": [1, 2], "search": {"along": "gap"}},
    "table": {"title": "t", "criteria": {"stop_gap_m": {"min": 1.0}}, "parameters": {"gap": {"sets": ["a.b_m"]}}},
    "files_sha256": {"network": ["0"]},
    "versions": {"vve-sumo": "0"},
}
FLIP = {"meets": 1.0, "fails": 2, "key_fails": "0", "why": "x"}
FOUND: dict[str, Any] = {
    "search": "boundary",
    "along": "gap",
    "criterion": "passed",
    "boundaries": [{"values": {}, "meets_first": True, "flips": [FLIP], "seeds": [{"seed": 1, "flips": [FLIP]}]}],
}
CASE = {"values": {}, "seed": 1, "ttc_s": 1.0, "outcome": None, "passed": None, "failed": None, "key": "0"}
WORST: dict[str, Any] = {"search": "worst", "lowest": "ttc_s", "worst": CASE}


def changed(content: dict[str, Any], place: str, value: object) -> dict[str, Any]:
    """Return the content with another value at a dotted place, or without that place."""
    other = copy.deepcopy(content)
    *way, last = place.split(".")
    inner: Any = other
    for part in way:
        inner = inner[int(part) if isinstance(inner, list) else part]
    inner[last] = value
    if value is GONE:
        del inner[last]
    return other


@pytest.mark.parametrize(
    ("file", "place", "value"),
    [
        ("scenario.json", "scenario", GONE),
        ("scenario.json", "period_s", 0.0),
        ("scenario.json", "path_m", ["1.0 2.0", "here there"]),
        ("scenario.json", "vehicle.length", GONE),
        ("scenario.json", "files_sha256", GONE),
        ("scenario.json", "versions", {"numpy": None}),
        ("scenario.json", "settings", None),
        ("scenario.json", "settings.controller.name", GONE),
        ("scenario.json", "settings.radar", GONE),
        ("scenario.json", "settings.criteria", {"stop_gap_m": [1.0]}),
        ("scenario.json", "settings.parameters", {"speed": {"sets": []}}),
        ("scenario.json", "settings.road", 5),
        ("scenario.json", "rig", {"latency": {"budget_ms": "40"}}),
        ("summary.json", "stop_gap_m", "near"),
        ("summary.json", "failed", "all of it"),
        ("summary.json", "passed", "no"),
    ],
)
def test_a_record_of_another_shape_is_one_line(tmp_path: Path, file: str, place: str, value: object) -> None:
    folder = write(tmp_path / "record", [{}], SUMMARY)
    Run(folder)
    content = json.loads((folder / file).read_text(encoding="utf-8"))
    (folder / file).write_text(json.dumps(changed(content, place, value)), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        Run(folder)
    assert str(refused.value).startswith(f"{folder / file}: ")
    assert place in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("model", "content", "place", "value"),
    [
        (json_models.SweepModel, SWEEP, "spec.seeds", None),
        (json_models.SweepModel, SWEEP, "spec.search", {}),
        (json_models.SweepModel, SWEEP, "spec.parameters", 5),
        (json_models.SweepModel, SWEEP, "table.parameters.gap.sets", GONE),
        (json_models.SweepModel, SWEEP, "table.criteria.stop_gap_m", {"min": "x"}),
        (json_models.SweepModel, SWEEP, "files_sha256.network", "0"),
        (json_models.Boundaries, FOUND, "along", GONE),
        (json_models.Boundaries, FOUND, "boundaries.0.seeds.0.flips.0.key_fails", GONE),
        (json_models.SearchModel, WORST, "worst", GONE),
        (json_models.SearchModel, WORST, "lowest", GONE),
        (json_models.SearchModel, WORST, "worst.ttc_s", GONE),
    ],
)
def test_a_sweep_and_a_search_of_another_shape_are_one_line(
    model: type[json_models.JsonModel], content: dict[str, Any], place: str, value: object
) -> None:
    json_models.check(content, model, Path("x.json"))
    with pytest.raises(ConfigError, match=r"^x\.json: [^\n]*$"):
        json_models.check(changed(content, place, value), model, Path("x.json"))
