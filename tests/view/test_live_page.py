"""A live drive's page in a real browser, from the address on the console to the stop button, and its process killed."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import time
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import begun, own_rig, vve_sumo
from tests.live.patience import until
from tests.live.records import SHORTER
from tests.view.conftest import holds
from tests.view.test_page import COLOURS
from vve_sumo.record.reader import read_table
from vve_sumo.record.signals import Signals, read_signals
from vve_sumo.timing import PERIOD

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "seen"

# A browser that draws without a graphics card takes both cores, and would fail the drives of other tests.
pytestmark = [pytest.mark.live, pytest.mark.alone]

TRIES = 3
#: a drive has to go on for so long after its page was killed [s]
GOES_ON = 3.0
#: the page has to say that nothing is live within this time [s]
SAID_WITHIN = 0.5
FEED = "document.getElementById('feed').dataset.kind"
FRAME = "vveSumo.shown?.view?.frame"


@dataclass
class Drive:
    """A live drive with a page that goes on."""

    console: subprocess.Popen[str]
    folder: Path
    address: str

    @property
    def view(self) -> int:
        """Process id of the page's process."""
        return int(json.loads((self.folder / "processes.json").read_text(encoding="utf-8"))["view"])

    def end(self) -> dict[str, Any]:
        """Wait for the end; return the summary."""
        self.console.communicate(timeout=120.0)
        return dict(json.loads((self.folder / "summary.json").read_text(encoding="utf-8")))


@contextlib.contextmanager
def driving(folder: Path, *more: str) -> Iterator[Drive]:
    """Begin the shortened drive of the paper with a page."""
    folder.mkdir()
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        scenario = scenario.replace(old, new)
    (folder / "short.toml").write_text(scenario, encoding="utf-8")
    rig = own_rig(folder)
    console = begun("drive", "short.toml", "--rig", str(rig), "--view", "--out", "record", *more, cwd=folder)
    try:
        assert console.stderr is not None
        line = ""
        while "view: " not in line:
            line = console.stderr.readline()
            assert line, "the drive ended before it said where its page is"
        found = re.search(r"view: (http://127\.0\.0\.1:\d+/[\w-]+/)", line)
        assert found, line
        yield Drive(console, folder / "record", found[1])
    finally:
        if console.poll() is None:
            console.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            console.communicate(timeout=60.0)


def kept(page: Any) -> list[dict[str, Any]]:
    """The frames that the page has shown since `watch`."""
    return list(page.evaluate("globalThis.keptFrames"))


WATCH = """() => { globalThis.keptFrames = []; const view = vveSumo.shown.view, show = view.show.bind(view);
  const feed = document.getElementById('feed');
  new MutationObserver(() => {
    if (feed.dataset.kind === 'lost') globalThis.lostAfter ??= performance.now() / 1000 - vveSumo.shown.newest;
  }).observe(feed, { attributes: true });
  view.show = (frame, clock) => {
    keptFrames.push({ t: frame.t, state: frame.state, ego: frame.ego, signals: frame.signals });
    show(frame, clock);
  }; }"""


@dataclass
class Seen:
    """What the page showed of a drive that its button stopped."""

    frames: list[dict[str, Any]]
    lost_after: float  #: from the last frame before the page's process was stopped to the page's saying so [s]
    stopped_after: float  #: from the click to the state on the page [s]
    colours: int
    reported: list[str]  #: of the gateway's states, in the list of events
    said: list[str]  #: on the page's console
    foreign: list[str]  #: requests to other places
    address: str
    printed: str  #: by `vve-sumo view --live`
    unheard: str  #: what the button says when the feed is gone
    summary: dict[str, Any]
    ticks: dict[str, list[Any]]
    signals: Signals  #: of the record


def watched(browser: Any, folder: Path) -> Seen:
    """Drive, look, freeze the page's process, let it go on, cut the feed, press the button."""
    said: list[str] = []
    asked: list[str] = []
    with driving(folder) as drive:
        page = browser.new_context(viewport={"width": 1280, "height": 720}).new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(drive.address)
        until(lambda: holds(page, FRAME), patience=60.0)
        page.evaluate(WATCH)
        until(lambda: holds(page, f"{FRAME}.ego?.speed > 2"), patience=60.0)
        printed = vve_sumo("view", "--live", "record", cwd=folder).stdout
        page.evaluate("() => { globalThis.lostAfter = null; }")
        os.kill(drive.view, signal.SIGSTOP)
        until(lambda: holds(page, f"{FEED} === 'lost'"))
        lost_after = float(page.evaluate("globalThis.lostAfter"))
        assert holds(page, "document.querySelector('article.stale')")
        os.kill(drive.view, signal.SIGCONT)
        until(lambda: holds(page, f"{FEED} === 'live'"))
        colours = page.evaluate(COLOURS)
        reported = page.locator(".events .kind-state").all_inner_texts()
        # The button needs no feed: the socket goes and does not come back.
        page.evaluate("() => { vveSumo.shown.connect = () => {}; globalThis.cut = vveSumo.shown.socket; }")
        clicked = time.monotonic()
        page.evaluate("() => cut.close()")
        until(lambda: holds(page, f"{FEED} === 'lost'"))
        page.click("#stop")
        until(lambda: "asked to stop" in page.inner_text("#stop"))
        unheard = page.inner_text("#stop")
        until(lambda: "stopping" in read_table(drive.folder, "gateway")["state"].to_pylist(), patience=10.0)
        stopped_after = time.monotonic() - clicked
        frames = kept(page)
        page.context.close()
        summary = drive.end()
    ticks = dict(pq.read_table(drive.folder / "ticks.parquet").to_pydict())
    foreign = [one for one in asked if not one.startswith((drive.address, drive.address.rsplit("/", 2)[0] + "/stop"))]
    said_of_signals = read_signals(drive.folder)
    return Seen(
        frames, lost_after, stopped_after, colours, reported, said, foreign, drive.address, printed, unheard, summary,
        ticks, said_of_signals,
    )  # fmt: skip


