"""Starts the simulated vehicle of a rig, for a drive and for commands that only look at the rig.

Knows the rig's tables and the car's process; no scenario, no gateway. Nothing is commanded here.
"""

from __future__ import annotations

import contextlib
import select
import subprocess
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from vve_sumo.errors import RigError
from vve_sumo.live import assembly, messages, spawn
from vve_sumo.live.channel import Channel, pair
from vve_sumo.live.simulated_vehicle import CarConfig
from vve_sumo.messages import MalformedMessage
from vve_sumo.pose.sources import Source
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.car_parameters import DRY, perturbed
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import PTY
from vve_sumo.vehicle.model import VehicleModel

#: longest time for the car to report that it is ready, and to end [s]
START_TIMEOUT: Final = 30.0


@dataclass(slots=True)
class SimulatedVehicleProcess:
    """The simulated vehicle's process; it ends when `channel` is closed and the car stands."""

    process: subprocess.Popen[bytes]
    channel: Channel
    bus: tuple[str, str]  #: interface and channel that others open


def open_receiver(
    rig: Rig, t0: float, seed: int, stack: contextlib.ExitStack, folder: Path | None, friction: float = DRY
) -> tuple[Source, SimulatedVehicleProcess | None]:
    """Open a rig's receiver, and start the simulated vehicle where the rig has one; `stack` closes both.

    The receiver comes first: if another program has its port, the vehicle must not send to it. Where there is nothing
    to open before the far end is there, the vehicle comes first, whose far end is then on a port or a link that no
    other program has. Raises RigError naming the rig's key, or with the car's message.
    """
    simulated = rig.car == "simulated"
    first = simulated and meaning.receiver_of(rig).far_end_first
    car = start(rig, t0, seed, stack, folder, friction) if first else None
    source = assembly.source_of(rig)
    stack.callback(source.close)
    if simulated and not first:
        car = start(rig, t0, seed, stack, folder, friction)
    return source, car


def start(
    rig: Rig, t0: float, seed: int, stack: contextlib.ExitStack, folder: Path | None, friction: float = DRY
) -> SimulatedVehicleProcess:
    """Start the car and wait until it is ready; it is ended when `stack` is closed.

    `t0` is the monotonic second of drive time 0, `seed` and `friction` are the scenario's. Truth and log go into
    `folder`, if there is one; it is made where it is not there. Raises RigError with the car's message if it does not
    start.
    """
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    config = _config(rig, t0, seed, folder, friction).to_dict()
    ours, theirs = pair()
    log = {} if folder is None else {"log": str(folder / "car.log")}
    process = spawn.start("simulated_vehicle", config | log, {"console": theirs}, own_session=True)
    stack.callback(spawn.end, process, START_TIMEOUT)
    stack.callback(ours.close)
    match _first_message(ours):
        case messages.Ready((interface, channel)):
            return SimulatedVehicleProcess(process, ours, (interface, channel))
        case messages.Refused(text):
            raise RigError(f"the simulated vehicle: {text}")
        case message:
            raise RigError(f"the simulated vehicle: {message}")


def _config(rig: Rig, t0: float, seed: int, folder: Path | None, friction: float) -> CarConfig:
    start, pose = rig.car_start, rig.pose
    assert start is not None  # the rig's validation ensures it, and a receiver that can be simulated
    wire = rig.bus.interface, start.channel or rig.bus.channel
    parameters = perturbed(_uncalibrated(meaning.model_of(rig)), start, friction)
    return CarConfig(
        parameters=replace(parameters, receiver=replace(parameters.receiver, rate=pose.rate_hz)),
        lot=meaning.frame_of(rig),
        latitude_deg=start.latitude_deg,
        longitude_deg=start.longitude_deg,
        heading_deg=start.heading_deg,
        epoch=assembly.wall_epoch(t0),
        t0=t0,
        seed=seed,
        receiver=pose.model_dump(mode="json", exclude_unset=True),
        bus=None if rig.bus.channel == PTY else wire,
        faults=meaning.faults_of(rig),
        truth=None if folder is None else folder / "truth.csv",
        brain=start.brain_channel,
        bus_log=None if folder is None or start.brain_channel is None else folder / "bus.log",
    )


def _uncalibrated(model: VehicleModel) -> VehicleModel:
    """Return a model without its two corrections: `car_start` states how the car really stands, calibrated or not."""
    return replace(model, steering_wheel_bias=0.0, mounting=replace(model.mounting, heading_misalignment=0.0))


def _first_message(channel: Channel) -> messages.ConsoleMessage | MalformedMessage:
    deadline = time.monotonic() + START_TIMEOUT
    while (left := deadline - time.monotonic()) > 0.0 and not channel.closed:
        select.select([channel], [], [], left)
        for data in channel.receive():
            return messages.decode(data)
    raise RigError(f"the simulated vehicle did not come up within {START_TIMEOUT:.0f} s")
