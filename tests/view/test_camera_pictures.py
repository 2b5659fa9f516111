"""Pictures of a declared camera and their truth, in a real browser, against rays and outlines computed here."""

from __future__ import annotations

import io
import json
import math
import threading
import urllib.request
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.view.made import Made
from tests.view.spaces import frame, standing, straight
from vve_sumo.analysis.run import Run
from vve_sumo.cli import main
from vve_sumo.view.browser import BrowserError, find_browser
from vve_sumo.view.camera_pictures import PIXEL_KINDS, CameraPictures, SceneAppearance, Truth, boxes_of
from vve_sumo.view.declared_camera import CameraFile, DeclaredCamera
from vve_sumo.view.mjpeg import MjpegServer

Points = NDArray[np.float64]

BARE = SceneAppearance(dressed=False)
CAR = {"kind": "car", "length": 4.6, "width": 1.8, "height": 1.5}
PERSON = {"kind": "pedestrian", "length": 0.6, "width": 0.5, "height": 1.75}
#: of a camera with every kind of thing that may be declared
DECLARED: dict[str, Any] = {
    "columns_px": 960, "rows_px": 600, "focal_x_px": 700.0, "focal_y_px": 715.0, "centre_x_px": 470.0,
    "centre_y_px": 310.5, "distortion": [-0.22, 0.05, 0.0015, -0.001], "x_m": 1.7, "y_m": 0.3, "z_m": 1.5,
    "yaw_deg": 5.0, "pitch_deg": 4.0, "roll_deg": -3.0,
}  # fmt: skip
#: where the ego's rear axle is on the map
EGO = (4.0, 0.5, 0.2)
#: no road near, and so no trees and kerbs before the towers
FAR_OFF = [{"kind": "road", "width": 3.2, "points": [[-900.0, -900.0], [-899.0, -900.0]]}]
BUILDING = PIXEL_KINDS.index("building")


@pytest.fixture(autouse=True, scope="module")
def _with_a_browser() -> None:
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))


def camera(**values: Any) -> DeclaredCamera:
    return CameraFile.model_validate(DECLARED | values).camera("declared")


def in_picture(points: Points) -> Points:
    """Columns and rows of points of the map (n, 3), one turn after the other, then OpenCV's formula."""
    yaw, pitch, roll = (math.radians(DECLARED[key]) for key in ("yaw_deg", "pitch_deg", "roll_deg"))
    x, y, heading = EGO
    cos, sin = math.cos(heading), math.sin(heading)
    east, north, up = points[:, 0] - x, points[:, 1] - y, points[:, 2]
    ahead, left = east * cos + north * sin, north * cos - east * sin
    ahead, left, up = ahead - DECLARED["x_m"], left - DECLARED["y_m"], up - DECLARED["z_m"]
    ahead, left = ahead * math.cos(yaw) + left * math.sin(yaw), left * math.cos(yaw) - ahead * math.sin(yaw)
    ahead, up = ahead * math.cos(pitch) - up * math.sin(pitch), up * math.cos(pitch) + ahead * math.sin(pitch)
    left, up = left * math.cos(roll) + up * math.sin(roll), up * math.cos(roll) - left * math.sin(roll)
    u, v = -left / ahead, -up / ahead
    k1, k2, p1, p2 = DECLARED["distortion"]
    r2 = u * u + v * v
    radial = 1.0 + k1 * r2 + k2 * r2 * r2
    seen_x = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u)
    seen_y = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v
    return np.column_stack(
        (
            DECLARED["focal_x_px"] * seen_x + DECLARED["centre_x_px"],
            DECLARED["focal_y_px"] * seen_y + DECLARED["centre_y_px"],
        )
    )


def blocks() -> list[tuple[float, float, float, float]]:
    """Twenty slender towers in the picture: x and y of the lower left corner, side, height; none behind another."""
    found = []
    for row, (ahead, height) in enumerate(((9.0, 0.6), (14.0, 1.4), (19.0, 2.6), (26.0, 4.4))):
        for k in range(5):
            aside = (k - 2.2 + 0.25 * row) * ahead * 0.2
            x, y, heading = EGO
            heading += math.radians(DECLARED["yaw_deg"])
            found.append(
                (
                    x + ahead * math.cos(heading) - aside * math.sin(heading),
                    y + ahead * math.sin(heading) + aside * math.cos(heading),
                    0.02 * ahead,
                    height,
                )
            )
    return found


