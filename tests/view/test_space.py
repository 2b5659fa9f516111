"""The street in three dimensions, in a real browser: where the camera is, and that things are seen where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from tests.view.made import Made
from tests.view.spaces import EYE, SIZE, Space, frame, opened, standing, straight
from vve_sumo.analysis.run import Run
from vve_sumo.view.pictures import Pictures

CENTIMETRE, TENTH_OF_A_DEGREE = 0.01, math.radians(0.1)
CAR = {"kind": "car", "length": 4.6, "width": 1.8, "height": 1.5}
#: the driver's eye of the ego in a headset's session: x, y on the map, height [m]
HEADSET_EYE = (
    20.0 + EYE[0] * math.cos(0.5) - EYE[1] * math.sin(0.5),
    1.0 + EYE[0] * math.sin(0.5) + EYE[1] * math.cos(0.5),
    EYE[2],
)
#: of what the board says: dots of light ink, and the share of its paper that is red
INK = """(() => {
  const { context } = world.board, { canvas } = context;
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let light = 0, red = 0;
  for (let at = 0; at < data.length; at += 4) {
    if (Math.min(data[at], data[at + 1], data[at + 2]) > 200) light += 1;
    if (data[at] > 100 && data[at + 1] < 80) red += 1;
  }
  return { light, red: red / (canvas.width * canvas.height) };
})()"""
HALF_FIELD_OF_VIEW, LOOKS_DOWN = math.radians(46.0) / 2.0, 0.045


@pytest.fixture(scope="module")
def space() -> Iterator[Space]:
    with opened() as found:
        yield found


def apart(first: float, second: float) -> float:
    return abs(math.remainder(first - second, 2.0 * math.pi))


@pytest.mark.thorough
def test_the_camera_is_at_the_drivers_eye_of_the_recorded_ego(made: Made) -> None:
    """At ticks and in the middle between two, where the record's next tick says where the car really was."""
    columns = ["time_s", "true_x_m", "true_y_m", "true_heading_rad"]
    time, x, y, heading = (pq.read_table(made.drive / "ticks.parquet", columns=columns)[c].to_numpy() for c in columns)
    asked = [(k, share) for k in np.linspace(5, len(time) - 2, 60).astype(int).tolist() for share in (0.0, 0.5)]
    at = [float(time[k] + share * (time[k + 1] - time[k])) for k, share in asked]
    with Pictures(Run(made.drive), "driver", 64, 64) as pictures:
        poses = pictures.evaluate(
            f"{at}.map((t) => {{ const {{ frames, world }} = pictures;"
            "world.show(frames.frame(frames.at(t)), t); return world.cameraPose(); })"
        )
    for (k, share), pose in zip(asked, poses, strict=True):
        rear, front = ((1.0 - share) * column[k] + share * column[k + 1] for column in (x, y))
        turned = heading[k] + share * math.remainder(heading[k + 1] - heading[k], 2.0 * math.pi)
        assert math.dist((pose["car"]["x"], pose["car"]["y"]), (rear, front)) < CENTIMETRE
        assert apart(pose["car"]["heading"], turned) < TENTH_OF_A_DEGREE
        cos, sin = math.cos(turned), math.sin(turned)
        eye = rear + EYE[0] * cos - EYE[1] * sin, front + EYE[0] * sin + EYE[1] * cos, EYE[2]
        assert math.dist((pose["x"], pose["y"], pose["height"]), eye) < CENTIMETRE
        assert apart(pose["heading"], turned) < TENTH_OF_A_DEGREE


@pytest.mark.thorough
def test_a_pose_is_predicted_along_its_circle_and_not_for_long(space: Space) -> None:
    space.make(straight())
    shown = frame(3.0, 1.0, 0.4)
    shown["ego"] |= {"speed": 12.0, "yaw_rate": 0.8}
    for ahead, driven in ((0.1, 0.1), (-0.04, -0.04), (5.0, 0.25)):
        space.picture(shown, ahead)
        # The same motion in small steps, each straight.
        x, y, heading, steps = 3.0, 1.0, 0.4, 20_000
        for _ in range(steps):
            x += 12.0 * driven / steps * math.cos(heading)
            y += 12.0 * driven / steps * math.sin(heading)
            heading += 0.8 * driven / steps
        car = space.pose()["car"]
        assert (car["x"], car["y"]) == pytest.approx((x, y), abs=1e-3)
        assert car["heading"] == pytest.approx(heading, abs=1e-6)


