"""Runs the process of a live drive's page: samples of the drive in, frames to browsers out, requests to stop out.

It is fed one way and never waited for. Towards the car it can do one thing: any datagram on its channel to the console
is the operator's stop. When this process dies, the drive goes on.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from vve_sumo.errors import ConfigError, VveError
from vve_sumo.live import messages, signals
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import OOM_RECORDER, lower_priority, set_oom_score
from vve_sumo.live.spawn import receive_config
from vve_sumo.live.wording import GatewayProcessState, phase, why
from vve_sumo.record.roads import read_roads
from vve_sumo.version import __version__
from vve_sumo.view import topic_stream
from vve_sumo.view.guard import STOP_PATH
from vve_sumo.view.hub import Hub
from vve_sumo.view.live_frame import LiveFrames
from vve_sumo.view.sample import ViewSample, decode
from vve_sumo.view.scene import VERSION, scene_of
from vve_sumo.view.server import NO_FRAMES, PageServer, json_route, page_routes
from vve_sumo.view.street import with_network
from vve_sumo.view.topic_stream import TopicStream

if TYPE_CHECKING:
    from vve_sumo.live.foxglove_topics import LiveTopics

#: file in the record's folder with the page's address while the drive goes on; only its owner may read it
ADDRESS_FILE: Final = "view.json"
#: where viewers of topics connect to, after the token
VIEWERS_PATH: Final = "foxglove"
#: of samples that come at once viewers of topics get the messages of the newest few: a page comes before them
MAX_BEHIND: Final = 5
#: open files of this process, at most: its connections among them, whose number `guard` bounds to fewer
MAX_FILES: Final = 256
#: a gateway whose newest status is older counts as silent [s]
SILENT: Final = 0.2
#: for pages to hear that the drive is over [s]
CLOSING_TIME: Final = 0.3
#: the request to stop; the console reads no content
STOP: Final = b"stop"

#: what a phase says after its colon is left out where it is about the console's keys
_KEYS: Final = ("key", "press r", "e engages", "e begins", "g goes")


def status_in_words(status: Mapping[str, Any]) -> str:
    """Return a drive's phase and the reasons for it in plain words, as the console has them, without its keys."""
    silent = SILENT < status["status_age_s"] < float("inf")
    shown = {**status, "gateway": (GatewayProcessState.SILENT if silent else GatewayProcessState.RESPONDING).value}
    words = phase(shown)
    head, _, tail = words.partition(": ")
    reasons = "; ".join(why(shown))
    kept = head if any(key in tail for key in _KEYS) else words
    if not reasons:
        return kept
    return f"{kept}; {reasons}" if ": " in kept else f"{kept}: {reasons}"


