"""Parts of paths lie on the whole one, are as long as asked, and parts that are none are refused in one line."""

from __future__ import annotations

import math
from pathlib import Path

import pyproj
import pytest
from shapely.geometry import LineString, Point

from vve_sumo.cli import dispatch
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.path_file import cut_path

REPOSITORY = Path(__file__).parents[2]
WHOLE = REPOSITORY / "routes" / "linden_17th.csv"


def places(file: Path) -> list[tuple[float, float]]:
    """The file's points on a map that the program does not use [m]."""
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines() if line[0].isdigit()]
    flat = pyproj.Proj("+proj=aeqd +lat_0=40.0011 +lon_0=-82.9706 +datum=WGS84")
    return [flat(float(longitude), float(latitude)) for latitude, longitude in rows]


def test_a_part_lies_on_the_whole_and_is_as_long_as_asked(tmp_path: Path) -> None:
    out = tmp_path / "part.csv"
    part = cut_path(WHOLE, 540.0, 660.5, out)
    whole, cut = LineString(places(WHOLE)), LineString(places(out))
    assert part.length == pytest.approx(120.5, abs=2e-3)
    # A plane through points a metre apart cuts bends by less than a millimetre a metre.
    assert cut.length == pytest.approx(120.5, abs=0.1)
    assert whole.project(Point(cut.coords[0])) == pytest.approx(540.0, abs=0.15)
    assert whole.project(Point(cut.coords[-1])) == pytest.approx(660.5, abs=0.15)
    assert max(whole.distance(Point(point)) for point in cut.coords) < 0.01
    text = out.read_text(encoding="utf-8")
    assert "OpenStreetMap contributors" in text
    assert "# edges: -21405924#2" in text
    assert "Metres 540 to 660.5 of linden_17th.csv" in text


def test_a_part_of_a_part_is_the_part(tmp_path: Path) -> None:
    cut_path(WHOLE, 500.0, 700.0, tmp_path / "one.csv")
    cut_path(tmp_path / "one.csv", 40.0, 160.0, tmp_path / "two.csv")
    cut_path(WHOLE, 540.0, 660.0, tmp_path / "once.csv")
    twice, once = places(tmp_path / "two.csv"), places(tmp_path / "once.csv")
    assert len(twice) == len(once) == 121
    assert max(map(math.dist, twice, once)) < 0.02


@pytest.mark.parametrize(
    ("begin", "end", "words"),
    [
        (-1.0, 50.0, "--from -1: expected 0 to the path's length, 8"),
        (0.0, 5000.0, "--to 5000: expected 0 to the path's length, 8"),
        (math.nan, 50.0, "--from nan: expected"),
        (50.0, 50.0, "less than 5 m beyond"),
        (60.0, 50.0, "less than 5 m beyond"),
    ],
)
def test_parts_that_are_none_are_refused(begin: float, end: float, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        cut_path(WHOLE, begin, end, tmp_path / "part.csv")
    assert "linden_17th.csv" in str(refused.value)
    assert not list(tmp_path.iterdir())


def test_the_source_is_not_overwritten(tmp_path: Path) -> None:
    source = tmp_path / "own.csv"
    source.write_bytes(WHOLE.read_bytes())
    with pytest.raises(ConfigError, match="is the path itself"):
        cut_path(source, 10.0, 50.0, tmp_path / "." / "own.csv")
    assert source.read_bytes() == WHOLE.read_bytes()


def test_the_command_says_what_it_wrote_or_refused(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert dispatch.main(["path", "cut", "linden_17th", "--from", "540", "--to", "660", "--out", "part.csv"]) == 0
    assert "120.00 m of linden_17th.csv written to part.csv" in capsys.readouterr().out
    assert dispatch.main(["path", "cut", "linden_17th", "--from", "540", "--to", "6600", "--out", "no.csv"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not Path("no.csv").exists()
    assert dispatch.main(["path", "cut", "linden_17th", "--from", "5", "--to", "60", "--out", "no/no.csv"]) == 2
