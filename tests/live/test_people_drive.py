"""A real browser as the phone of a person beside a live drive: what happens to the car when something goes wrong."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.browser import chromium
from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.live.command_line import begun, own_rig, vve_sumo
from tests.live.patience import until
from vve_sumo.live import review
from vve_sumo.people.consent import TEXT, digest
from vve_sumo.people.reports import FieldEntered, decode
from vve_sumo.record.reader import read_table

pytestmark = [pytest.mark.live]

#: the field's anchor, about 100 m north of the lot of the simulated rig
ANCHOR = {"latitude": 40.0065, "longitude": -83.019}
METRE = 1.0 / 111_000.0  #: of latitude [deg]
FIELD = """
[[people]]
id = "anna"
source = "phone"
latitude_deg = 40.0065
longitude_deg = -83.019
heading_deg = 90.0
least_distance_m = 50.0

[operator]"""
#: nothing is in the car's way: anna stands beside the street
SCENARIO = """
title = "Somebody beside the street"
duration_s = 120.0
[road]
network = "linden"
[ego]
path = "linden_17th"
speed_mps = 8.0
[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0
[[people]]
id = "anna"
at_m = 150.0
offset_m = -40.0
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from chromium()


class Walker:
    """A browser page whose person stands where `place` says, once a second, until something happens to them."""

    processes: dict[str, Any]  #: of the drive

    def __init__(self, browser: Any, address: str) -> None:
        self._context = browser.new_context(geolocation=ANCHOR | {"accuracy": 4.0}, permissions=["geolocation"])
        self.page = self._context.new_page()
        self.page.goto(address)
        until(lambda: self.page.locator("#enter").is_enabled())
        self.page.click("#enter")

    def stand(self, north: float = 0.0) -> None:
        """Be so far north of the anchor [m]."""
        place = ANCHOR | {"latitude": ANCHOR["latitude"] + north * METRE, "accuracy": 4.0}
        self._context.set_geolocation(place)

    def lose_gps(self) -> None:
        self._context.new_cdp_session(self.page).send("Emulation.setGeolocationOverride")

    def hold_positions_back(self, seconds: float) -> None:
        """Let the page's positions wait: as a network does that gets through at last."""
        self.page.evaluate(
            f"""() => {{ const say = vvePerson.say.bind(vvePerson);
            vvePerson.say = (message) => message.type === "position"
              ? setTimeout(() => say({{ ...message, echo: vvePerson.echo }}), {1000 * seconds}) : say(message); }}"""
        )

    def kill_the_process(self) -> None:
        """End the process that serves the page."""
        os.kill(self.processes["people"], signal.SIGKILL)

    def close(self) -> None:
        self._context.close()


class Driven(NamedTuple):
    """A drive that is over."""

    folder: Path
    summary: dict[str, Any]
    happened: float  #: drive time [s]


def json_of(file: Path) -> Any:
    """The document in a file that is about to be written."""
    until(lambda: file.exists() and file.read_text(encoding="utf-8").endswith("\n"))
    return json.loads(file.read_text(encoding="utf-8"))


def driven(browser: Any, folder: Path, happens: Callable[[Walker, float], bool]) -> Driven:
    """Drive with somebody at the anchor; from when the car drives on, `happens` each half second until it is false.

    It is called with the page and the time since then [s].
    """
    file = folder / "beside.toml"
    file.write_text(SCENARIO, encoding="utf-8")
    rig = own_rig(folder, ("\n[operator]", FIELD))
    record = folder / "record"
    process = begun("drive", str(file), "--rig", str(rig), "--out", str(record), cwd=folder)
    try:
        address = record / "people.json"
        until(lambda: address.exists() or process.poll() is not None, 60.0)
        walker = Walker(browser, json_of(address)["address"])
        walker.processes = json_of(record / "processes.json")
        t0 = walker.processes["t0_monotonic_s"]
        steps = 0
        while process.poll() is None and not walker.page.evaluate("vvePerson.view?.car?.speed > 1"):
            steps += 1
            walker.stand(0.01 * (steps % 2))
            time.sleep(0.5)
        begin = time.monotonic()
        while process.poll() is None and happens(walker, time.monotonic() - begin):
            time.sleep(0.5)
        process.communicate(timeout=90.0)
        walker.close()
    finally:
        process.kill()
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    return Driven(record, summary, begin - t0)


def stands(walker: Walker, since: float) -> bool:
    """Go on standing at the anchor for five seconds."""
    if since < 5.0:
        walker.stand(0.01 * (round(2.0 * since) % 2))
    return since < 5.0


def page_killed(walker: Walker, since: float) -> bool:
    if not stands(walker, since):
        walker.page.close()
        return False
    return True


def gps_lost(walker: Walker, since: float) -> bool:
    if not stands(walker, since):
        walker.lose_gps()
        return False
    return True


def five_seconds_old(walker: Walker, since: float) -> bool:
    if 4.5 < since < 5.0:
        walker.hold_positions_back(5.0)
    walker.stand(0.01 * (round(2.0 * since) % 2))
    return True


def thirty_metres_off(walker: Walker, since: float) -> bool:
    walker.stand(0.01 * (round(2.0 * since) % 2) + (30.0 if since > 5.0 else 0.0))
    return True


def walks_to_the_lot(walker: Walker, since: float) -> bool:
    walker.stand(-1.5 * since)
    return True


def presses_stop(walker: Walker, since: float) -> bool:
    if not stands(walker, since):
        walker.page.click("#stop")
        return False
    return True


def process_killed(walker: Walker, since: float) -> bool:
    if not stands(walker, since):
        walker.kill_the_process()
        return False
    return True


CASES = [
    (page_killed, "person_unreachable", 7.4, 9.5),
    (gps_lost, "person_lost", 8.0, 11.0),
    (five_seconds_old, "person_lost", 8.0, 11.5),
    (thirty_metres_off, "person_lost", 8.0, 11.5),
    (walks_to_the_lot, "person_near_lot", 5.0, 60.0),
    (presses_stop, "person_stop", 4.9, 7.0),
    (process_killed, "people_gone", 4.9, 6.0),
]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("happens", "reason", "least", "most"), with_slow(CASES, lambda case: case[0] in (page_killed, walks_to_the_lot))
)
def test_what_happens_to_the_person_stops_the_car(
    browser: Any, tmp_path: Path, happens: Callable[[Walker, float], bool], reason: str, least: float, most: float
) -> None:
    done = driven(browser, tmp_path, happens)
    assert done.summary["outcome"] == "fault", done.summary["reasons"]
    assert done.summary["reasons"][0] == reason
    ticks = read_table(done.folder, "ticks")
    times, faults, states = (ticks[name].to_pylist() for name in ("time_s", "faults", "state"))
    first = next(time for time, said in zip(times, faults, strict=True) if time > done.happened and reason in said)
    assert least <= first - done.happened <= most
    stopping = next(time for time, state in zip(times, states, strict=True) if state == "stopping")
    assert stopping - first < 0.3
    assert max(ticks["speed_mps"].to_pylist()[-5:]) < 0.1
    people = read_table(done.folder, "people")
    if reason == "person_near_lot":
        north = [-1.5 * (time - done.happened) for time in people["time_s"].to_pylist()]
        row = next(n for n, said in enumerate(people["faults"].to_pylist()) if reason in said)
        # The lot's outline lies south of the anchor; the page's position may be half a second old.
        assert people["distance_m"][row].as_py() < 50.0
        assert 100.0 > -north[row] > 5.0
    entered = [decode(data) for data in read_table(done.folder, "people_reports")["datagram"].to_pylist()]
    assert FieldEntered("anna", digest(TEXT)) in entered
    scenario = json.loads((done.folder / "scenario.json").read_text(encoding="utf-8"))
    assert scenario["people_consent"] == TEXT
    assert review.replay(review.inspect(done.folder, REPOSITORY), REPOSITORY).differences == []


@pytest.mark.slow
def test_the_car_stops_before_somebody_simulated(tmp_path: Path) -> None:
    """Nobody has a page then; the walk stands in the middle of the path, 150 m along it."""
    (tmp_path / "walk.csv").write_text("time_s,forward_m,left_m\n0,12,0\n", encoding="utf-8")
    standing = SCENARIO.replace("offset_m = -40.0", "offset_m = -12.0\nturned_deg = 90.0")
    file = tmp_path / "standing.toml"
    file.write_text(f'{standing}[people.simulated]\nwalk = "walk.csv"\naccuracy_m = 4.0\n', encoding="utf-8")
    rig = own_rig(tmp_path, ("\n[operator]", FIELD.replace('"phone"', '"simulated"')))
    record = tmp_path / "record"
    done = vve_sumo("drive", str(file), "--rig", str(rig), "--out", str(record), cwd=tmp_path)
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["outcome"] == "stopped", done.stdout + done.stderr
    assert not summary["collision"]
    assert summary["braked_for"] == "anna"
    assert not (record / "people.json").exists()
    assert review.replay(review.inspect(record, REPOSITORY), REPOSITORY).differences == []
