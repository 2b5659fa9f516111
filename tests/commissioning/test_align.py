"""Laying a path into a lot: known places found again by arithmetic of our own, bad surveys refused, cuts that pass."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from pathlib import Path

import matplotlib.image
import numpy as np
import pyproj
import pytest
import shapely

from tests import isolated
from tests.conftest import REPOSITORY
from tests.live.command_line import outline, own_rig, vve_sumo
from vve_sumo.commissioning import align, rig_checks
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.path_in_network import read_path
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.live import assembly
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning

CAR = (40.0041, -83.0186, 85.0)  #: where the simulated rig's car stands
ORIGIN = (40.004325, -83.024514)  #: first corner of its lot
EGO_PALE, ALARM = (86, 180, 233), (230, 159, 0)


def on_the_lot(latitude: float, longitude: float, origin: tuple[float, float] = ORIGIN) -> complex:
    """Metres from the lot's origin: an azimuthal equidistant map, which is not the one that the program uses."""
    place = pyproj.Proj(f"+proj=aeqd +lat_0={origin[0]} +lon_0={origin[1]} +datum=WGS84")
    return complex(*place(longitude, latitude))


def on_the_street(network: str = "linden") -> list[complex]:
    """The path's points on the virtual road's map, from the files alone."""
    head = (REPOSITORY / "networks" / f"{network}.net.xml").read_text(encoding="utf-8")[:20_000]
    offset = [float(number) for number in re.search(r'netOffset="([^"]*)"', head)[1].split(",")]
    street = pyproj.Proj(re.search(r'projParameter="([^"]*)"', head)[1])
    lines = (REPOSITORY / "routes" / "linden_17th.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if line[0].isdigit()]
    return [complex(*street(float(row[1]), float(row[0]))) + complex(*offset) for row in rows]


def stored(rig: Path) -> tuple[complex, complex]:
    """The stored turn, as a number of length one, and the shift."""
    kept = tomllib.loads(rig.read_text(encoding="utf-8"))["alignment"]
    assert kept["kind"] == "stored"
    assert kept["network"] == "linden"
    assert kept["origin"] == list(ORIGIN)
    return complex(np.exp(1j * math.radians(kept["rotation_deg"]))), complex(kept["x_m"], kept["y_m"])


@pytest.mark.thorough
@pytest.mark.live
def test_where_the_car_stands_becomes_the_start_of_the_path(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    run = vve_sumo("align", "seen_late", "--rig", str(rig), "--write", "--picture", "lot.png", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    turn, shift = stored(rig)
    path = on_the_street()
    # Noise of 1 cm that wanders, averaged; and the receiver sees the car 0.2 deg clockwise of where it looks.
    assert abs(turn * on_the_lot(*CAR[:2]) + shift - path[0]) < 0.06
    ahead = turn * np.exp(1j * math.radians(90.0 - CAR[2]))
    off = np.angle(ahead / (path[1] - path[0]))
    assert math.degrees(off) == pytest.approx(0.2, abs=0.1)
    assert float(re.search(r"within (\S+) m", run.stdout)[1]) < 0.1
    assert "fits" in run.stdout
    assert (tmp_path / "lot.png").exists()


@pytest.mark.live
def test_a_stored_alignment_is_the_one_that_was_found(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    rig = own_rig(tmp_path)
    site = align.site_of("seen_late", str(rig), tmp_path)
    result = align.matched(site)
    align.store(site, result, align.datetime.date(2026, 5, 1))
    loaded = rigs.load(rig)
    kept = meaning.alignment_of(loaded, "linden")
    frame = meaning.frame_of(loaded)
    assert frame.projection == meaning.frame_of(site.rig).projection
    assert (kept.rotation, kept.x, kept.y) == pytest.approx(
        (result.alignment.rotation, result.alignment.x, result.alignment.y), abs=1e-5
    )
    ground = LotAlignment(frame.projection, kept, 1.4e9)
    assert assembly.pipeline_of(site.resolved, loaded, ground, REPOSITORY) is not None
    with pytest.raises(ConfigError, match="made for 'linden'"):
        meaning.alignment_of(loaded, "proving_ground")


@pytest.mark.live
def test_nobody_at_the_keyboard_is_no_agreement(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    before = rig.read_text(encoding="utf-8")
    run = vve_sumo("align", "seen_late", "--rig", str(rig), cwd=tmp_path)
    assert run.returncode == 0
    assert "Press Enter to store" in run.stdout
    assert rig.read_text(encoding="utf-8") == before


TURN, SHIFT = complex(np.exp(0.7j)), 1900.0 + 1100.0j
PLACES = [(40.0043, -83.0240), (40.0040, -83.0180), (40.0052, -83.0175), (40.0050, -83.0235)]


def pairs_file(folder: Path, street: list[complex], names: tuple[str, str] = ("street_x_m", "street_y_m")) -> Path:
    rows = [[*place, there.real, there.imag] for place, there in zip(PLACES, street, strict=True)]
    file = folder / "pairs.csv"
    with file.open("w", newline="") as opened:
        csv.writer(opened).writerows([["lot_latitude_deg", "lot_longitude_deg", *names], *rows])
    return file


def true_places() -> list[complex]:
    return [TURN * on_the_lot(*place) + SHIFT for place in PLACES]


def found_by(folder: Path, file: Path) -> align.AlignmentResult:
    return align.paired(align.site_of("seen_late", str(own_rig(folder)), folder), file)


def test_surveyed_pairs_tell_a_known_turn_and_shift(tmp_path: Path) -> None:
    street = true_places()
    street[2] += 0.09
    result = found_by(tmp_path, pairs_file(tmp_path, street))
    # A quarter of the one error in the shift, and of its three quarters that are left most at its own pair.
    assert complex(np.exp(1j * result.alignment.rotation)) == pytest.approx(TURN, abs=3e-4)
    assert abs(complex(result.alignment.x, result.alignment.y) - SHIFT) < 0.15
    assert 0.03 < result.residual < 0.09
    said = "\n".join(result.evidence)
    off = [float(number) for number in re.findall(r"off by (\S+) m", said)]
    assert len(off) == 4
    assert max(off) == off[2]
    assert re.search(r"are 1\.000\d\d times", said)


def test_the_street_may_be_told_in_degrees(tmp_path: Path) -> None:
    head = (REPOSITORY / "networks" / "linden.net.xml").read_text(encoding="utf-8")[:20_000]
    offset = complex(*(float(number) for number in re.search(r'netOffset="([^"]*)"', head)[1].split(",")))
    street = pyproj.Proj(re.search(r'projParameter="([^"]*)"', head)[1])
    there = [place - offset for place in true_places()]
    degrees = [street(place.real, place.imag, inverse=True) for place in there]
    names = ("street_latitude_deg", "street_longitude_deg")
    result = found_by(tmp_path, pairs_file(tmp_path, [complex(b, a) for a, b in degrees], names))
    assert complex(np.exp(1j * result.alignment.rotation)) == pytest.approx(TURN, abs=1e-4)
    assert abs(complex(result.alignment.x, result.alignment.y) - SHIFT) < 0.02


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda street: [place.conjugate() for place in street], "mirrored"),
        (lambda street: [3.28084 * place for place in street], "3.28"),
        (lambda street: [*street[:3], street[3] + 0.9], "pair 4 is off by"),
        (lambda street: [street[0]] * 4, "on one spot"),
    ],
    ids=["mirrored", "in feet", "one is wrong", "one place"],
)
def test_bad_surveys_are_refused_in_one_line(change, words: str, tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    before = rig.read_text(encoding="utf-8")
    file = pairs_file(tmp_path, change(true_places()))
    run = isolated.command("align", "seen_late", "--rig", str(rig), "--pairs", str(file), "--write", cwd=tmp_path)
    assert run.returncode == 2
    assert len(run.stderr.strip().splitlines()) == 1
    assert words in run.stderr
    assert "pairs.csv" in run.stderr
    assert rig.read_text(encoding="utf-8") == before


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "expected a header"),
        ("lot_latitude_deg,lot_longitude_deg,street_x_m,street_y_m\n1,2,3\n", "line 2"),
        ("lot_latitude_deg,lot_longitude_deg,street_x_m,street_y_m\n1,2,3,nan\n", "line 2"),
        ("", "expected a header"),
    ],
)
def test_files_of_pairs_that_are_none_are_refused(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "pairs.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"pairs\.csv.*{words}"):
        found_by(tmp_path, file)


@pytest.mark.thorough
def test_a_search_in_the_twins_lot_fits_the_path(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    run = isolated.command(
        "align", "seen_late", "--rig", str(rig), "--fit", "--write", "--picture", "lot.png", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    loaded = rigs.load(rig)
    site = align.site_of("seen_late", str(rig), tmp_path)
    kept = meaning.alignment_of(loaded, "linden")
    assert meaning.geofence_of(loaded, kept).along(site.resolved.path, 11.176) is None
    # By other means: the path's points, brought back onto the lot, lie inside the corners and out of the holes.
    turn, shift = stored(rig)
    back = [(place - shift) / turn for place in on_the_street()]
    corners = [on_the_lot(*corner) for corner in loaded.lot.outline]
    holes = [[(p.real, p.imag) for p in (on_the_lot(*corner) for corner in hole)] for hole in loaded.lot.holes]
    lot = shapely.Polygon([(p.real, p.imag) for p in corners], holes)
    way = shapely.LineString([(p.real, p.imag) for p in back])
    assert lot.contains(way)
    room = float(re.search(r"fits, (\S+) m clear", run.stdout)[1])
    assert 10.0 < room < lot.boundary.distance(way) - loaded.lot.margin_m
    # Where to put the car: the first point of the path.
    latitude, longitude, heading = map(
        float, re.search(r"rear axle at (\S+), (\S+), heading (\S+) deg", run.stdout).groups()
    )
    assert abs(on_the_lot(latitude, longitude) - back[0]) < 0.02
    assert heading == pytest.approx(90.0 - math.degrees(np.angle(back[1] - back[0])), abs=0.1)
    assert shows(tmp_path / "lot.png", EGO_PALE)
    assert not shows(tmp_path / "lot.png", ALARM)


def shows(picture: Path, colour: tuple[int, int, int]) -> bool:
    """Whether more than a few points of a picture have exactly this colour."""
    pixels = np.round(255.0 * matplotlib.image.imread(picture)[..., :3]).astype(int)
    return int((np.abs(pixels - colour).sum(axis=2) <= 3).sum()) > 50


def runway(length: float, width: float = 24.0) -> tuple[str, str]:
    """The change of the simulated rig's lot to a strip to the east of where its car stands, in the middle of it."""
    metre = 1.0 / 111_035.0, 1.0 / (111_320.0 * math.cos(math.radians(CAR[0])))
    turn = np.exp(1j * math.radians(90.0 - CAR[2]))
    corners = [-6.0 - 0.5j * width, length - 6.0 - 0.5j * width, length - 6.0 + 0.5j * width, -6.0 + 0.5j * width]
    return outline(*((CAR[0] + (turn * c).imag * metre[0], CAR[1] + (turn * c).real * metre[1]) for c in corners))


#: the calibration drive with a corridor to the left, and its lot
CORRIDOR = "[[ego.corridor]]\nfrom_m = 60.0\nto_m = 100.0\nleft_m = {:.1f}\n\n[ego.lot]"


def with_corridor(folder: Path, left: float, text: str = CORRIDOR) -> Path:
    """The shipped calibration drive, on the first 120 m of its path, with a corridor of its own."""
    scenario = (REPOSITORY / "scenarios" / "calibration.toml").read_text(encoding="utf-8")
    lines = (REPOSITORY / "routes" / "proving_ground.csv").read_text(encoding="utf-8").splitlines()
    site = align.site_of("calibration", str(own_rig(folder, name="other")), folder)
    count = len([s for s in (piece.start for piece in site.resolved.path.segments) if s <= 120.0])
    first = next(number for number, line in enumerate(lines) if line[0].isdigit())
    (folder / "part.csv").write_text("\n".join(lines[: first + count]) + "\n", encoding="utf-8")
    file = folder / "beside.toml"
    path = f'path = "{folder / "part.csv"}"'
    changed = re.sub(r'path = "\w+"', path, scenario).replace("[ego.lot]", text.format(left))
    file.write_text(changed, encoding="utf-8")
    return file


def stored_in_the_middle(folder: Path, scenario: Path, width: float) -> Path:
    """A rig whose lot is a strip around the path of a scenario, which lies in its middle."""
    rig = own_rig(folder, runway(260.0, width))
    site = align.site_of(str(scenario), str(rig), folder)
    begin = site.resolved.path.at(0.0)
    heading = math.radians(90.0 - CAR[2])
    there = on_the_lot(*CAR[:2], site.rig.lot.outline[0])
    turn = begin.heading - heading
    shift = complex(begin.x, begin.y) - there * np.exp(1j * turn)
    found = align.AlignmentResult(Alignment(turn, shift.real, shift.imag), 0.0, None)
    align.store(site, found, align.datetime.date(2026, 5, 1))
    return rig


@pytest.mark.thorough
def test_a_corridor_that_does_not_fit_is_told_by_place_and_distance(tmp_path: Path) -> None:
    """The strip is 14 m wide: beyond its margin and half of the car there are 5.07 m to either side, less the drift."""
    scenario = with_corridor(tmp_path, 3.0)
    rig = stored_in_the_middle(tmp_path, scenario, 14.0)
    site = align.site_of(str(scenario), str(rig), tmp_path)
    alignment = meaning.alignment_of(site.rig, site.resolved.scenario.road.network)
    assert alignment is not None
    drift = 0.16 * 2.0 + 0.002 * 100.0  # of the lot's page, at 100 m
    for left, fits in ((3.0, True), (4.9, False), (7.0, False)):
        site = align.site_of(str(with_corridor(tmp_path, left)), str(rig), tmp_path)
        result = align.AlignmentResult(alignment, 0.0, site.fits(alignment))
        said = "\n".join(align.description(site, result))
        check = rig_checks._in_the_lot(site.rig, site.resolved, alignment)
        assert "with its corridor" in said
        if fits:
            assert result.whole
            assert "with its corridor: fits" in said
            assert check.finding is CheckResult.GO
            assert check.observed.startswith("fits with its corridor")
            continue
        assert not result.whole
        assert check.finding is CheckResult.NO_GO
        at, aside, over = map(
            float, re.search(r"at (\S+) m, from (\S+) m left of the path, a stop reaches (\S+) m over", said).groups()
        )
        assert 60.0 <= at <= 100.0
        assert aside == left
        assert over == pytest.approx(left + drift - 5.07, abs=0.6)
        assert check.observed in said
        assert "declare a narrower corridor" in check.advice


@pytest.mark.thorough
def test_a_search_gives_the_corridor_its_room(tmp_path: Path) -> None:
    scenario, rig = with_corridor(tmp_path, 7.0), own_rig(tmp_path, runway(260.0, 20.0))
    run = isolated.command(
        "align", str(scenario), "--rig", str(rig), "--fit", "--write", "--picture", "lot.png", cwd=tmp_path
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "with its corridor: fits" in run.stdout
    assert shows(tmp_path / "lot.png", EGO_PALE)
    assert not shows(tmp_path / "lot.png", ALARM)
    # By other means: the corridor's four corners, brought back onto the lot, and the car beside them.
    loaded, site = rigs.load(rig), align.site_of(str(scenario), str(rig), tmp_path)
    kept = tomllib.loads(rig.read_text(encoding="utf-8"))["alignment"]
    turn, shift = np.exp(1j * math.radians(kept["rotation_deg"])), complex(kept["x_m"], kept["y_m"])
    corners = [on_the_lot(*corner, kept["origin"]) for corner in loaded.lot.outline]
    lot = shapely.Polygon([(p.real, p.imag) for p in corners])
    for s in (60.0, 80.0, 100.0):
        point = site.resolved.path.at(s)
        for d in (-0.926, 0.0, 7.926):
            place = complex(point.x, point.y) + 1j * d * np.exp(1j * point.heading)
            back = (place - shift) / turn
            assert shapely.Point(back.real, back.imag).within(lot.buffer(-loaded.lot.margin_m))


def test_a_corridor_beyond_the_path_is_refused(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    file = with_corridor(tmp_path, 3.0, CORRIDOR.replace("100.0", "1000.0"))
    run = isolated.command("align", str(file), "--rig", str(rig), "--fit", cwd=tmp_path)
    assert run.returncode == 2
    assert re.search(r"beside\.toml: ego\.corridor\.0\.to_m: 1000 lies beyond the path's 1\S+ m", run.stderr)


@pytest.mark.slow
def test_a_path_too_long_is_cut_where_it_still_fits(tmp_path: Path) -> None:
    rig = own_rig(tmp_path, runway(160.0))
    options = ("--fit", "--picture", "lot.png", "--write-shortened-path", "short.csv", "--write")
    run = isolated.command("align", "calibration", "--rig", str(rig), *options, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert shows(tmp_path / "lot.png", ALARM)
    last_s = float(re.search(r"from (\S+) m on, the car could not stop", run.stdout)[1])
    # 160 m less margins, the car, and the fallback path from 8 m/s at 2.4 m/s2 with what comes before it.
    assert 100.0 < last_s < 160.0 - 2.0 - 4.9 - 8.0**2 / (2.0 * 2.5)
    loaded, site = rigs.load(rig), align.site_of("calibration", str(rig), tmp_path)
    path, route, _lanes = read_path(tmp_path / "short.csv", site.resolved.map_frame, site.resolved.network)
    assert last_s - 3.0 < path.length <= last_s + 0.5
    assert route == site.resolved.route
    start, whole = path.at(0.0), site.resolved.path.at(0.0)
    assert (start.x, start.y) == pytest.approx((whole.x, whole.y), abs=1e-3)
    kept = meaning.alignment_of(loaded, "proving_ground")
    assert meaning.geofence_of(loaded, kept).along(path, 8.0) is None
    assert meaning.geofence_of(loaded, kept).along(site.resolved.path, 8.0) == pytest.approx(last_s, abs=3.0)


@pytest.mark.live
def test_a_place_where_the_path_does_not_fit_is_not_stored(tmp_path: Path) -> None:
    rig = own_rig(tmp_path, runway(160.0))
    before = rig.read_text(encoding="utf-8")
    run = vve_sumo("align", "calibration", "--rig", str(rig), "--write", cwd=tmp_path)
    assert run.returncode == 3
    assert "--fit" in run.stderr
    assert rig.read_text(encoding="utf-8") == before


def test_a_shipped_rig_is_not_written_from_elsewhere(tmp_path: Path, monkeypatch) -> None:
    shipped = REPOSITORY / "rigs" / "simulated.toml"
    before = shipped.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    site = align.site_of("seen_late", "simulated", tmp_path)
    try:
        with pytest.raises(ConfigError, match="vve-sumo init"):
            align.store(site, align.AlignmentResult(Alignment(), 0.0, None), align.datetime.date(2026, 5, 1))
        assert shipped.read_text(encoding="utf-8") == before
    finally:
        shipped.write_text(before, encoding="utf-8")


def test_a_scenario_too_fast_for_the_lot_names_both(tmp_path: Path) -> None:
    rig = own_rig(tmp_path, ("speed_mps = 12.0", "speed_mps = 5.0"))
    run = isolated.command("align", "seen_late", "--rig", str(rig), "--fit", cwd=tmp_path)
    assert run.returncode == 2
    assert "seen_late.toml: ego.speed_mps" in run.stderr
    assert "limits.speed_mps" in run.stderr


def test_a_cut_without_a_search_is_refused(tmp_path: Path) -> None:
    run = isolated.command(
        "align", "--rig", str(own_rig(tmp_path)), "--write-shortened-path", "short.csv", cwd=tmp_path
    )
    assert run.returncode == 2
    assert "--fit" in run.stderr