class ViewProcess:
    """The page's process: one event loop for the feed and the server."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel]) -> None:
        """Bind the server's socket; raises ConfigError where that cannot be done."""
        folder = Path(config["folder"])
        self._drive, self._console = channels["drive"], channels["console"]
        self._frames = LiveFrames(config["resolved"], status_in_words)
        scene = scene_of(config["resolved"], read_roads(folder), source="live")
        self._hub = Hub(self._frames, with_network(scene, config["resolved"], Path.cwd()))
        self._over = asyncio.Event()
        self._ended = False  # the console takes no request to stop any more
        self._verdict: dict[str, Any] | None = None
        self._viewers = _viewers(config["resolved"], folder) if config["foxglove"] else None
        contents = {"version": VERSION, "kind": "live", "records": []}
        routes = [
            Route(STOP_PATH, self._stop, methods=["POST"]),
            WebSocketRoute("/socket", self._hub.watch),
            json_route("/contents.json", lambda request: contents),
            *page_routes(NO_FRAMES),
        ]
        more: dict[str, Any] = {name: config[name] for name in ("address", "port", "token", "certificate")}
        if self._viewers is not None:
            routes.insert(0, WebSocketRoute(f"/{VIEWERS_PATH}", self._viewers.stream.watch))
            more |= {"foreign": (VIEWERS_PATH,), "max_message": topic_stream.MAX_MESSAGE}
        self.server = PageServer(routes, **more)

    @property
    def addresses(self) -> tuple[str, ...]:
        """What a browser opens, and, where topics are served, what viewers of them connect to."""
        page = self.server.address
        return (page,) if self._viewers is None else (page, f"ws{page.removeprefix('http')}{VIEWERS_PATH}")

    async def run(self) -> None:
        """Serve until the console is gone."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._drive.fileno(), self._read_drive)
        loop.add_reader(self._console.fileno(), self._read_console)
        serving = asyncio.create_task(self.server.serve())
        await self._over.wait()
        self._hub.end(self._verdict)
        if self._viewers is not None:
            self._viewers.stream.end()
        await asyncio.sleep(CLOSING_TIME)
        self.server.close()
        await serving

    def _read_drive(self) -> None:
        samples = [sample for datagram in self._drive.receive() if isinstance(sample := decode(datagram), ViewSample)]
        events = [event for sample in samples for event in self._frames.take(sample)]
        if self._drive.closed:
            asyncio.get_running_loop().remove_reader(self._drive.fileno())
        self._hub.changed(events)
        self._tell_viewers(samples)

    def _tell_viewers(self, samples: Sequence[ViewSample]) -> None:
        """Hand samples to the viewers of topics; whatever goes wrong there ends these alone, not the page."""
        if self._viewers is None:
            return
        try:
            for left, sample in zip(range(len(samples), 0, -1), samples, strict=True):
                self._viewers.take(sample, encoded=left <= MAX_BEHIND)
        except Exception:
            traceback.print_exc()
            self._viewers.stream.end()
            self._viewers = None

    def _read_console(self) -> None:
        for datagram in self._console.receive():
            self._ended = True
            message = messages.decode(datagram)
            self._verdict = message.verdict if isinstance(message, messages.Verdict) else None
        if self._console.closed:
            asyncio.get_running_loop().remove_reader(self._console.fileno())
            self._over.set()

    async def _stop(self, request: Request) -> Response:
        """Pass a request to stop on to the console."""
        if not self._ended and self._console.send(STOP):
            return PlainTextResponse("the gateway is asked to stop\n")
        return PlainTextResponse("the console does not take the request: the driver brakes\n", 503)


class _Viewers(NamedTuple):
    """What viewers of topics are served by."""

    topics: LiveTopics
    stream: TopicStream

    def take(self, sample: ViewSample, *, encoded: bool) -> None:
        """Take a sample, and hand its messages on where they are to be encoded."""
        self.stream.publish(self.topics.take(sample, self.stream.wanted if encoded else ()))


def _viewers(resolved: Mapping[str, Any], folder: Path) -> _Viewers:
    """Return them; raises ConfigError where a package of the extra is not installed."""
    try:
        from vve_sumo.live.foxglove_topics import LiveTopics
    except ImportError:
        needed = "mcap-protobuf-support and foxglove-schemas-protobuf"
        raise ConfigError(f"--foxglove needs {needed}: pip install 'vve-sumo[foxglove]'") from None
    topics = LiveTopics(resolved, read_roads(folder))
    about = {"scenario": str(resolved["scenario"]), "vve_sumo": __version__}
    return _Viewers(topics, TopicStream(topics.topics, topics.first, about))


def write_address(file: Path, address: str) -> None:
    """Write a page's address to a file that only its owner may read; a file that cannot be written is left out."""
    with contextlib.suppress(OSError):
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w") as written:
            written.write(json.dumps({"address": address, "pid": os.getpid()}) + "\n")


def main() -> int:
    """Run the process and return its exit code."""
    signals.ignore()
    set_oom_score(OOM_RECORDER)
    lower_priority()
    resource.setrlimit(resource.RLIMIT_NOFILE, (MAX_FILES, MAX_FILES))
    config, channels = receive_config()
    try:
        process = ViewProcess(config, channels)
    except VveError as error:
        channels["console"].send(messages.refusal(error))
        return error.exit_code
    file = Path(config["folder"]) / ADDRESS_FILE
    write_address(file, process.server.address)
    channels["console"].send(messages.encode(messages.Ready(process.addresses)))
    try:
        asyncio.run(process.run())
    finally:
        file.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