def building(x: float, y: float, side: float, height: float) -> dict[str, Any]:
    return {"points": [[x, y], [x + side, y], [x + side, y + side], [x, y + side]], "height": height}


def corners(x: float, y: float, side: float, height: float) -> Points:
    return np.array([(x + i * side, y + j * side, k * height) for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def picture_of(png: bytes) -> NDArray[np.int64]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(np.int64)


@pytest.fixture(scope="module")
def towers() -> tuple[NDArray[np.int64], Truth]:
    """The picture of the towers by what differs from the street without them, and its truth."""
    shown = frame(*EGO)
    bodies = [building(*block) for block in blocks()]
    # The same towers a millimetre high.
    flat = [one | {"height": 0.001} for one in bodies]
    with CameraPictures.of_scene(straight(buildings=flat, lanes=FAR_OFF), camera(), BARE) as pictures:
        without = picture_of(pictures.drawn(shown))
    with CameraPictures.of_scene(straight(buildings=bodies, lanes=FAR_OFF), camera(), BARE) as pictures:
        with_them = picture_of(pictures.drawn(shown))
        truth = pictures.truth()
        assert pictures.complaints == []
    return np.abs(with_them - without).sum(axis=2), truth


@pytest.mark.thorough
def test_twenty_known_points_are_within_a_pixel(towers: tuple[NDArray[np.int64], Truth]) -> None:
    """The edges of towers in the mask, and their tops in the picture, through lens, mounting and all."""
    changed, truth = towers
    for x, y, side, height in blocks():
        outline = in_picture(corners(x, y, side, height))
        (left, top), (right, _) = outline.min(axis=0), outline.max(axis=0)
        assert 5.0 < left < right < 955.0
        column, row = np.round(in_picture(np.array([[x + side / 2.0, y + side / 2.0, 0.6 * height]]))[0]).astype(int)
        edges = crossings(outline[:, ::-1], row)
        above, across = np.s_[int(top) - 4 : row, column], np.s_[row, int(edges[0]) - 3 : int(edges[1]) + 5]
        # An edge lies between the last pixel outside and the first one inside. The picture is softer, by two pixels.
        for shows, slack in ((truth.kinds == BUILDING, 1.0), (changed > 15, 2.2)):
            first = int(top) - 4 + np.flatnonzero(shows[above]).min()
            assert first - 0.5 == pytest.approx(crossings(outline, column)[0], abs=slack)
        seen = int(edges[0]) - 3 + np.flatnonzero(truth.kinds[across] == BUILDING)
        assert (seen.min() - 0.5, seen.max() + 0.5) == pytest.approx(edges, abs=1.0)


def crossings(points: Points, at: float) -> tuple[float, float]:
    """Where a line at a first coordinate enters and leaves the convex outline of points (n, 2): second coordinates."""
    found = []
    for (a, b), (c, d) in combinations(points.tolist(), 2):
        if min(a, c) <= at <= max(a, c) and a != c:
            found.append(b + (d - b) * (at - a) / (c - a))
    return min(found), max(found)


def unseen_ray(column: int, row: int) -> Points:
    """The ray of a pixel in the map's frame, by OpenCV's iteration instead of Newton's."""
    seen = (
        (column - DECLARED["centre_x_px"]) / DECLARED["focal_x_px"],
        (row - DECLARED["centre_y_px"]) / DECLARED["focal_y_px"],
    )
    k1, k2, p1, p2 = DECLARED["distortion"]
    u, v = seen
    for _ in range(60):
        r2 = u * u + v * v
        radial = 1.0 + k1 * r2 + k2 * r2 * r2
        u = (seen[0] - 2.0 * p1 * u * v - p2 * (r2 + 2.0 * u * u)) / radial
        v = (seen[1] - p1 * (r2 + 2.0 * v * v) - 2.0 * p2 * u * v) / radial
    yaw, pitch, roll = (math.radians(DECLARED[key]) for key in ("yaw_deg", "pitch_deg", "roll_deg"))

    # Forward, left, up: a turn about the forward axis, then about that to the left, then about the vertical.
    def about(axis: int, angle: float) -> Points:
        c, s = math.cos(angle), math.sin(angle)
        turns = {
            0: [[1, 0, 0], [0, c, -s], [0, s, c]],
            1: [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            2: [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }
        return np.array(turns[axis], float)

    ray: Points = about(2, EGO[2]) @ about(2, yaw) @ about(1, pitch) @ about(0, roll) @ np.array([1.0, -u, -v])
    return ray


def cast(ray: Points) -> tuple[str, float]:
    """What a ray of a metre along the axis meets first, and at which depth: blocks by their slabs, the ground at 0."""
    x, y, heading = EGO
    cos, sin = math.cos(heading), math.sin(heading)
    mount = DECLARED["x_m"], DECLARED["y_m"]
    eye = np.array([x + mount[0] * cos - mount[1] * sin, y + mount[0] * sin + mount[1] * cos, DECLARED["z_m"]])
    best = ("ground", -eye[2] / ray[2]) if ray[2] < 0.0 else ("sky", math.inf)
    for bx, by, side, height in blocks():
        low, high = np.array([bx, by, 0.0]), np.array([bx + side, by + side, height])
        with np.errstate(divide="ignore"):
            near, far = np.sort(np.stack(((low - eye) / ray, (high - eye) / ray)), axis=0)
        if near.max() < far.min() and 0.0 < near.max() < best[1]:
            best = ("building", float(near.max()))
    return best


@pytest.mark.thorough
def test_kinds_and_depths_are_those_of_rays(towers: tuple[NDArray[np.int64], Truth]) -> None:
    _, truth = towers
    generator = np.random.default_rng(5)
    on_towers = np.argwhere(truth.kinds == BUILDING)
    drawn = [*on_towers[generator.choice(len(on_towers), 150, replace=False)].tolist()]
    drawn += [[int(generator.integers(600)), int(generator.integers(960))] for _ in range(250)]
    off, checked = 0, 0
    for row, column in drawn:
        shown = PIXEL_KINDS[truth.kinds[row, column]]
        if shown in ("vegetation", "kerb", "ego"):
            continue
        kind, depth = cast(unseen_ray(column, row))
        checked += 1
        found = {"nothing": "sky", "building": "building"}.get(shown, "ground")
        if found != kind:
            off += 1  # half a pixel beside an edge
            continue
        if kind != "sky" and depth < 300.0:
            # Half a pixel down the road is depth² / (focal length · height) / 2 farther.
            slack = 0.01 + (depth * depth / (700.0 * 1.5) if kind == "ground" else 0.004 * depth)
            assert truth.depths[row, column] / 100.0 == pytest.approx(depth, abs=slack)
    assert checked > 250
    assert off < 0.08 * checked


@pytest.mark.thorough
def test_owners_fill_the_boxes_of_bodies_and_know_what_hides_them() -> None:
    """A car, a person half behind another car, and one behind the camera that no pixel shows."""
    scene = straight(actors={"near": CAR, "far": CAR, "walker": PERSON, "behind": CAR})
    at = standing(
        ("near", 16.0, -2.4, 0.0), ("far", 22.5, -2.4, 0.0), ("walker", 14.0, 2.5, 1.0), ("behind", -20.0, 0.0, 0.0)
    )
    declared = CameraFile(columns_px=800, rows_px=480, focal_x_px=800.0, y_m=0.0).camera("plain")
    with CameraPictures.of_scene(scene, declared, BARE) as pictures:
        pictures.drawn(frame(actors=at))
        truth = pictures.truth()
    bodies = {body.name: body for body in truth.bodies}
    assert {*bodies} == {"near", "far", "walker"}
    for name, x, y, size in (("near", 16.0, -2.4, CAR), ("walker", 14.0, 2.5, PERSON)):
        body = bodies[name]
        reach = (size["length"] / 2.0, size["width"] / 2.0) if name == "near" else (0.45, 0.45)
        ahead = np.array([x - 1.9 + i * reach[0] for i in (-1, 1) for _ in range(4)])
        aside = np.array([y + j * reach[1] for _ in range(2) for j in (-1, 1) for _ in range(2)])
        up = np.array([k * size["height"] - 1.3 for _ in range(4) for k in (0, 1)])
        columns, rows = 399.5 - 800.0 * aside / ahead, 239.5 - 800.0 * up / ahead
        slack = 3.0 + 0.2 * 800.0 / 12.0  # mirrors stand out of the box
        assert body.box.left >= columns.min() - slack
        assert body.box.right <= columns.max() + slack
        assert body.box.top == pytest.approx(rows.min(), abs=5.0)
        assert body.box.bottom == pytest.approx(rows.max(), abs=5.0)
        assert body.visible > 0.98
        assert body.pixels == np.count_nonzero(truth.owners == body.number)
        assert body.place[2] == pytest.approx(x - 1.9)
        assert body.place[0] == pytest.approx(-y)
        own = truth.depths[truth.owners == body.number] / 100.0
        assert ahead.min() - 0.3 < own.min() < own.max() < ahead.max() + 0.3
    assert 0.02 < bodies["far"].visible < 0.6
    kinds = {name: {*truth.kinds[truth.owners == body.number].tolist()} for name, body in bodies.items()}
    assert kinds["near"] == {PIXEL_KINDS.index("vehicle")}
    assert kinds["walker"] == {PIXEL_KINDS.index("person")}


def test_boxes_are_those_of_the_pixels() -> None:
    owners = np.zeros((6, 8), np.uint16)
    owners[2:4, 3:7] = 5
    owners[5, 0] = 2
    assert boxes_of(owners) == {5: ((3, 2, 7, 4), 8), 2: ((0, 5, 1, 6), 1)}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "look", [SceneAppearance("dusk"), SceneAppearance("night", rain=True), SceneAppearance("day", rain=True)], ids=str
)
def test_every_light_and_weather_is_drawn_and_changes_no_truth(look: SceneAppearance) -> None:
    scene = straight(actors={"other": CAR})
    shown = frame(actors=standing(("other", 15.0, 3.2, math.pi)))
    declared = CameraFile(columns_px=320, rows_px=180, focal_x_px=300.0).camera("small")
    found = []
    for each in (SceneAppearance(), look):
        with CameraPictures.of_scene(scene, declared, each) as pictures:
            png = pictures.drawn(shown, 1.0)
            assert png == pictures.drawn(shown, 1.0)
            found.append((picture_of(png), pictures.truth()))
            assert pictures.complaints == []
    (day, truth), (other, same) = found
    assert np.abs(day - other).mean() > 5.0
    assert (truth.owners == same.owners).all()
    assert (truth.depths == same.depths).all()
    if look.time == "night":
        assert other.mean() < 0.4 * day.mean()


@pytest.mark.thorough
def test_what_is_made_up_stands_beside_the_road_and_away_from_others() -> None:
    clear = [[60.0, -4.0], [45.0, 8.0]]
    scene = straight(keep_clear=clear)
    declared = CameraFile(columns_px=320, rows_px=180, focal_x_px=300.0).camera("small")
    with CameraPictures.of_scene(scene, declared, SceneAppearance()) as pictures:
        pictures.drawn(frame())
        parked = pictures.evaluate("cameraRoll.camera.world.fleet.parked")
        kinds = {PIXEL_KINDS[kind] for kind in np.unique(pictures.truth().kinds).tolist()}
    assert len(parked) > 6
    assert {"building", "walk", "pole"} <= kinds
    for one in parked:
        # The lanes lie from -1.6 m to 4.8 m.
        reach = 0.5 * (one["width"] if abs(math.sin(one["heading"])) < 0.5 else one["length"])
        assert one["y"] + reach < -1.6 or one["y"] - reach > 4.8
        assert min(math.dist((one["x"], one["y"]), at) for at in clear) >= 9.0
    with CameraPictures.of_scene(scene, declared, BARE) as pictures:
        assert pictures.evaluate("cameraRoll.camera.world.fleet.parked") == []


@pytest.mark.thorough
def test_a_folder_of_pictures_is_written_with_its_truth(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "front.toml"
    file.write_text("columns_px = 320\nrows_px = 180\nfocal_x_px = 300.0\ndistortion = [-0.1]\nrate_hz = 5.0\n")
    asked = ["render", str(made.drive), "--frames", "--camera", "front.toml", "--from", "5", "--to", "5.4"]
    assert main(asked) == 0
    assert capsys.readouterr().out == "frames: drive_front\n"
    folder = tmp_path / "drive_front"
    described = json.loads((folder / "camera.json").read_text())
    assert described["camera"]["distortion"] == [-0.1, 0.0, 0.0, 0.0, 0.0]
    for name in ("pictures", "owners", "kinds", "depths"):
        files = sorted((folder / name).iterdir())
        assert [one.name for one in files] == ["000000.png", "000001.png", "000002.png"]
        assert {Image.open(one).size for one in files} == {(320, 180)}
    objects = json.loads((folder / "objects" / "000001.json").read_text())
    assert objects["time_s"] == pytest.approx(5.2)
    owners = np.asarray(Image.open(folder / "owners" / "000001.png"))
    depths = np.asarray(Image.open(folder / "depths" / "000001.png"))
    assert owners.dtype == depths.dtype == np.uint16
    for body in objects["objects"]:
        assert np.count_nonzero(owners == body["number"]) == body["pixels"]
    assert main(asked) == 2
    assert "drive_front: exists already, expected a new or empty folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--frames"], "--frames: goes with --camera"),
        (["--png", "--at", "2", "--rain"], "--rain: goes with --camera"),
        (["--mjpeg", "0"], "--mjpeg: goes with --camera"),
        (["--frames", "--camera", "front"], "--camera front: expected a camera of the drive or a file CAMERA.toml"),
        (["--frames", "--camera", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_goes_with_no_camera_is_one_line(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    asked: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(made.drive), *asked]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not [*tmp_path.iterdir()]


def test_nothing_made_up_stands_near_those_who_stand(made: Made) -> None:
    from vve_sumo.view.camera_pictures import places_of_others
    from vve_sumo.view.frames import Frames

    frames = Frames(Run(made.traffic))
    places = np.array(places_of_others(frames))
    columns = frames.columns
    still = np.abs(columns["actor_speed"]) < 0.1
    for x, y in zip(columns["actor_x"][still][::50].tolist(), columns["actor_y"][still][::50].tolist(), strict=True):
        assert np.hypot(places[:, 0] - x, places[:, 1] - y).min() < 2.2


def test_pictures_come_over_http_in_real_time() -> None:
    """Of a second at ten a second, drawn at once: eleven parts with their drive times, one after the other."""
    server = MjpegServer(0, lambda time: f"picture of {time:.1f}".encode(), 3.0, 4.0, 10.0)
    thread = threading.Thread(target=server.serve_one, daemon=True)
    thread.start()
    with urllib.request.urlopen(server.url, timeout=20.0) as answer:
        assert answer.headers["Content-Type"] == "multipart/x-mixed-replace; boundary=picture"
        body = answer.read()
    thread.join(10.0)
    server.close()
    parts = body.split(b"--picture\r\n")[1:]
    times = [float(part.split(b"X-Drive-Time: ")[1].split(b"\r\n")[0]) for part in parts]
    assert times[0] == 3.0
    assert times == sorted(times)
    assert times[-1] <= 4.0
    assert len(times) <= 11
    for part, time in zip(parts, times, strict=True):
        head, content = part.split(b"\r\n\r\n", 1)
        assert content == f"picture of {time:.1f}\r\n".encode()
        assert f"Content-Length: {len(content) - 2}".encode() in head
