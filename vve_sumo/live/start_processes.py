"""Starts what a live drive consists of: the receivers and simulated vehicles, then recorders, gateways and the drive.

First every real car says where it stands; then each process gets only the channel ends that it needs.
"""

from __future__ import annotations

import contextlib
import datetime
import subprocess
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vve_sumo.drive import plugged_in, provenance
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.several_egos import BESIDE_LIVE
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import RigError
from vve_sumo.live import assembly, optional_processes, spawn, start_simulated_vehicle
from vve_sumo.live.alignment import lot_alignment
from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.console import FurtherProcesses, ProcessGroup
from vve_sumo.live.optional_processes import Notify
from vve_sumo.live.plan import DrivePlan
from vve_sumo.people import consent
from vve_sumo.pose.sources import Source
from vve_sumo.record.roads import write_roads
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.validation import PTY
from vve_sumo.values import EGO


@dataclass(frozen=True, slots=True)
class BegunCar:
    """A real car that has said where it stands, before any process of the drive but its own runs."""

    plan: DrivePlan
    ground: LotAlignment
    content: dict[str, Any]  #: of its record's scenario.json
    provenance: str
    car: start_simulated_vehicle.SimulatedVehicleProcess | None
    locks: tuple[int, ...]  #: of its rig

    @property
    def common(self) -> dict[str, Any]:
        """What each of the car's processes is told."""
        return {"folder": str(self.plan.folder), "t0": self.plan.t0, "epoch": self.ground.epoch}


def open_car(
    plan: DrivePlan, stack: contextlib.ExitStack
) -> tuple[Source, start_simulated_vehicle.SimulatedVehicleProcess | None]:
    """Open the receiver of a real car, and start the vehicle where the rig's is simulated."""
    scenario = plan.resolved.scenario
    try:
        return start_simulated_vehicle.open_receiver(
            plan.rig, plan.t0, _seed(plan), stack, plan.folder, scenario.weather.friction
        )
    except RigError:
        _remove_begun(plan.folder)
        raise


def _seed(plan: DrivePlan) -> int:
    """Return the seed of a simulated vehicle's noise, which the ego's id decides besides the scenario's seed."""
    seed = plan.resolved.scenario.seed
    return seed if plan.ego == EGO else seed + zlib.crc32(plan.ego.encode())


def begin_car(
    plan: DrivePlan,
    source: Source,
    car: start_simulated_vehicle.SimulatedVehicleProcess | None,
    locks: tuple[int, ...],
    provenance_text: str,
    notify: Notify,
) -> BegunCar:
    """Measure where a car stands, and return all that its record's scenario.json says."""
    plan.folder.mkdir(parents=True, exist_ok=True)
    ground = _measure_alignment(plan, source, notify)
    scenario_content = plan.resolved.to_dict(plan.working) | ground.to_dict()
    scenario_content |= assembly.to_dict(plan.resolved, plan.scenario_file, plan.rig_file.stem, plan.rig)
    scenario_content["gateway"]["shadow"] = plan.shadow
    if (stations := assembly.stations_setup(plan.resolved, plan.rig, ground)) is not None:
        scenario_content["stations"] = stations.to_dict()
    if any(person.pages for person in plan.resolved.people):
        scenario_content["people_consent"] = consent.TEXT
    scenario_content["files_sha256"] |= plugged_in.digests(plugged_in.receiver(plan.rig.pose.kind).files())
    _write_roads(plan.folder, plan.resolved, notify)
    return BegunCar(plan, ground, scenario_content, provenance_text, car, locks)


def _remove_begun(folder: Path) -> None:
    """Remove the folder of a drive whose simulated vehicle or receiver cannot be had, unless it holds more."""
    with contextlib.suppress(OSError):
        (folder / "car.log").unlink(missing_ok=True)
        folder.rmdir()


def _measure_alignment(plan: DrivePlan, source: Source, notify: Notify) -> LotAlignment:
    """Measure the alignment and GNSS time while the car stands; close `source`, for the drive's process to open it."""
    rig, resolved = plan.rig, plan.resolved
    notify(assembly.waiting_for_fixes(rig))
    try:
        standing = assembly.standing_pose_of(rig, source, plan.t0)
    finally:
        source.close()
    begin = resolved.path.at(0.0)
    stored = meaning.alignment_of(rig, resolved.scenario.road.network)
    start = pose_at_rest(begin.x, begin.y, begin.heading)
    return lot_alignment(standing, meaning.frame_of(rig), meaning.mounting_of(rig), start, stored)


def _not_ready(plan: DrivePlan, ground: LotAlignment, notify: Notify) -> tuple[str, ...]:
    """Return the reason codes that keep this drive from READY for as long as it lasts."""
    geofence, resolved = meaning.geofence_of(plan.rig, ground.alignment), plan.resolved
    leaves = geofence.along(resolved.path, resolved.scenario.ego.speed_mps, resolved.corridor)
    if leaves is None:
        return ()
    what = "the path or its corridor" if resolved.corridor else "the path"
    notify(
        f"{what} leaves the lot: from {leaves:.0f} m on, the car could not stop inside it; "
        "vve-sumo align --fit proposes how to lay it"
    )
    return ("path_leaves_lot",)


