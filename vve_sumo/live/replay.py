"""Replays a live record through the same pipeline and gateway: the drive's part tick by tick, the gateway's by step.

Starts no process, bus or SUMO. Each part gets its recorded inputs at their recorded times and must answer bit for bit
as recorded. The replay also checks that the setpoints that the gateway received are those that the drive computes from
the recorded bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, islice
from pathlib import Path
from typing import Any, Final

from vve_sumo import bus
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.brain import NoLink, external_controller
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.replay import (
    Difference,
    PipelineInputs,
    compare,
    compare_frames,
    compare_result,
    read_pipeline_inputs,
    read_rows,
    reason_codes,
    replayed_ticks,
)
from vve_sumo.drive.tick_rows import status_columns
from vve_sumo.errors import ConfigError
from vve_sumo.live.assembly import from_dict, pipeline_of
from vve_sumo.live.gateway import build_gateway
from vve_sumo.messages import MalformedMessage
from vve_sumo.record.declared import read_resolved
from vve_sumo.rig.resolve import mounting_of
from vve_sumo.values import Frame, GatewayStatus, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.observer import Observer

#: the keys that scenario.json must hold for a live drive to be assembled again
KEYS: Final = frozenset(
    {"scenario", "scenario_file", "settings", "rig", "rig_name", "gateway", "files_sha256", "versions"}
    | {"epoch_gnss_s", "lot_projection", "lot_to_road"}
)


@dataclass(frozen=True, slots=True)
class LiveInputs:
    """The recorded inputs of a live drive, up to the first gap in its record."""

    scenario_content: dict[str, Any]  #: scenario.json
    pipeline: PipelineInputs
    steps: list[dict[str, Any]]  #: rows of the gateway's table before the first missing row or missing frame
    torn: int  #: number of rows after those
    frames: list[Frame]  #: of can.log, in its order


def is_live(folder: Path) -> bool:
    """Whether a folder holds a live drive's record; raises ConfigError where it holds none at all."""
    return "rig" in read_resolved(folder)


def read_live_scenario_content(folder: Path) -> dict[str, Any]:
    """Return the content of a live record's `scenario.json`; raises ConfigError if it lacks one of `KEYS`."""
    scenario_content = read_resolved(folder)
    if missing := sorted(KEYS - scenario_content.keys()):
        raise ConfigError(f"{folder / 'scenario.json'}: key {missing[0]!r} is missing, a live drive writes it")
    return scenario_content


def read_live_inputs(folder: Path) -> LiveInputs:
    """Read a live record, finished or cut off; raises ConfigError where a part of it is missing or unreadable."""
    scenario_content, pipeline = read_live_scenario_content(folder), read_pipeline_inputs(folder)
    steps = read_rows(folder, "gateway").to_pylist()
    frames = [frame for _time, _channel, frame in bus.read_log(folder / "can.log")]
    whole = _whole_steps(steps, len(frames))
    return LiveInputs(scenario_content, pipeline, steps[:whole], len(steps) - whole, frames)


def _whole_steps(steps: list[dict[str, Any]], frames: int) -> int:
    reach = accumulate(row["frames_received"] + row["frames_sent"] for row in steps)
    torn = (n for n, (row, needed) in enumerate(zip(steps, reach, strict=True)) if row["step"] != n or needed > frames)
    return next(torn, len(steps))


def rebuilt_pipeline(scenario_content: dict[str, Any], working: Path, controller: str | None = None) -> Pipeline:
    """Build the pipeline of a live drive again, with another `controller` if one is named.

    Raises ConfigError where something that the record names no longer exists.
    """
    resolved, rig = from_dict(scenario_content, working)
    if controller is not None:
        resolved = resolved.with_controller(controller)
    lot = LotAlignment.from_dict(scenario_content)
    brain = None
    if rig.brain.kind == "external" and controller is None:
        brain = external_controller(rig.brain.kind, NoLink(), resolved.map_frame, mounting_of(rig), lot.epoch)
    return pipeline_of(resolved, rig, lot, working, brain)


def replay_drive(inputs: LiveInputs, working: Path) -> Difference | None:
    """Return the first tick at which the drive's part differs: in what it saw, decided, or sent to the gateway."""
    sent = _setpoints(inputs.steps)
    for row, result in replayed_ticks(rebuilt_pipeline(inputs.scenario_content, working), inputs.pipeline):
        if (difference := compare_result(inputs.pipeline, row, result)) is not None:
            return difference
        setpoint = result.setpoint
        if setpoint is None or (then := sent.get(setpoint.sequence)) is None:
            continue
        if link.encode_setpoint(setpoint) != then:
            return Difference(int(row["tick"]), "setpoint", repr(link.decode_setpoint(then)), repr(setpoint))
    return None


def _setpoints(steps: list[dict[str, Any]]) -> dict[int, bytes]:
    """Return the datagrams of the setpoints that the gateway received, by sequence number; no malformed ones."""
    came = [(link.decode_setpoint(row["setpoint"]), row["setpoint"]) for row in steps if row["setpoint"]]
    return {setpoint.sequence: data for setpoint, data in came if isinstance(setpoint, Setpoint)}


def replay_gateway(inputs: LiveInputs) -> Difference | None:
    """Return the first step at which the gateway's part differs: in its status or in the frames that it sent.

    Raises ConfigError where this version does not understand the record's gateway configuration or setpoints.
    """
    try:
        gateway, frames = build_gateway(inputs.scenario_content["gateway"]), iter(inputs.frames)
    except (KeyError, TypeError) as error:
        raise ConfigError(f"scenario.json: gateway: {error}: written by another version of vve-sumo") from None
    for step, row in enumerate(inputs.steps):
        received, sent = list(islice(frames, row["frames_received"])), list(islice(frames, row["frames_sent"]))
        setpoint = link.decode_setpoint(row["setpoint"]) if row["setpoint"] else None
        if setpoint == MalformedMessage("wrong_version"):
            raise ConfigError("gateway: its setpoints are encoded as another version of vve-sumo did it")
        if isinstance(setpoint, MalformedMessage):
            return Difference(step, "setpoint", row["setpoint"].hex(), f"no setpoint: {setpoint.reason}")
        command = OperatorCommand(row["operator_command"]) if row["operator_command"] else None
        output = gateway.step(row["time_s"], setpoint, received, command, reason_codes(row["process_faults"]))
        difference = compare(step, row, _gateway_columns(step, gateway, output.status)) or compare_frames(
            step, sent, output.frames[: row["frames_sent"]]
        )
        if difference is not None:
            return difference
    return None


def _gateway_columns(step: int, gateway: Gateway | Observer, status: GatewayStatus) -> dict[str, Any]:
    """Return the gateway's results of a step, by the record's columns."""
    monitor = gateway.monitor
    return {
        "step": step,
        **status_columns(status),
        "sequence": monitor.sequence,
        "measured_steering_rad": monitor.measured_steering,
        "wheel_speed_mps": monitor.wheel_speed,
        "gear": monitor.gear,
    }
