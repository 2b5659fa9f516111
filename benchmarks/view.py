"""How quick the page is: opening and seeking a record, drawing a full street, a large sweep, a live drive's freshness.

python -m benchmarks.view [RECORD] [--seconds S] [--rounds N] [--smoke]
RECORD is a long drive's; without one, opening and seeking are not measured. The live drives are the slow ones of
benchmarks/latency.py: without a page, with a page in a browser, and with twenty hostile clients beside it, in turns.
All in headless Chromium with software rendering at 1280x720. `--smoke` is quick, and its figures say nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import multiprocessing
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
import pyarrow as pa
from playwright.sync_api import Browser, Page, sync_playwright
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from benchmarks.latency import REPOSITORY, rig, scenario
from tests.drive.street import drive_once
from vve_sumo.record.latencies import quantile
from vve_sumo.record.reader import read_table
from vve_sumo.view.frames import pack
from vve_sumo.view.server import FRAMES, PageServer, json_route, page_routes, replay_server
from vve_sumo.world.network import lanes_near, read_network

SIZE = {"width": 1280, "height": 720}
ROWS, VEHICLES, HOSTILE = 100_000, 500, 20
LIVE = ("no page", "page", "hostile")  #: kinds of live drives
BROWSERS = ("chromium", "chromium-browser", "google-chrome")

#: draws a scene with all lanes and vehicles for some seconds; returns frames a second
DRAWING = """async ([base, lanes, actors, factor, seconds]) => {
  const { DriveView } = await import(base + "drive.js");
  const ids = actors.x.map((_, row) => `sedan.${row}`);
  const scene = { source: "live", lanes, path: [[0, 0], [3000, 3000]], stop_line: null, lot: null, sensors: [{
    name: "radar", shape: "points", names_actors: true, view: { forward: 3.7, left: 0, yaw: 0 },
    sectors: [{ range: 174, half_angle: 0.17 }, { range: 60, half_angle: 0.78 }] }], events: [],
    ego: { length: 4.87, width: 1.85, rear_overhang: 1.03, wheelbase: 2.85, steering_ratio: 14.8,
      steering_limit: 0.55 },
    actors: Object.fromEntries(ids.map((id) => [id, { kind: "car", length: 4.5, width: 1.8 }])),
    desired_speed: 11, latency_budget: 0.04 };
  document.getElementById("stage").replaceChildren();
  const view = new DriveView(document.getElementById("stage"), scene);
  view.street.factor = factor;
  let drawn = 0;
  const begun = performance.now();
  while (performance.now() - begun < 1000 * seconds) {
    const t = drawn / 50;
    view.show({ t, state: "engaged", said: "driving", note: "cruise", quality: "RTK fixed", gap: 20, latency: 0.002,
      to_edge: null, footprint: null, real: null,
      sensed: [{ x: [1000], y: [1000], seen: [ids[0]], measured: t, unseen: { id: [], why: [] } }],
      ego: { x: 1300 + 10 * t, y: 1200, heading: 0.2 * Math.sin(t), speed: 10, acceleration: 0, wished: 0,
        steering: 0 },
      actors: { id: ids, x: actors.x.map((x) => x + t), y: actors.y, heading: actors.heading } });
    view.strips.add(view.frame);
    view.draw();
    drawn += 1;
    await new Promise(requestAnimationFrame);
  }
  return drawn / ((performance.now() - begun) / 1000);
}"""

#: sorts a sweep's table by a column; returns how long that takes [ms]
SORTING = "(name) => { const begun = performance.now(); vveSumo.shown.sortBy(name); return performance.now() - begun; }"


class Live(NamedTuple):
    """What a live drive came to."""

    totals: list[float]  #: latency of each tick, bytes to frame [s]
    ages: list[float]  #: of frames when they were drawn [ms]
    memory: float  #: greatest of the page's process [MB]


@contextlib.contextmanager
def served(server: PageServer) -> Iterator[PageServer]:
    """Serve in a thread while the block runs."""
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    yield server
    server.close()
    thread.join()


def opened(browser: Browser, address: str) -> tuple[Page, float]:
    """Open a page; return it and the time until it is ready [s]."""
    page = browser.new_context(viewport=SIZE).new_page()
    begun = time.perf_counter()
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    return page, time.perf_counter() - begun


def replay(browser: Browser, record: Path) -> None:
    """Print how long a record takes to open and to seek in."""
    with served(replay_server([record])) as server:
        page, took = opened(browser, server.address)
        _again, second = opened(browser, server.address)
        seeks = page.evaluate(
            """() => { const shown = vveSumo.shown, took = [];
            const canvas = document.querySelector('.street canvas').getContext('2d');
            for (let n = 0; n < 50; n += 1) {
              const begun = performance.now();
              shown.seek(shown.begins + ((n * 0.618) % 1) * (shown.ends - shown.begins));
              canvas.getImageData(0, 0, 1, 1);
              took.push(performance.now() - begun);
            }
            return took; }"""
        )
        duration = page.evaluate("vveSumo.shown.ends - vveSumo.shown.begins")
    print(f"a record of {duration:.0f} s opens in {took:.2f} s, again in {second:.2f} s")
    print(f"a seek: median {np.median(seeks):.1f} ms, greatest {max(seeks):.1f} ms")


def drawing(browser: Browser, seconds: float) -> None:
    """Print frames a second with the whole map and many vehicles, close by and all at once."""
    network = REPOSITORY / "networks" / "linden.net.xml"
    kinds = {"lane": "road", "junction": "junction", "crossing": "crossing", "walkway": "foot"}
    lanes = [
        {"kind": kinds[lane.kind], "width": lane.width, "points": np.round(lane.shape, 2).tolist()}
        for lane in lanes_near(network, read_network(network).boundary)
    ]
    generator = np.random.default_rng(1)
    near, heading = generator.uniform(-250.0, 250.0, (2, VEHICLES)), generator.uniform(0.0, 6.28, VEHICLES)
    actors = {"x": (1300.0 + near[0]).tolist(), "y": (1200.0 + near[1]).tolist(), "heading": heading.tolist()}
    contents = {"version": 1, "kind": "drive", "records": []}
    with served(PageServer([json_route("/contents.json", lambda request: contents), *page_routes(FRAMES)])) as server:
        for words, factor in (("close by", 1.0), ("all vehicles in sight", 0.15), ("the whole map in sight", 0.02)):
            page = browser.new_context(viewport=SIZE).new_page()
            page.goto(server.address)
            rate = page.evaluate(DRAWING, [server.address, lanes, actors, factor, seconds])
            print(f"{VEHICLES} vehicles, {len(lanes)} lanes, {words}: {rate:.0f} frames/s")
            page.context.close()


def sweep(browser: Browser, rows: int) -> None:
    """Print how long a sweep's table takes to open, and to sort by a number and by a text."""
    generator = np.random.default_rng(1)
    columns: dict[str, Any] = {f"c{n}": generator.normal(size=rows) for n in range(40)}
    columns |= {"c40": generator.integers(0, 5, rows).astype(np.int32), "c41": np.arange(rows, dtype=np.int32)}
    names = [*(f"figure_{n}" for n in range(40)), "outcome", "key"]
    texts = {"c40": ["stopped", "contact", "fault", "arrived", "timeout"], "c41": [f"{n:016x}" for n in range(rows)]}
    head = {"version": 1, "names": names, "units": [""] * len(names), "texts": texts, "plotted": names[:2]}
    content = pack(columns, head)
    contents = {"version": 1, "kind": "sweep", "title": "a sweep", "kept": [], "records": []}

    async def table(request: Request) -> Response:
        return Response(content)

    own: list[BaseRoute] = [json_route("/contents.json", lambda request: contents), Route("/sweep.bin", table)]
    with served(PageServer([*own, *page_routes(FRAMES)])) as server:
        page, took = opened(browser, server.address)
        print(f"a sweep of {rows} runs opens in {took:.2f} s")
        for name in ("figure_3", "outcome", "key"):
            print(f"sorted by {name}: {page.evaluate(SORTING, name):.0f} ms")


