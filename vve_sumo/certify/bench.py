"""Drives a case in a run's own process: starts the brain, puts the fault on its wires, keeps its setpoints.

Knows how a drive and a brain are started and ended; it must not know what a case requires.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from typing import Any, Final

from vve_sumo.certify import case_record
from vve_sumo.certify.brain_process import BrainProcess
from vve_sumo.certify.cases import CASE_BY_NAME, Case, Scene
from vve_sumo.certify.link import FaultLink, FaultyWire, Window
from vve_sumo.certify.moments import speeds_at, track_of
from vve_sumo.certify.phantom_contents import LidarMount
from vve_sumo.certify.phantoms import Installation
from vve_sumo.certify.places import Place
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import Drive
from vve_sumo.errors import ConfigError
from vve_sumo.live.brain_link import key_of
from vve_sumo.live.external_lockstep import external_controller_over, open_wires
from vve_sumo.record.hashes import hash_file
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig
from vve_sumo.sensors.lidar_settings import LidarSettings
from vve_sumo.sweep.job import Job, MetricValue

#: a brain whose process is unknown counts as idle after this time [s]
MANUAL_QUIET_TIME: Final = 0.1
#: this module's function that drives a job, as a job names it
DRIVER: Final = f"{__name__}:drive_case"


def order(
    case: Case, window: Window | None, place: Place, nominal: Path, log: Path, environment: Mapping[str, str]
) -> dict[str, Any]:
    """Return what a case's job says beyond its scenario.

    `nominal` is the record of the drive without a fault; `log` the file for the brain's output, whose process has the
    `environment`.
    """
    return {
        "case": case.name,
        "begins": None if window is None else window.begins,
        "place": place.to_dict(),
        "nominal": str(nominal),
        "log": str(log),
        "environment": dict(environment),
    }


def window_of(case: Case, begins: float | None) -> Window | None:
    """Return the window of a case's fault that begins at a drive time; None where nothing is injected."""
    return None if begins is None else Window(begins, begins + case.lasts)


def drive_case(
    job: Job, resolved: ResolvedScenario, drive: Callable[[ExternalController], Drive]
) -> tuple[Drive, dict[str, MetricValue]]:
    """Drive a case's job; return the drive, and what its record does not hold.

    Raises ConfigError for a brain that cannot be started, RigError for one that does not listen.
    """
    assert job.rig is not None
    case_settings, case = job.driven, CASE_BY_NAME[job.driven["case"]]
    place = Place.from_dict(load_rig(job.rig, job.working), case_settings["place"])
    window = window_of(case, case_settings["begins"])
    with _brain(place, case_settings, job.working) as (quiet, unheard), ExitStack() as stack:
        link = _link(case, resolved, window, place.rig, case_settings, job.working, quiet)
        stack.callback(link.close)
        brain = external_controller_over(link, place.rig, resolved, job.working)
        done = drive(brain)
    case_record.write(done.folder, link.answers)
    refused = "; ".join(f"{code}: {times}" for code, times in sorted(brain.refused.items()))
    taken = {"setpoints_taken": brain.taken, "setpoints_refused": refused, "unheard": " ".join(unheard)}
    return done, {
        "fault_begins_s": case_settings["begins"],
        **taken,
        "setpoints_sha256": hash_file(done.folder / case_record.ANSWERS),
    }


@contextmanager
def _brain(
    place: Place, case_settings: Mapping[str, Any], working: Path
) -> Iterator[tuple[Callable[[], bool], tuple[str, ...]]]:
    """Start a brain; yields the function that tells whether it is idle, and the wires that it does not receive."""
    if place.command is None:
        yield _manual_quiet, ()
        return
    ports, log = place.ports, Path(case_settings["log"])
    log.parent.mkdir(parents=True, exist_ok=True)
    process = BrainProcess(place.command, ports, log, working, case_settings["environment"])
    try:
        unheard = process.wait_until_it_listens([port for port, kind in ports.items() if kind == "radar"])
        yield process.quiet, tuple(sorted(ports[port] for port in unheard))
    finally:
        process.close()


def _manual_quiet() -> bool:
    time.sleep(MANUAL_QUIET_TIME)
    return True


def _link(
    case: Case,
    resolved: ResolvedScenario,
    window: Window | None,
    rig: Rig,
    case_settings: Mapping[str, Any],
    working: Path,
    quiet: Callable[[], bool],
) -> FaultLink:
    key = key_of(rig.brain, working)
    wires, setpoints = open_wires(rig, resolved, key)
    assert setpoints is not None  # a rig without setpoints is refused
    rng = Random(f"{case.name} {resolved.scenario.seed}")
    scene = (
        None
        if window is None or case.make_scan_fault is None
        else _scene(Path(case_settings["nominal"]), window, resolved)
    )
    faulty = [
        FaultyWire(
            wire.output,
            wire.outlet,
            case.make_wire_fault(rng) if case.make_wire_fault and output.kind in case.wires else None,
            case.make_scan_fault(scene) if case.make_scan_fault and scene and output.kind in case.wires else None,
        )
        for output, wire in zip(rig.outputs, wires, strict=True)
    ]
    return FaultLink(faulty, setpoints, window, quiet, rig.brain.deadline_s, key)


def _scene(nominal: Path, window: Window, resolved: ResolvedScenario) -> Scene:
    drive = case_record.drive_of(nominal)
    (speed,) = speeds_at(drive, [window.begins]).tolist()
    return Scene(track_of(drive), window.begins, installation_of(resolved), speed)


def installation_of(resolved: ResolvedScenario) -> Installation:
    """Return where a scenario's sensors are; raises ConfigError for a lidar of a kind of one's own."""
    mounts = {}
    for name, settings in resolved.sensors().items():
        if isinstance(settings, LidarSettings):
            own = settings.config()
            mounts[name] = LidarMount(own.x, own.y, own.z, own.yaw, own.elevations)
        elif "points" in settings.serves:
            raise ConfigError(f"sensor {name}: expected the shipped lidar: where the rays of another go is not known")
    return Installation(bumper_of(resolved), resolved.map_frame, mounts)


def bumper_of(resolved: ResolvedScenario) -> float:
    """Return the distance from the rear axle to the front bumper [m]."""
    return resolved.vehicle.wheelbase + resolved.vehicle.front_overhang
