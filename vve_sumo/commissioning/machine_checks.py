"""The doctor's checks that need no rig: this machine, the installed libraries, the time of SUMO's steps.

They open no bus, no socket and no receiver; they run SUMO for some seconds, and write and remove a temporary file.
"""

from __future__ import annotations

import math
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

import numpy as np

from vve_sumo import bus
from vve_sumo.commissioning.findings import Check, CheckResult, judged
from vve_sumo.commissioning.wake_up import wake_up
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.virtual_road import open_world, pose_at_rest, scenario_engine
from vve_sumo.errors import ConfigError
from vve_sumo.frames import move_point
from vve_sumo.live.priority import GATEWAY_PRIORITY, OOM_NEVER, rights
from vve_sumo.scenario.road_users import When
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, EXTENDED, Point, identifier_text
from vve_sumo.vehicle.effective_deceleration import of_model
from vve_sumo.vehicle.interface import InterfaceConfig, has_cantools, load, read_dbc
from vve_sumo.world.step_time import LIMIT

PYTHONS: Final = ((3, 11), (3, 13))  #: oldest and newest version that the package is tested with
#: lowest versions, as the package declares them
LIBRARIES: Final = {
    "libsumo": "1.28.0",
    "sumolib": "1.28.0",
    "numpy": "2.0",
    "scipy": "1.13",
    "pyproj": "3.6",
    "python-can": "4.5",
    "pyarrow": "23.0.1",
    "pydantic": "2.7",
    "shapely": "2.0.4",
}
EXACT: Final = ("libsumo", "sumolib")  #: no other release is tested
PROCESSES: Final = 4  #: of a live drive, each of which needs a processor
RESOLUTION: Final = 1e-4  #: coarsest resolution of the clock that times the ticks [s]
FREE: Final = 1e9  #: disk space for records [bytes]; a minute of driving takes a few million
WRITTEN, PIECES = 131_072, 64  #: bytes of a piece, and number of pieces, in the disk test
RATE: Final = 2e6  #: lowest rate of writing [bytes/s]; ten times what a record grows by
ROUND_TRIP: Final = 1e-3  #: largest error of projecting there and back [m]
STEPS: Final = 200  #: number of street steps that are timed
CAN_LINK: Final = "280"  #: Linux's type of a CAN link, ARPHRD_CAN


def machine(working: Path) -> Iterator[Check]:
    """Check the machine and what is installed on it."""
    yield _python()
    yield _libraries()
    yield _processors()
    yield _clock()
    yield _priority()
    yield wake_up()
    yield _can()
    yield from _disk(working / "runs")


def _python() -> Check:
    first, last = (".".join(map(str, bound)) for bound in PYTHONS)
    good = PYTHONS[0] <= sys.version_info[:2] <= PYTHONS[1]
    return judged("python", platform.python_version(), good, f"install one of {first} to {last}")


def _libraries() -> Check:
    """Check the versions of the libraries that affect a drive."""
    installed, wrong = [], []
    for name, wanted in LIBRARIES.items():
        try:
            there = version(name)
        except PackageNotFoundError:
            there = "none"
        installed.append(f"{name} {there}")
        good = there == wanted if name in EXACT else _parts(there) >= _parts(wanted)
        if not good:
            wrong.append(f"{name} {wanted}" + ("" if name in EXACT else " or newer"))
    return judged("libraries", ", ".join(installed), not wrong, f"install {', '.join(wrong)}")