def hostile(address: str, over: Any) -> None:
    """Be twenty clients at once until it is over: some never read, some flood, some send noise or half a request."""
    os.nice(19)  # they would be on other machines
    place = ("127.0.0.1", int(address.split(":")[2].split("/", maxsplit=1)[0]))
    token = address.rstrip("/").rsplit("/", 1)[1]
    head = (
        f"GET /{token}/socket HTTP/1.1\r\nHost: 127.0.0.1:{place[1]}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode()
    generator = random.Random(1)

    async def one(number: int) -> None:
        while not over.is_set():
            with contextlib.suppress(OSError, asyncio.TimeoutError):
                _reader, writer = await asyncio.open_connection(*place)
                writer.write(head if number % 4 != 3 else b"GET /")
                for _ in range(50):
                    if over.is_set():
                        break
                    if number % 4 == 1:
                        writer.write(b"\x81\x81\x00\x00\x00\x001" * 100)
                    elif number % 4 == 2:
                        writer.write(generator.randbytes(10_000))
                    await asyncio.wait_for(writer.drain(), 1.0)
                    await asyncio.sleep(0.05)
                writer.close()

    async def all_of_them() -> None:
        await asyncio.gather(*(one(number) for number in range(HOSTILE)))

    asyncio.run(all_of_them())


def live(browser: Browser, folder: Path, case: str, seconds: float, number: int) -> Live:
    """Drive once; `case` is one of LIVE."""
    record = folder / f"record_{case.replace(' ', '_')}_{number}"
    command = [sys.executable, "-m", "vve_sumo.cli", "drive", str(scenario(folder, 0, seconds))]
    command += ["--rig", str(rig(folder, {})), "--out", str(record), *(["--view"] if case != "no page" else [])]
    spawn = multiprocessing.get_context("spawn")
    over, ages, memory = spawn.Event(), [], 0.0
    with subprocess.Popen(
        command, cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as console:
        assert console.stderr is not None
        if case != "no page":
            address = next(line for line in console.stderr if line.startswith("view: ")).split()[1]
            page, _took = opened(browser, address)
            helper = spawn.Process(target=hostile, args=(address, over), daemon=True)
            if case == "hostile":
                helper.start()
            while console.poll() is None:
                with contextlib.suppress(psutil.Error, OSError, ValueError):
                    own = int(json.loads((record / "processes.json").read_text(encoding="utf-8"))["view"])
                    memory = max(memory, psutil.Process(own).memory_info().rss / 1e6)
                page.wait_for_timeout(500)
                if page.evaluate("vveSumo.shown.over"):
                    break
            ages = page.evaluate("vveSumo.shown.freshness")
            page.context.close()
            over.set()
        console.communicate()
        if case == "hostile":
            helper.join(10.0)
    table = read_table(record, "latency")
    return Live(_totals(table), ages, memory)


def _totals(table: pa.Table) -> list[float]:
    begun = np.where(
        np.array(table["woken_by"]) == "datagram", np.array(table["received_s"]), np.array(table["woken_s"])
    )
    totals = np.array(table["framed_s"]) - begun
    return sorted(totals[np.isfinite(totals)].tolist())


def drives(browser: Browser, cases: Sequence[str], seconds: float, rounds: int) -> None:
    """Print tick latency without and with pages, and how fresh frames are when they are drawn."""
    found: dict[str, list[Live]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(rounds):
            for case in cases:
                found[case].append(live(browser, Path(scratch), case, seconds, number))
    for case, parts in found.items():
        totals = sorted(took for part in parts for took in part.totals)
        p50, p99 = (1000.0 * quantile(totals, share) for share in (0.5, 0.99))
        line = f"{case}: tick latency median {p50:.2f} ms, p99 {p99:.2f} ms of {len(totals)} ticks"
        ages = sorted(age for part in parts for age in part.ages)
        if ages:
            line += f"; drawn {quantile(ages, 0.5):.0f} ms after the tick (p95 {quantile(ages, 0.95):.0f} ms)"
            line += f", the page's process takes at most {max(part.memory for part in parts):.0f} MB"
        print(line)


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", nargs="?", type=Path, help="of a long drive, to open and seek in")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each live drive (default: 30)")
    parser.add_argument("--rounds", type=int, default=2, help="of live drives (default: 2)")
    parser.add_argument("--smoke", action="store_true", help="small and short, only to see that it runs")
    arguments = parser.parse_args()
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=next(filter(None, map(shutil.which, BROWSERS))), args=["--no-sandbox", "--disable-gpu"]
        )
        if arguments.smoke:
            smoke(browser)
        else:
            if arguments.record is not None:
                replay(browser, arguments.record)
            drawing(browser, 5.0)
            sweep(browser, ROWS)
            drives(browser, LIVE, arguments.seconds, arguments.rounds)
        browser.close()


def smoke(browser: Browser) -> None:
    """Measure everything on a small scale."""
    with tempfile.TemporaryDirectory() as scratch:
        drive_once({"duration_s": 1.0}, f"{scratch}/short")
        replay(browser, Path(scratch) / "short")
    drawing(browser, 0.3)
    sweep(browser, 1000)
    drives(browser, LIVE[-1:], 2.0, 1)


if __name__ == "__main__":
    main()