@pytest.mark.thorough
def test_the_head_turns_the_camera_and_not_the_car(space: Space) -> None:
    space.make(straight())
    space.picture(frame(10.0, 0.0, 0.3))
    ahead = space.pose()
    space.browser.evaluate("world.look({ yaw: 0.5, pitch: 0.2 })")
    turned = space.pose()
    assert turned["heading"] - ahead["heading"] == pytest.approx(0.5)
    assert turned["pitch"] - ahead["pitch"] == pytest.approx(0.2)
    assert [turned[key] for key in ("x", "y", "height")] == pytest.approx([ahead[key] for key in ("x", "y", "height")])
    assert turned["car"] == pytest.approx(ahead["car"])


@pytest.mark.thorough
@pytest.mark.parametrize(("ahead", "aside"), [(12.0, 0.0), (25.0, 3.2), (40.0, -4.0)])
def test_a_car_is_seen_where_a_pinhole_camera_has_it(space: Space, ahead: float, aside: float) -> None:
    """What differs between the pictures with and without the car lies about the car's box, projected by hand."""
    space.make(straight(actors={"other": CAR}))
    heading = 0.25
    place = ahead * math.cos(heading) - aside * math.sin(heading), ahead * math.sin(heading) + aside * math.cos(heading)
    without = space.picture(frame(heading=heading)).astype(int)
    with_it = space.picture(frame(heading=heading, actors=standing(("other", *place, heading)))).astype(int)
    rows, columns = np.nonzero(np.abs(with_it - without).sum(axis=2) > 40)
    corners = [
        projected(ahead + i * CAR["length"] / 2, aside + j * CAR["width"] / 2, k * CAR["height"])
        for i in (-1, 1)
        for j in (-1, 1)
        for k in (0, 1)
    ]
    right, low = np.array(corners).T
    seen = columns.min(), columns.max(), rows.max()
    # The shadow reaches 0.2 m beyond the box; mirrors stand out by 0.2 m; the cockpit hides nothing of these.
    slack = 1.5 + 0.25 * SIZE[1] / (2.0 * math.tan(HALF_FIELD_OF_VIEW)) / (ahead - 4.0)
    assert seen == pytest.approx((right.min(), right.max(), low.max()), abs=slack)


def projected(ahead: float, aside: float, height: float) -> tuple[float, float]:
    """Column and row of a point before the rear axle, left of it and over the ground."""
    x, left, up = ahead - EYE[0], aside - EYE[1], height - EYE[2]
    cos, sin = math.cos(LOOKS_DOWN), math.sin(LOOKS_DOWN)
    deep, up = cos * x - sin * up, sin * x + cos * up
    scale = SIZE[1] / (2.0 * math.tan(HALF_FIELD_OF_VIEW))
    return SIZE[0] / 2.0 - scale * left / deep, SIZE[1] / 2.0 - scale * up / deep


@pytest.mark.thorough
def test_every_kind_of_actor_is_drawn_and_looks_different(space: Space) -> None:
    kinds = ("car", "van", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "child")
    space.make(straight(actors={kind: {"kind": kind, "length": None, "width": None, "height": None} for kind in kinds}))
    empty = space.picture(frame()).astype(int)
    changed = {}
    for kind in kinds:
        picture = space.picture(frame(actors=standing((kind, 14.0, 0.0, 0.5)))).astype(int)
        changed[kind] = int((np.abs(picture - empty).sum(axis=2) > 40).sum())
    assert min(changed.values()) > 100
    assert changed["bus"] > changed["car"] > changed["bicycle"] > changed["child"]
    assert changed["pedestrian"] > changed["child"]
    assert len({*changed.values()}) == len(kinds)