def start_processes(
    plan: DrivePlan, begun: Sequence[BegunCar], grounds: Mapping[str, LotAlignment], notify: Notify
) -> ProcessGroup:
    """Start recorders, gateways and drive, each with only the channel ends that it needs.

    A gateway holds its rig's locks too: where the console is killed, it still commands the car until it stands.
    `grounds` are those of the simulated egos, by their ids.
    """
    console_drive, drive_console = pair()
    first, *further = begun
    # Before the recorder: where the page or a wire cannot be opened, there is no record.
    optional = optional_processes.start(plan, first.common, first.content, notify)
    recorder, gateway, console_gateway, feeds = _car_processes(first)
    channels = feeds | {"console": drive_console}
    more: list[FurtherProcesses] = []
    for one in further:
        own_recorder, own_gateway, to_gateway, feeds = _car_processes(one)
        channels |= {f"{name}:{one.plan.ego}": end for name, end in feeds.items()}
        car, to_car = (one.car.process, one.car.channel) if one.car is not None else (None, None)
        automatic = one.plan.rig.operator.automatic
        more.append(FurtherProcesses(one.plan.ego, own_recorder, own_gateway, to_gateway, automatic, car, to_car))
    for ego in plan.simulated:
        drive_recorder, recorder_drive = pair()
        channels[f"recorder:{ego.ego_id}"] = drive_recorder
        more.append(
            FurtherProcesses(ego.ego_id, _simulated_recorder(plan, ego, grounds[ego.ego_id], recorder_drive, notify))
        )
    config = first.common | {
        "resolved": first.content,
        "working": str(plan.working),
        "not_ready": _not_ready(plan, first.ground, notify),
        "log": str(plan.folder / "drive.log"),
    }
    if further:
        config["further_cars"] = [
            {
                "ego": one.plan.ego,
                "resolved": one.content,
                "not_ready": _not_ready(one.plan, one.ground, notify),
            }
            for one in further
        ]
    drive = spawn.start("drive", config, channels | optional.feeds, own_session=True)
    process, to_car = (first.car.process, first.car.channel) if first.car is not None else (None, None)
    return ProcessGroup(
        gateway,
        drive,
        recorder,
        process,
        optional.outputs,
        optional.view,
        optional.people,
        optional.stations,
        console_gateway,
        console_drive,
        to_car,
        optional.to_view,
        tuple(more),
    )


def _car_processes(
    one: BegunCar,
) -> tuple[subprocess.Popen[bytes], subprocess.Popen[bytes], Channel, dict[str, Channel]]:
    """Start a car's recorder and gateway; return both, the console's channel to the gateway, and the drive's ends."""
    console_gateway, gateway_console = pair()
    drive_gateway, gateway_drive = pair()
    drive_recorder, recorder_drive = pair()
    gateway_recorder, recorder_gateway = pair()
    folder, rig, car = one.plan.folder, one.plan.rig, one.car
    recorder = spawn.start(
        "recorder",
        one.common | {"resolved": one.content, "provenance": one.provenance, "log": str(folder / "recorder.log")},
        {"drive": recorder_drive, "gateway": recorder_gateway},
        own_session=True,
    )
    interface, channel = car.bus if car is not None and rig.bus.channel == PTY else (rig.bus.interface, rig.bus.channel)
    bus = {"interface": interface, "channel": channel, "bitrate": rig.bus.bitrate}
    gateway = spawn.start(
        "gateway",
        one.common | one.content["gateway"] | {"bus": bus, "log": str(folder / "gateway.log")},
        {"drive": gateway_drive, "console": gateway_console, "recorder": gateway_recorder},
        own_session=True,
        inherited=one.locks,
    )
    return recorder, gateway, console_gateway, {"gateway": drive_gateway, "recorder": drive_recorder}


def _simulated_recorder(
    plan: DrivePlan, ego: ResolvedScenario, ground: LotAlignment, drive: Channel, notify: Notify
) -> subprocess.Popen[bytes]:
    """Start the recorder of a simulated ego, whose record is that of a lockstep drive."""
    folder = plan.folder_of(ego.ego_id)
    folder.mkdir(parents=True, exist_ok=True)
    _write_roads(folder, ego, notify)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return spawn.start(
        "recorder",
        {
            "folder": str(folder),
            "epoch": ground.epoch,
            "resolved": ego.to_dict(plan.working) | ground.to_dict() | {BESIDE_LIVE: True},
            "provenance": provenance.text_of(provenance.provenance(ego, now)),
            "log": str(folder / "recorder.log"),
        },
        {"drive": drive},
        own_session=True,
    )


def _write_roads(folder: Path, resolved: ResolvedScenario, notify: Notify) -> None:
    """Write the lanes around the path; a disk that is full is the recorder's to report, and stops no drive."""
    try:
        write_roads(folder, resolved.lanes)
    except OSError as error:
        notify(f"{folder / 'roads.parquet'} cannot be written: {error.strerror}; make room")
