"""Assembles the parts of a live drive from a scenario and a rig, the same for the drive and for its replay.

Starts no process. Its inputs are kept as plain JSON in the record, so that a replay can assemble them again.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from vve_sumo.bus import Bus
from vve_sumo.drive.assembly import LotAlignment, PoseInput, build_pipeline
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.resolved_scenario import ResolvedScenario, resolve_scenario
from vve_sumo.drive.rolling_start import require_start_from_rest
from vve_sumo.drive.several_egos import recorded_ego
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.frames import Alignment, Placement
from vve_sumo.live.alignment import StandingPose, standing_pose
from vve_sumo.pose.dating import FixDater
from vve_sumo.pose.sources import Source
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.scenario.load import parse
from vve_sumo.stations.received_stations import StationsSetup
from vve_sumo.stations.station_gate import GateLimits
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO

#: GNSS time minus this machine's wall clock, if that is disciplined to UTC [s]: epoch of GPS, and 18 leap seconds
GNSS_OF_UNIX: Final = -315_964_800.0 + 18.0


def to_dict(resolved: ResolvedScenario, scenario_file: Path, rig_name: str, rig: Rig) -> dict[str, Any]:
    """Return what `from_dict` needs beside the record's own keys, as plain JSON."""
    return {
        "scenario_file": str(scenario_file),
        "rig_name": rig_name,
        "rig": rig.model_dump(mode="json", exclude_unset=True),
        "gateway": gateway_config(rig, shadow=False),
    }


def from_dict(scenario_content: Mapping[str, Any], working: Path) -> tuple[ResolvedScenario, Rig]:
    """Return the resolved scenario and the rig of a live drive from its record.

    Raises ConfigError where something that the record names no longer exists.
    """
    file = Path(scenario_content["scenario_file"])
    resolved = resolve_scenario(scenario_content["scenario"], parse(scenario_content["settings"], file), file, working)
    ego, declared = recorded_ego(scenario_content)
    resolved = replace(resolved, ego_id=ego, declared=declared)
    rig = rigs.parse_json(scenario_content["rig"], Path(scenario_content["rig_name"]))
    return scenario_with_rig(resolved, rig, working), rig


def scenario_with_rig(resolved: ResolvedScenario, rig: Rig, working: Path) -> ResolvedScenario:
    """Return a resolved scenario with the rig's car, to be driven live.

    No end trigger ends a live drive: an ego whose drive shall be `completed` goes on to the end of its path, and shall
    have `arrived`. Raises ConfigError for a speed above the rig's limit, and for a rolling start.
    """
    for one in resolved.egos:
        require_start_from_rest(one, "a drive with a rig starts from rest")
    wanted, allowed = resolved.scenario.ego.speed_mps, rig.limits.speed_mps
    if wanted > allowed:
        table = "ego" if resolved.ego_id == EGO else f"egos.{resolved.ego_id}"
        raise ConfigError(
            f"{table}.speed_mps: {wanted:g} m/s is more than the rig's limits.speed_mps, {allowed:g} m/s; "
            "lower the scenario's speed or take a larger lot"
        )
    criteria = resolved.scenario.criteria
    if criteria.outcome == "completed":
        criteria = criteria.model_copy(update={"outcome": "arrived"})
        resolved = replace(resolved, scenario=resolved.scenario.model_copy(update={"criteria": criteria}))
    return resolved.with_rig(rig, working, live=True)


def with_rigs(resolved: ResolvedScenario, further: Sequence[ResolvedScenario]) -> ResolvedScenario:
    """Return a scenario of several egos, where the scenarios of some `further` egos have their rigs' cars."""
    by_id = {one.ego_id: one for one in further}
    return replace(resolved, others=tuple(by_id.get(one.ego_id, one) for one in resolved.others))


