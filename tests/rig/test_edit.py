"""Writing into rig files: what was not meant stays to the letter, what would not load is not written."""

from __future__ import annotations

import datetime
import tomllib
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.rig import edit

SIMULATED = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
DAY = datetime.date(2026, 5, 1)
STORED = {
    "kind": "stored",
    "network": "linden",
    "date": DAY,
    "origin": [40.004325, -83.024514],
    "rotation_deg": 171.5,
    "x_m": 1875.5,
    "y_m": 1078.25,
    "residual_m": 0.03,
}


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    file = tmp_path / "mine.toml"
    file.write_text(SIMULATED, encoding="utf-8")
    file.chmod(0o640)
    return file


def test_what_is_set_is_set_and_all_else_stays(rig: Path) -> None:
    loaded = edit.put(rig, {("alignment", key): value for key, value in STORED.items()}, emptied=("alignment",))
    text = rig.read_text(encoding="utf-8")
    assert tomllib.loads(text) == tomllib.loads(SIMULATED) | {"alignment": STORED}
    assert loaded.alignment.rotation_deg == 171.5
    kept = [line for line in SIMULATED.splitlines() if line != 'kind = "matched_start"']
    left = text.splitlines()
    assert [line for line in kept if line not in left] == []
    assert rig.stat().st_mode & 0o777 == 0o640
    assert list(rig.parent.iterdir()) == [rig]


def test_a_table_that_is_emptied_loses_what_is_not_set_again(rig: Path) -> None:
    edit.put(rig, {("alignment", key): value for key, value in STORED.items()}, emptied=("alignment",))
    edit.put(rig, {("alignment", "kind"): "matched_start"}, emptied=("alignment",))
    assert tomllib.loads(rig.read_text(encoding="utf-8")) == tomllib.loads(SIMULATED)


def test_a_table_that_is_missing_is_made(rig: Path) -> None:
    rig.write_text(SIMULATED.replace('[alignment]\nkind = "matched_start"\n', ""), encoding="utf-8")
    edit.put(rig, {("alignment", key): value for key, value in STORED.items()})
    assert tomllib.loads(rig.read_text(encoding="utf-8"))["alignment"] == STORED


@pytest.mark.parametrize("wrong", [{"kind": "stored"}, {"kind": "stored", "residual_m": 3.0}], ids=["missing", "range"])
def test_what_would_not_load_is_not_written(rig: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=r"mine\.toml: alignment"):
        edit.put(rig, {("alignment", key): value for key, value in (STORED | wrong).items() if key != "x_m"})
    assert rig.read_text(encoding="utf-8") == SIMULATED


def test_a_folder_that_takes_no_file_is_one_line() -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        edit.put(Path("/proc/nowhere.toml"), {("limits", "speed_mps"): 3.0})


def test_a_link_stays_a_link(rig: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.toml"
    link.symlink_to(rig)
    edit.put(link, {("limits", "speed_mps"): 3.0})
    assert link.is_symlink()
    assert tomllib.loads(rig.read_text(encoding="utf-8"))["limits"]["speed_mps"] == 3.0