@pytest.fixture(scope="module")
def seen(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """A drive in which the machine did not fail the simulated vehicle."""
    for number in range(TRIES):
        found = watched(browser, tmp_path_factory.mktemp(f"watched{number}") / "drive")
        if found.summary["outcome"] == "interrupted":
            return found
    raise AssertionError(
        f"{TRIES} drives ended otherwise, the last with {found.summary['outcome']}: {found.summary['reasons']}"
    )


def test_the_ego_on_the_page_is_the_records(seen: Seen) -> None:
    at = {round(time, 4): row for row, time in enumerate(seen.ticks["time_s"])}
    shown = [frame for frame in seen.frames if frame["ego"]]
    assert len(shown) >= 3
    assert shown[-1]["ego"]["speed"] > 2.0
    for frame in shown:
        row = at[frame["t"]]
        assert frame["ego"]["x"] == pytest.approx(seen.ticks["x_m"][row], abs=1e-3)
        assert frame["ego"]["y"] == pytest.approx(seen.ticks["y_m"][row], abs=1e-3)
        assert frame["ego"]["speed"] == pytest.approx(seen.ticks["speed_mps"][row], abs=1e-3)
        assert frame["state"] == seen.ticks["state"][row]
    assert [frame["t"] for frame in shown] == sorted(frame["t"] for frame in shown)


def test_signals_show_what_the_record_says(seen: Seen) -> None:
    """A frame has the states after the tick's own step of SUMO, which the record dates at the next tick."""
    assert len(seen.signals) == 6
    for frame in seen.frames:
        if not frame["signals"]:
            continue
        for name, (times, states) in seen.signals.items():
            then = [bisect_right(times, frame["t"] + late) - 1 for late in (-1e-3, 2.5 * PERIOD)]
            assert frame["signals"][name] in states[max(then[0], 0) : then[1] + 1]
    assert sum(bool(frame["signals"]) for frame in seen.frames) >= 3


def test_states_change_on_the_page(seen: Seen) -> None:
    assert seen.frames[-1]["state"] == "engaged"
    assert len(set(seen.reported)) >= 2
    assert seen.colours >= 5


def test_a_feed_that_stops_is_said_in_time(seen: Seen) -> None:
    assert 0.0 < seen.lost_after < SAID_WITHIN


def test_the_button_stops_the_car_without_a_feed(seen: Seen) -> None:
    assert seen.summary["reasons"][0] == "stop_asked_by_page", "it is not recorded as the operator's"
    assert seen.summary["outcome"] == "interrupted"
    assert "stopping" in seen.ticks["state"]
    assert "the gateway was asked to stop" in seen.unheard
    assert seen.stopped_after < 5.0


def test_the_page_complains_of_nothing_and_asks_nobody_else(seen: Seen) -> None:
    assert seen.said == []
    assert seen.foreign == []
    assert seen.printed.strip() == seen.address


@pytest.mark.thorough
def test_a_drive_survives_its_page(tmp_path: Path) -> None:
    """The page's process is killed while the car drives: the gateway goes on obeying, until the operator stops it."""
    summaries = []
    for number in range(TRIES):
        summary, engaged_for = killed_page(tmp_path / f"killed{number}")
        summaries.append(summary)
        if summary["reasons"][:1] == ["stop_asked"] and engaged_for > GOES_ON:
            return
    raise AssertionError(f"{TRIES} drives ended otherwise: {[one['reasons'] for one in summaries]}")


def killed_page(folder: Path) -> tuple[dict[str, Any], float]:
    """Kill the page's process of a drive that moves; return the summary and how long it drove on after that [s]."""
    with driving(folder) as drive:
        until(lambda: (drive.folder / "gateway.arrows").exists(), patience=60.0)
        until(lambda: driven(drive.folder)[0] > 2.0, patience=60.0)
        os.kill(drive.view, signal.SIGKILL)
        _speed, killed_at = driven(drive.folder)
        until(lambda: drive.console.poll() is not None or driven(drive.folder)[1] > killed_at + GOES_ON + 0.5)
        drive.console.send_signal(signal.SIGINT)
        summary = drive.end()
    # The address with its token goes with the drive.
    assert not (drive.folder / "view.json").exists()
    gateway = pq.read_table(drive.folder / "gateway.parquet").to_pydict()
    engaged = [time for time, state in zip(gateway["time_s"], gateway["state"], strict=True) if state == "engaged"]
    return summary, engaged[-1] - killed_at


def driven(folder: Path) -> tuple[float, float]:
    """The newest wheel speed [m/s] and the time of the gateway's newest step [s], by the record."""
    table = read_table(folder, "gateway")
    if table.num_rows == 0:
        return 0.0, 0.0
    return float(table["wheel_speed_mps"][-1].as_py()), float(table["time_s"][-1].as_py())
