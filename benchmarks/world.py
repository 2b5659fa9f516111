"""Measures how many pictures a second the street in three dimensions gets without a graphics card.

The scene is the whole Linden network with 500 vehicles, most of them in sight, at 1280x720. The browser draws by
software, picture after picture, and waits for each to be finished. `python -m benchmarks.world [--smoke]`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
from pathlib import Path
from typing import Any

import psutil

from vve_sumo.view.browser import Browser
from vve_sumo.view.pictures import PAGE
from vve_sumo.view.scene import LANE_KINDS
from vve_sumo.world.network import NetworkLane, lanes_near, read_network
from vve_sumo.world.street_geometry import street_geometry

NETWORK = Path(__file__).parent.parent / "networks" / "linden.net.xml"
SIZE = (1280, 720)
VEHICLES = 500
#: vehicles stand within this distance of the ego [m], more than a radar or a driver sees
AROUND = 300.0
#: where the ego is: on Cleveland Avenue, before Seventeenth Avenue; the street is as wide there as anywhere
EGO = {"x": 975.0, "y": 1155.0, "heading": -2.02, "speed": 10.0, "yaw_rate": 0.0, "steering": 0.0}
KINDS = {"car": (4.6, 1.8, 1.5), "van": (5.5, 2.0, 2.3), "truck": (8.0, 2.5, 3.3), "bicycle": (1.8, 0.6, 1.75)}

VIEWS = ("driver", "chase", "above")
#: pictures that are drawn in one go; the first few of a view are not counted
AT_ONCE, WARM_UP = 5, 3

OPEN = """
(async () => {
  const { createWorld } = await import("./world.min.js");
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: WIDTH, height: HEIGHT });
  document.body.append(canvas);
  const begun = performance.now();
  globalThis.world = createWorld(canvas, SCENE);
  globalThis.shown = FRAME;
  const gl = canvas.getContext("webgl2"), pixel = new Uint8Array(4);
  globalThis.drawn = (count) => Array.from({ length: count }, (_, k) => {
    const start = performance.now();
    world.show(shown, shown.t + 0.002 * k);
    world.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - start;
  });
  return performance.now() - begun;
})()
"""


def main() -> None:
    """Print pictures a second of each view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="a few pictures, only to see that it runs")
    rounds = 1 if parser.parse_args().smoke else 12
    lanes = lanes_near(NETWORK, read_network(NETWORK).boundary)
    scene, frame = _scene(lanes), _frame(lanes)
    scene["actors"] = {name: _body(name) for name in frame["actors"]["id"]}
    expression = OPEN
    for word, value in {"WIDTH": SIZE[0], "HEIGHT": SIZE[1], "SCENE": scene, "FRAME": frame}.items():
        expression = expression.replace(word, json.dumps(value), 1)
    with Browser(*SIZE) as browser:
        browser.open(PAGE)
        opened = browser.evaluate(expression)
        print(f"{len(lanes)} lanes, {VEHICLES} vehicles, {SIZE[0]}x{SIZE[1]}, software rendering")
        print(f"opened in {opened / 1000:.1f} s; load {os.getloadavg()[0]:.1f} of {os.cpu_count()} processors")
        for view in VIEWS:
            _measure(browser, view, rounds)
        assert not browser.complaints, browser.complaints


def _measure(browser: Browser, view: str, rounds: int) -> None:
    browser.evaluate(f"world.view({view!r}); drawn({WARM_UP}).length")
    before = _processor_time()
    times = sorted(time for _ in range(rounds) for time in browser.evaluate(f"drawn({AT_ONCE})"))
    spent = (_processor_time() - before) / len(times)
    cost = browser.evaluate("world.cost")
    median = times[len(times) // 2]
    print(
        f"{view:7} {1000 / median:5.1f} pictures/s: median {median:.0f} ms, worst {times[-1]:.0f} ms, "
        f"{1000 * spent:.0f} ms of processor time; {cost['actors']} bodies, {cost['triangles']} triangles, "
        f"{cost['calls']} draws"
    )


def _processor_time() -> float:
    """Return what the browser's processes have spent [s]."""
    spent = 0.0
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            times = process.cpu_times()
            spent += times.user + times.system
    return spent


def _scene(lanes: list[NetworkLane]) -> dict[str, Any]:
    network = street_geometry(NETWORK, read_network(NETWORK).boundary).to_dict()
    x, y = EGO["x"], EGO["y"]
    return {
        "lanes": [
            {"kind": LANE_KINDS[lane.kind], "width": lane.width, "points": lane.shape.round(3).tolist()}
            for lane in lanes
        ],
        "network": network,
        "buildings": [],
        "path": [[x, y]],
        "ego": {},
    }


def _frame(lanes: list[NetworkLane]) -> dict[str, Any]:
    """Return a frame with vehicles on the lanes nearest to the ego."""
    draw = random.Random(1)
    places = []
    for lane in lanes:
        if lane.kind != "lane":
            continue
        for (ax, ay), (bx, by) in zip(lane.shape[:-1], lane.shape[1:], strict=True):
            heading, long = math.atan2(by - ay, bx - ax), math.hypot(bx - ax, by - ay)
            for k in range(int(long // 7.0)):
                share = (7.0 * k + 3.5) / long
                places.append((ax + share * (bx - ax), ay + share * (by - ay), heading))
    near = [place for place in places if 8.0 < math.dist(place[:2], (EGO["x"], EGO["y"])) < AROUND]
    chosen = draw.sample(near, min(VEHICLES, len(near)))
    names = [f"{draw.choice([*KINDS, 'car', 'car', 'car'])}.{k}" for k in range(len(chosen))]
    x, y, heading = (list(map(float, column)) for column in zip(*chosen, strict=True))
    actors = {"id": names, "x": x, "y": y, "heading": heading, "speed": [8.0] * len(names)}
    return {"t": 0.0, "state": "engaged", "ego": EGO, "actors": actors, "gap": None, "signals": None}


def _body(name: str) -> dict[str, Any]:
    kind = name.partition(".")[0]
    length, width, height = KINDS[kind]
    return {"kind": kind, "length": length, "width": width, "height": height}


if __name__ == "__main__":
    main()