def gateway_config(rig: Rig, *, shadow: bool) -> dict[str, Any]:
    """Return the gateway's configuration as plain JSON; the drive adds the bus and the times."""
    return {
        "vehicle": asdict(meaning.vehicle_of(rig)),
        "calibration": asdict(meaning.calibration_of(rig)),
        "limits": asdict(meaning.limits_of(rig)),
        "interface": asdict(meaning.interface_of(rig)),
        "period": PERIOD,
        "shadow": shadow,
        "silent": rig.brain.kind == "external",
        "wheel_bias": meaning.steering_wheel_bias_of(rig),
        "stop_can_id": rig.operator.stop_can_id,
    }


def pipeline_of(
    resolved: ResolvedScenario, rig: Rig, lot: LotAlignment, working: Path, brain: ExternalController | None = None
) -> Pipeline:
    """Return the pipeline of a live drive; raises ConfigError as `build_pipeline` does, or for another projection."""
    frame, receiver = meaning.frame_of(rig), meaning.receiver_of(rig)
    if frame.projection != lot.projection:
        raise ConfigError("the rig's lot is not the one that the drive was aligned in")
    pose = PoseInput(
        decoder=receiver.decoder(),
        profile=receiver.profile,
        placement=Placement(frame, lot.alignment, meaning.mounting_of(rig), lot.epoch),
        epoch=lot.epoch,
        dater=FixDater(minimum_delay_of(rig), lot.epoch, absolute=rig.pose.clock == "absolute"),
        geofence=meaning.geofence_of(rig, lot.alignment),
    )
    return build_pipeline(resolved, pose, working, brain)


def stations_setup(resolved: ResolvedScenario, rig: Rig, lot: LotAlignment) -> StationsSetup | None:
    """Return how the stations of a rig's real on-board unit lie on the virtual road; None where it has no unit."""
    if (wanted := rig.v2x) is None:
        return None
    road, begin = resolved.map_frame, resolved.path.at(0.0)
    projection, offset, alignment = (
        (lot.projection, (0.0, 0.0), Alignment(lot.alignment.rotation, lot.alignment.x, lot.alignment.y))
        if wanted.frame == "lot"
        else (road.projection, road.offset, Alignment())
    )
    limits = GateLimits(wanted.reach_m, wanted.uncertainty_m, wanted.stations, frozenset(wanted.ignored))
    return StationsSetup(projection, offset, alignment, (begin.x, begin.y), lot.epoch, limits)


def minimum_delay_of(rig: Rig) -> float:
    """Return the shortest delay from a fix to its arrival [s]; 0 where the rig does not state it."""
    return (rig.pose.minimum_delay_ms or 0.0) / 1000.0


def source_of(rig: Rig) -> Source:
    """Open the rig's receiver; raises RigError naming the rig's key."""
    return meaning.receiver_of(rig).open(Bus)


def wall_epoch(t0: float) -> float:
    """Return the GNSS second of drive time 0, `t0` on the monotonic clock, by this machine's wall clock."""
    return time.time() + GNSS_OF_UNIX - (time.monotonic() - t0)


def absolute_epoch(rig: Rig, t0: float) -> float | None:
    """Return the GNSS second of drive time 0, `t0` on the monotonic clock; None unless `pose.clock` is absolute."""
    return wall_epoch(t0) if rig.pose.clock == "absolute" else None


def waiting_for_fixes(rig: Rig) -> str:
    """Return what is said before `standing_pose_of`, with how long it takes at least where that is long."""
    settling = meaning.receiver_of(rig).settling_time
    locking = f"; this kind of receiver is taken to be locking for {settling:.0f} s whenever it is opened"
    return f"waiting for trusted fixes of the standing car{locking if settling else ''}"


def standing_pose_of(rig: Rig, source: Source, t0: float) -> StandingPose:
    """Wait for the pose of the standing car from the rig's receiver; raises RigError as `standing_pose` does."""
    receiver, delay = meaning.receiver_of(rig), minimum_delay_of(rig)
    try:
        return standing_pose(
            source, receiver.decoder(), receiver.profile, delay, t0, absolute_epoch(rig, t0), receiver.settling_time
        )
    except RigError as error:
        if refused := source.sender_report().get("refused"):
            raise RigError(f"{error}; refused were datagrams of {', '.join(refused)}: see pose.source") from None
        raise