@pytest.mark.thorough
def test_an_actor_without_a_pose_and_a_frame_without_ego_draw_nothing_new(space: Space) -> None:
    space.make(straight())
    empty = space.picture(frame(5.0))
    lost = frame(5.0, actors=standing(("other", 14.0, 0.0, 0.0)))
    lost["actors"]["x"] = [None]
    assert (space.picture(lost) == empty).all()
    assert (space.picture(frame() | {"ego": None}) == empty).all()


def red_and_green(picture: NDArray[np.uint8]) -> tuple[int, int]:
    red, green, blue = (picture[:, :, k].astype(int) for k in range(3))
    sky = slice(0, SIZE[1] // 3)
    lit_red = (red > 200) & (green < 90) & (blue < 80)
    lit_green = (green > 180) & (red < 90) & (blue < 160)
    return int(lit_red[sky].sum()), int(lit_green[sky].sum())


@pytest.mark.thorough
def test_signals_show_their_state_and_none_where_nobody_knows_it(space: Space) -> None:
    head = {"id": "one", "link": 1, "x": 18.0, "y": 0.0, "heading": 0.0, "reach": 2.6}
    space.make(straight(network={"junctions": [], "stop_lines": [], "signals": [head]}))
    shown = {said: red_and_green(space.picture(frame(signals=said and {"one": said}))) for said in ("Gr", "rG", None)}
    assert shown["Gr"][0] > 20
    assert shown["Gr"][1] == 0
    assert shown["rG"][1] > 20
    assert shown["rG"][0] == 0
    assert shown[None] == (0, 0)


@pytest.mark.thorough
def test_a_building_stands_where_the_map_has_it(space: Space) -> None:
    outline = [[20.0, 8.0], [32.0, 8.0], [32.0, 20.0], [20.0, 20.0]]
    for points in (outline, outline[::-1]):
        # A building of a centimetre first: no trees stand in either.
        low, high = ([{"points": points, "height": height}] for height in (0.01, 4.0))
        space.make(straight(buildings=low))
        without = space.picture(frame()).astype(int)
        space.make(straight(buildings=high))
        rows, columns = np.nonzero(np.abs(space.picture(frame()).astype(int) - without).sum(axis=2) > 40)
        # From its far right lower corner to its near left one, which lies outside of the picture.
        assert columns.max() == pytest.approx(projected(32.0, 8.0, 0.0)[0], abs=3.0)
        assert rows.min() == pytest.approx(projected(20.0, 8.0, 4.0)[1], abs=3.0)


def test_kerbs_and_marks_lie_where_the_lanes_end_and_meet(space: Space) -> None:
    """By the lengths: kerbs outside, a centre line each way, one line between lanes of the same direction."""
    sources = (Path(__file__).parents[2] / "web" / "src").as_uri()
    lanes = [*straight(100.0)["lanes"], {"kind": "road", "width": 3.2, "points": [[-50.0, -3.2], [100.0, -3.2]]}]
    found: dict[str, Any] = space.browser.evaluate(f"""(async () => {{
        const {{ RoadSurface }} = await import("{sources}/road_surface.js");
        const {{ borders, dashes }} = await import("{sources}/borders.js");
        const found = borders(new RoadSurface({lanes}, []));
        return {{ ...found, dashes: dashes([[0, 0], [50, 0]], 3, 9) }};
    }})()""")
    heights = {kind: sorted({y for line in found[kind] for _x, y in line}) for kind in ("kerbs", "centres", "dividers")}
    assert heights["kerbs"] == pytest.approx([-4.8, 4.8])
    assert heights["centres"] == pytest.approx([1.6])
    assert heights["dividers"] == pytest.approx([-1.6])
    lengths = {kind: sum(math.dist(a, b) for line in found[kind] for a, b in pairwise(line)) for kind in heights}
    assert lengths == pytest.approx({"kerbs": 300.0, "centres": 300.0, "dividers": 150.0}, abs=0.01)
    assert [[round(x, 3) for x, _y in dash] for dash in found["dashes"]] == [[12 * k, 12 * k + 3] for k in range(4)] + [
        [48, 50]
    ]


@pytest.mark.thorough
def test_a_headset_moves_within_the_car(headset: Space) -> None:
    """WebXR with an emulated device: the headset's pose is added to the eye's, and the car takes it along."""
    still = after_pictures(headset)
    # Half a metre to the left and 0.2 m up, and turned to the left by 0.6 rad about the upright axis.
    move(headset, (-0.5, 1.8, 0.0), 0.6)
    moved = after_pictures(headset)
    assert moved["heading"] - still["heading"] == pytest.approx(0.6, abs=1e-3)
    across = -0.5 * math.sin(0.5), 0.5 * math.cos(0.5)
    change = [moved[key] - still[key] for key in ("x", "y", "height")]
    assert change == pytest.approx([*across, 0.2], abs=1e-3)
    assert moved["car"] == pytest.approx({"x": 20.0, "y": 1.0, "heading": 0.5}, abs=1e-6)
    assert (still["x"], still["y"]) == pytest.approx(HEADSET_EYE[:2], abs=1e-2)
    headset.browser.evaluate("session.end()")
    assert headset.browser.evaluate("world.renderer.xr.isPresenting") is False


@pytest.mark.thorough
def test_a_trigger_puts_the_head_back_to_the_drivers_eye(headset: Space) -> None:
    """Wherever it is and whichever way it is turned; bent down by 0.4 rad it looks down by as much afterwards, too."""
    move(headset, (0.7, 1.1, -0.4), -0.9, down=0.4)
    off = after_pictures(headset)
    assert math.dist((off["x"], off["y"], off["height"]), HEADSET_EYE) > 0.5
    press_trigger(headset)
    back = after_pictures(headset)
    assert (back["x"], back["y"], back["height"]) == pytest.approx(HEADSET_EYE, abs=1e-3)
    assert back["heading"] == pytest.approx(0.5, abs=1e-3)
    assert back["pitch"] == pytest.approx(-0.4, abs=1e-3)
    # From then on the head moves about there: 0.3 m the way that it looked is ahead.
    ahead = math.sin(0.9), -math.cos(0.9)
    move(headset, (0.7 + 0.3 * ahead[0], 1.1, -0.4 + 0.3 * ahead[1]), -0.9)
    on = after_pictures(headset)
    assert (on["x"], on["y"]) == pytest.approx(
        (HEADSET_EYE[0] + 0.3 * math.cos(0.5), HEADSET_EYE[1] + 0.3 * math.sin(0.5)), abs=1e-3
    )
    # Again, and the headset's own way, which moves its origin to the head.
    press_trigger(headset)
    again = after_pictures(headset)
    assert (again["x"], again["y"], again["height"]) == pytest.approx(HEADSET_EYE, abs=1e-3)
    headset.browser.evaluate("device.recenter(); 0")
    own = after_pictures(headset)
    assert own["heading"] == pytest.approx(0.5, abs=1e-3)
    assert (own["x"], own["y"]) == pytest.approx(HEADSET_EYE[:2], abs=1e-3)


@pytest.mark.thorough
def test_the_board_is_seen_in_a_headset_and_not_in_a_picture(headset: Space) -> None:
    """What it says and where: ahead of the driver's eye, below the horizon, and only while the session lasts."""
    after_pictures(headset)
    assert headset.browser.evaluate("world.board.mesh.visible") is True
    headset.browser.evaluate("world.tell(['36 km/h', 'engaged']); 0")
    written = headset.browser.evaluate(INK)
    headset.browser.evaluate("world.tell(['NO LIVE DATA', ''], true); 0")
    warned = headset.browser.evaluate(INK)
    assert written["light"] > 500
    assert warned["light"] > 500
    assert warned["red"] > 0.8 > 0.2 > written["red"]
    ahead, up = headset.browser.evaluate("(({ z, y }) => [-z, y])(world.board.mesh.position)")
    assert 0.7 <= ahead <= 1.5
    assert math.radians(5.0) < math.atan2(-up, ahead) < math.radians(20.0)
    headset.browser.evaluate("session.end()")
    assert headset.browser.evaluate("world.board.mesh.visible") is False
    headset.make(straight())
    assert headset.browser.evaluate("world.board.mesh.visible") is False


@pytest.mark.thorough
def test_a_hidden_street_leaves_the_car_alone(space: Space) -> None:
    """Kerbs, bodies, trees and sky are gone; the cockpit stays where it was, dark around it."""
    space.make(straight(actors={"lead": CAR}))
    shown = frame(0.0, actors=standing(("lead", 12.0, 0.0, 0.0)))
    whole = space.picture(shown)
    space.browser.evaluate("world.hide(true); 0")
    hidden = space.picture(shown)
    assert space.browser.evaluate("world.hidden") is True
    upper = hidden[: SIZE[1] // 4, SIZE[0] // 3 : SIZE[0] // 2]
    assert upper.max() == 0
    assert whole[: SIZE[1] // 4, SIZE[0] // 3 : SIZE[0] // 2].min() > 100
    low = np.s_[int(0.95 * SIZE[1]) :]
    assert np.array_equal(hidden[low], whole[low])
    space.browser.evaluate("world.hide(false); 0")
    assert np.array_equal(space.picture(shown), whole)


@pytest.fixture
def headset(space: Space) -> Iterator[Space]:
    """A world in a session of an emulated headset, of one eye, before the ego at (20, 1) with a heading of 0.5 rad."""
    device = (Path(__file__).parent / "vendor" / "iwer.min.js").read_text(encoding="utf-8")
    space.browser.evaluate(f"{device};0")
    # A browser without a headset has WebXR all the same: the emulated one takes its place.
    space.browser.evaluate(
        "globalThis.device = new IWER.XRDevice(IWER.metaQuest3); device.installRuntime({ forceInstall: true });"
        "device.stereoEnabled = false; device.ipd = 0; 0"
    )
    assert space.browser.evaluate("import('./world.min.js').then((module) => module.headsetIsThere())")
    space.make(straight())
    shown = frame(20.0, 1.0, 0.5)
    space.picture(shown)
    begin = f"world.session(() => {{ world.show({shown}, 0); globalThis.shown = (globalThis.shown ?? 0) + 1; }})"
    begin = begin.replace("None", "null")
    space.browser.evaluate(
        f"device.position.set(0, 1.6, 0); {begin}.then((session) => {{ globalThis.session = session; }})"
    )
    yield space
    space.browser.evaluate("session.end().catch(() => {})")


def move(space: Space, place: tuple[float, float, float], yaw: float, *, down: float = 0.0) -> None:
    """Have the head be at a place [m: right, up, back], turned to the left by `yaw` and then bent down [rad]."""
    (s, c), (t, d) = (math.sin(yaw / 2), math.cos(yaw / 2)), (math.sin(-down / 2), math.cos(-down / 2))
    # The product of the turn about the upright axis and that about the head's own axis to the right.
    turned = c * t, s * d, -s * t, c * d
    space.browser.evaluate(f"device.position.set(...{[*place]}); device.quaternion.set(...{[*turned]}); 0")


def press_trigger(space: Space) -> None:
    """Press and let go of the right hand's trigger, each for some pictures."""
    for value in (1, 0):
        space.browser.evaluate(f"device.controllers.right.updateButtonValue('trigger', {value}); 0")
        after_pictures(space)


def after_pictures(space: Space) -> dict[str, Any]:
    """Return where the camera is once the headset has been given two more pictures."""
    space.browser.evaluate("""new Promise((done) => {
        const until = (globalThis.shown ?? 0) + 2;
        const look = () => (globalThis.shown >= until ? done() : session.requestAnimationFrame(look));
        session.requestAnimationFrame(look);
    })""")
    return space.pose()
