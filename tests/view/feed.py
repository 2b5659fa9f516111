"""A live hub without a drive: a server whose page is fed made-up samples, fifty a second, from an event loop."""

from __future__ import annotations

import asyncio
import json
import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from vve_sumo.record.roads import read_roads
from vve_sumo.values import Actors, ArmingState, FixQuality, GatewayStatus, Point, Pose
from vve_sumo.view.guard import STOP_PATH
from vve_sumo.view.hub import Hub
from vve_sumo.view.live_frame import LiveFrames
from vve_sumo.view.sample import ReadingView, ViewSample, decode, encode
from vve_sumo.view.scene import scene_of
from vve_sumo.view.server import NO_FRAMES, PageServer, json_route, page_routes

PERIOD = 0.02
ENGAGED = GatewayStatus(ArmingState.ENGAGED, (), 0.0, 0.0, (), 0.0, 0.0)


def crowd(count: int, x: float, y: float, time: float) -> Actors:
    """Vehicles in rows around a place, all of which drive on."""
    side = max(math.ceil(math.sqrt(count)), 1)
    rows = np.arange(count)
    east, north = (rows % side) * 9.0 + 5.0 * time, (rows // side) * 6.0
    shape = np.full(count, 4.5), np.full(count, 1.8), np.full(count, 10.0), np.zeros(count), np.full(count, 1.5)
    ids = tuple(f"sedan.{row}" for row in range(count))
    speed = np.full(count, 5.0)
    return Actors(
        time, ids, x + 20.0 + east, y - 3.0 * side + north, np.zeros(count), speed, *shape, np.zeros(count, np.int8)
    )


def sample(tick: int, count: int = 5, x: float = 1379.0, y: float = 1176.0) -> ViewSample:
    """A tick of a car that drives east at 10 m/s."""
    drive_time = PERIOD * tick
    pose = Pose(drive_time, Point.REAR_AXLE, x + 10.0 * drive_time % 100.0, y, 0.0, 10.0, 0.0, 0.0, 0.1, 0.0)
    columns = (np.array([20.0]), np.array([0.05]), np.array([0.0]), np.array([0]), ("sedan.0",))
    readings = {"radar": ReadingView(drive_time, columns)} if tick % 3 == 0 else {}
    return ViewSample(
        tick=tick, time=drive_time, wall=time.time(), pose=pose, s=10.0, d=0.0, wished=-1.0, wished_steering=0.0,
        note="cruise", fallback_path=None, commanded_path=None, faults=(), details={}, pose_reasons=(),
        quality=FixQuality.RTK_FIXED, sigma=0.01,
        status=ENGAGED, status_age=0.01, steering=0.01, wheel_speed=10.0, gear="drive", latency=0.002, missed=0,
        actors=crowd(count, pose.x, pose.y, drive_time), readings=readings, signals={"crossing": "rG"}, people=(),
        outcome=None,
    )  # fmt: skip


class Live:
    """The served hub, and what became of it."""

    def __init__(self, record: Path, count: int, port: int, token: str) -> None:
        resolved = json.loads((record / "scenario.json").read_text(encoding="utf-8"))
        self.frames = LiveFrames(resolved, lambda status: str(status["state"]))
        self.hub = Hub(self.frames, scene_of(resolved, read_roads(record), source="live"))
        self.asked = 0  #: requests to stop
        self.busy = threading.Event()  #: while it is set, no request to stop is answered
        self.silent = threading.Event()  #: while it is set, no sample comes
        self.late: list[float] = []  #: how much later than due each sample was taken [s]
        self._count, self._over, self.closed = count, threading.Event(), threading.Event()
        self._verdict: dict[str, Any] | None = None
        contents = {"version": 1, "kind": "live", "records": []}
        routes = [
            Route(STOP_PATH, self._stop, methods=["POST"]),
            WebSocketRoute("/socket", self.hub.watch),
            json_route("/contents.json", lambda request: contents),
            *page_routes(NO_FRAMES),
        ]
        self.server = PageServer(routes, port=port, token=token)
        self.address, self.token = self.server.address, self.server.token
        self.place = ("127.0.0.1", self.server.port)

    async def _stop(self, request: Request) -> Response:
        self.asked += 1
        while self.busy.is_set():
            await asyncio.sleep(PERIOD)
        return PlainTextResponse("asked\n")

    async def _run(self) -> None:
        serving = asyncio.create_task(self.server.serve())
        tick, due = 0, time.monotonic()
        while not self._over.is_set():
            due += PERIOD
            await asyncio.sleep(max(due - time.monotonic(), 0.0))
            self.late.append(time.monotonic() - due)
            tick += 1
            if not self.silent.is_set():
                took = decode(encode(sample(tick, self._count)))
                assert isinstance(took, ViewSample)
                self.hub.changed(self.frames.take(took))
        self.hub.end(self._verdict)
        await asyncio.sleep(0.1)
        self.server.close()
        await serving

    def run(self) -> None:
        asyncio.run(self._run())
        self.closed.set()

    def end(self, verdict: dict[str, Any] | None = None) -> None:
        self._verdict = self._verdict or verdict
        self._over.set()


@contextmanager
def live(record: Path, count: int = 5, port: int = 0, token: str = "") -> Iterator[Live]:
    """Serve a fed hub until the end of the block."""
    one = Live(record, count, port, token)
    thread = threading.Thread(target=one.run, daemon=True)
    thread.start()
    try:
        yield one
    finally:
        one.end()
        thread.join(15.0)
        assert not thread.is_alive()
