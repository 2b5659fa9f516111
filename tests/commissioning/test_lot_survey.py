"""A recorded walk becomes the table [lot] of a rig, with a margin for what nobody knows better."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pyproj
import pytest

from tests.live.command_line import own_rig
from tests.lot.test_survey import YARD, walk
from vve_sumo.cli import dispatch
from vve_sumo.rig import load as rigs

PLACE = (40.0041, -83.0186)


def recording(folder: Path, places, name: str = "walk.csv", begin: float = 1.4e9) -> Path:
    """A walk at 2 m/s, of places in metres from PLACE on a map that the program does not use."""
    flat = pyproj.Proj(f"+proj=aeqd +lat_0={PLACE[0]} +lon_0={PLACE[1]} +datum=WGS84")
    rows = ["time_s,latitude_deg,longitude_deg,heading_deg,speed_mps"]
    for number, (x, y) in enumerate(places.tolist()):
        longitude, latitude = flat(x, y, inverse=True)
        rows.append(f"{begin + 0.2 * number},{latitude:.10f},{longitude:.10f},0.0,2.0")
    file = folder / name
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return file


def test_the_table_is_that_of_a_rig(tmp_path: Path, capsys) -> None:
    file = recording(tmp_path, walk(YARD, 33.0))
    assert dispatch.main(["lot", "survey", str(file), "--accuracy", "0.03"]) == 0
    said = capsys.readouterr().out
    lot = tomllib.loads(said[said.index("[lot]") :])["lot"]
    assert lot["surveyed"].isoformat() == "2024-05-17"  # 16203 days after 1980-01-06
    assert lot["margin_m"] == pytest.approx(1.0 + 2.448 * 0.03, abs=0.06)
    flat = pyproj.Proj(f"+proj=aeqd +lat_0={PLACE[0]} +lon_0={PLACE[1]} +datum=WGS84")
    corners = [flat(longitude, latitude) for latitude, longitude in lot["outline"]]
    assert max(min(math.dist(true, one) for one in corners) for true in YARD) < 0.02
    assert "4 corners around 1" in said


def test_it_is_written_into_a_rig_and_no_margin_gets_smaller(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    text = own_rig(tmp_path).read_text(encoding="utf-8")
    begin, end = text.index("holes = ["), text.index("[alignment]")
    start = ("latitude_deg = 40.0041\nlongitude_deg = -83.0186", "latitude_deg = 40.0043\nlongitude_deg = -83.0180")
    rig = tmp_path / "mine.toml"
    for margin, kept in ((0.5, 1.1), (3.0, 3.0)):
        changed = (text[:begin] + text[end:]).replace(*start).replace("margin_m = 1.0", f"margin_m = {margin}")
        rig.write_text(changed, encoding="utf-8")
        file = recording(tmp_path, walk(YARD))
        assert dispatch.main(["lot", "survey", str(file), "--accuracy", "0.03", "--rig", "./mine.toml", "--write"]) == 0
        lot = rigs.load(rig).lot
        assert len(lot.outline) == 4
        assert lot.margin_m == pytest.approx(kept, abs=0.06)
        assert "made up, like the lot" not in str(lot.surveyed)
    assert "stored in" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "places", "words"),
    [
        (["--accuracy", "0.03"], walk(YARD, closed=False), "walk.csv: the outline is open"),
        (["--accuracy", "0.03"], walk([YARD[0], YARD[2], YARD[1], YARD[3]]), "crosses or touches itself"),
        ([], walk(YARD), "give --accuracy"),
        (["--accuracy", "-1"], walk(YARD), "--accuracy: expected more than 0 m"),
        (["--accuracy", "0.03", "--write"], walk(YARD), "expected both or neither"),
    ],
)
def test_what_is_no_survey_is_one_line(options: list[str], places, words: str, tmp_path: Path, capsys) -> None:
    assert dispatch.main(["lot", "survey", str(recording(tmp_path, places)), *options]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert len(said.err.strip().splitlines()) == 1
    assert said.out == ""