def _parts(text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", text)[:3])


def _processors() -> Check:
    count = len(os.sched_getaffinity(0))
    advice = (
        f"a live drive is {PROCESSES} processes that may not wait for each other; {PROCESSES} processors are better"
    )
    few = CheckResult.NOTE if count > 1 else CheckResult.NO_GO
    return judged("processors", f"{count} for this process", count >= PROCESSES, advice, otherwise=few)


def _clock() -> Check:
    resolution = time.get_clock_info("monotonic").resolution
    found = f"monotonic, resolution {resolution * 1e9:.0f} ns"
    return judged("clock", found, resolution <= RESOLUTION, "the kernel keeps time too coarsely for ticks of 20 ms")


def _priority() -> Check:
    """Whether the kernel would run the gateway first, keep it in memory, and spare it when memory runs out."""
    permitted = rights()
    words = {True: "permitted", False: "not permitted"}
    found = f"real-time priority {GATEWAY_PRIORITY} {words[permitted.real_time]}, "
    found += f"locking memory {words[permitted.memory]}, oom_score_adj {OOM_NEVER} {words[_spared_by_kernel()]}"
    lacking = permitted.lacking()
    return judged("priority", found, not lacking, lacking, otherwise=CheckResult.NOTE)


def _spared_by_kernel() -> bool:
    """Whether the kernel would spare the gateway when memory runs out; tried with this process, then undone."""
    own = Path("/proc/self/oom_score_adj")
    try:
        before = own.read_text(encoding="ascii")
        own.write_text(f"{OOM_NEVER}\n", encoding="ascii")
        own.write_text(before, encoding="ascii")
    except OSError:
        return False
    return True


def _can() -> Check:
    """List the kernel's CAN links; adapters that are no link are checked when a rig names them."""
    links = []
    for link in sorted(Path("/sys/class/net").glob("*")):
        if (link / "type").read_text(encoding="ascii").strip() == CAN_LINK:
            links.append(f"{link.name} {(link / 'operstate').read_text(encoding='ascii').strip()}")
    found = f"SocketCAN: {', '.join(links) or 'no link'}; python-can knows {', '.join(bus.interfaces())}"
    return Check("can", found, CheckResult.GO if links else CheckResult.NOTE)


def dbc(config: InterfaceConfig) -> Check:
    """Check the DBC file of a drive-by-wire interface by cantools, a reader that the interface does not use itself.

    Raises ConfigError where the interface cannot be made or the file is none that cantools takes.
    """
    facts = load(config).facts
    if facts.dbc is None:
        return Check("dbc", f"none stated by {facts.title}")
    if not has_cantools():
        advice = "reading the DBC file needs cantools: pip install 'vve-sumo[dbc]'"
        return Check("dbc", "not checked", CheckResult.NOTE, advice)
    messages = {message.frame_id | EXTENDED * message.is_extended_frame for message in read_dbc(facts.dbc).messages}
    unknown = (facts.commands | facts.reports.keys()) - messages
    found = f"{len(messages)} messages of {facts.title} in {facts.dbc.name}"
    lacking = ", ".join(map(identifier_text, sorted(unknown)))
    return judged("dbc", found, not unknown, f"the file has no message {lacking}, which the interface uses")


def _disk(folder: Path) -> Iterator[Check]:
    """Check free space and writing speed where records are kept."""
    there = next(place for place in (folder, *folder.parents) if place.is_dir())
    free = shutil.disk_usage(there).free
    yield judged(
        "disk", f"{free / 1e9:.1f} GB free in {there}", free >= FREE, "make room, or drive with --out elsewhere"
    )
    try:
        rate, longest = _written(there)
    except OSError as error:
        yield Check(
            "disk speed", f"{there}: {error.strerror}", CheckResult.NO_GO, "drive with --out where you may write"
        )
        return
    found = f"{rate / 1e6:.0f} MB/s, longest write {1e3 * longest:.1f} ms"
    yield judged("disk speed", found, rate >= RATE, "drive with --out on a faster disk")


def _written(folder: Path) -> tuple[float, float]:
    """Return how fast the disk writes a file [bytes/s], and its longest single write [s]."""
    piece, longest = os.urandom(WRITTEN), 0.0
    with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        begun = time.perf_counter()
        for _ in range(PIECES):
            before = time.perf_counter()
            file.write(piece)
            longest = max(longest, time.perf_counter() - before)
        os.fsync(file.fileno())
        return PIECES * WRITTEN / (time.perf_counter() - begun), longest


def braking(resolved: ResolvedScenario) -> Check:
    """Check how hard the car brakes as it is driven, and whether that is what is declared of it."""
    model = resolved.model
    if resolved.note:
        advice = "controllers plan with that; is drive_by_wire, of the vehicle or of the rig, this car's own?"
        return Check("braking", resolved.note, CheckResult.NOTE, advice)
    laden, mass = of_model(model, mass_factor=model.laden_factor), model.simulated.laden_mass
    return Check("braking", f"{of_model(model).in_words()}; laden with {mass:g} kg {laden.value:.2f} m/s2")


def network(resolved: ResolvedScenario) -> Iterator[Check]:
    """Project the network's corners and its middle to the Earth and back."""
    left, low, right, high = resolved.network.boundary
    places = [(x, y) for x in (left, 0.5 * (left + right), right) for y in (low, 0.5 * (low + high), high)]
    lost = max(math.dist(place, resolved.map_frame.to_map(*resolved.map_frame.to_geodetic(*place))) for place in places)
    found = (
        f"{resolved.network.path.name}, {right - left:.0f} by {high - low:.0f} m; there and back within {lost:.1e} m"
    )
    yield judged("network", found, lost <= ROUND_TRIP, "its projection has no inverse: build it again from map data")


def virtual_road(resolved: ResolvedScenario) -> Iterator[Check]:
    """Step the virtual road with its traffic at the pace of a drive, the ego standing at its start, and time the steps.

    All of the scenario's actors enter at the first step, so that their cost shows here and not during a drive.
    Raises ConfigError and SimulationError as `World` does.
    """
    begin, took = resolved.path.at(0.0), []
    ego = move_point(
        pose_at_rest(begin.x, begin.y, begin.heading), resolved.vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER
    )
    cast = scenario_engine(_all_at_once(resolved))
    with open_world(resolved, time.perf_counter) as world:
        begun = time.monotonic()
        for step in range(STEPS):
            before = time.perf_counter()
            world.set_actors(cast.step(step * PERIOD, ego))
            faults = world.step({EGO: replace(ego, time=step * PERIOD)})[EGO].faults
            took.append(time.perf_counter() - before)
            if faults:
                raise ConfigError(f"the virtual road does not take the ego at the path's start: {', '.join(faults)}")
            time.sleep(max(0.0, begun + (step + 1) * PERIOD - time.monotonic()))
        budget = world.step_time_budget
    assert budget is not None  # for there is a clock
    yield _judged_virtual_road(took, budget.fits, budget.summary)
    if actors := resolved.scenario.actors:
        yield Check("actors", f"{len(actors)}, all at once on the virtual road whose steps were timed")


def _all_at_once(resolved: ResolvedScenario) -> ResolvedScenario:
    """The scenario with actors that enter at once and have no events."""
    actors = tuple(one.model_copy(update={"enters": When(), "events": ()}) for one in resolved.scenario.actors)
    return replace(resolved, scenario=resolved.scenario.model_copy(update={"actors": actors}))


def _judged_virtual_road(took: list[float], fits: bool, load: dict[str, float]) -> Check:
    p50, p99 = (1e3 * float(value) for value in np.quantile(took, (0.5, 0.99)))
    found = f"{len(took)} steps: median {p50:.1f} ms, p99 {p99:.1f} ms of {1e3 * LIMIT:.0f} ms"
    kept_out = int(load["refused"] + load["removed"])
    if kept_out:
        found += f"; {kept_out} vehicles kept off the virtual road"
    advice = "take lighter traffic or fewer actors, let nothing else run, or take a faster machine"
    if not fits:
        return Check("street", found, CheckResult.NO_GO, advice)
    return judged("street", found, not kept_out and p99 <= 1e3 * LIMIT, advice, otherwise=CheckResult.NOTE)
