"""Defines the rows of a record's tables: of a tick, of a step of a live drive's gateway, of a live tick's times.

The record's schema, the documentation's tables and every reader take columns and meanings from here. Names carry units,
because they are the record's columns. Nothing here reads or stores anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vve_sumo.frozen import fast_frozen


def _column(meaning: str) -> Any:
    return field(metadata={"meaning": meaning})


@fast_frozen
@dataclass(frozen=True, slots=True)
class TickRow:
    """A tick's row in the record."""

    tick: int = _column("number of the tick")
    time_s: float = _column("drive time of the tick")
    datagrams: int = _column("portions of pose bytes taken in before this tick, counted from the drive's start")
    pose_trusted: bool = _column("a trusted pose stood behind this tick")
    pose_age_s: float = _column("tick minus epoch of the newest trusted fix; NaN before the first")
    pose_reasons: str = _column("why the newest fix was not trusted, codes joined by +")
    x_m: float = _column("rear axle, map, smoothed and predicted to the tick")
    y_m: float = _column("rear axle, map, smoothed and predicted to the tick")
    heading_rad: float = _column("counter-clockwise from the map's +x")
    speed_mps: float = _column("rear axle along the heading, forward positive")
    acceleration_mps2: float = _column("estimated rate of change of speed_mps")
    yaw_rate_radps: float = _column("counter-clockwise")
    s_m: float = _column("distance along the path of the point nearest to the rear axle")
    estimated_deviation_m: float = _column("rear axle against the path as the controller sees it, left positive")
    true_x_m: float = _column("true rear axle placed on the virtual road; NaN where nobody knows the truth")
    true_y_m: float = _column("as true_x_m")
    true_heading_rad: float = _column("as true_x_m")
    true_speed_mps: float = _column("as true_x_m")
    true_acceleration_mps2: float = _column("as true_x_m")
    lateral_deviation_m: float = _column("true rear axle against the path, left positive; NaN for a real car")
    readings: int = _column("sensors that a reading came out of at this tick; rows of the readings' table")
    steering_setpoint_rad: float = _column("road-wheel angle asked by the controller, left positive; NaN for none")
    acceleration_setpoint_mps2: float = _column("acceleration asked by the controller; NaN for none")
    emergency: bool = _column("the controller asked for the emergency envelope")
    note: str = _column("the controller's own word for what it does")
    shell_faults: str = _column("faults that the shell and the virtual road handed to this tick, codes joined by +")
    faults: str = _column("all faults that went into the setpoint, codes joined by +")
    state: str = _column("arming state of the gateway")
    reasons: str = _column("the gateway's reason codes joined by +")
    limited: str = _column("limits that changed the setpoint, joined by +")
    steering_rad: float = _column("road-wheel angle granted by the gateway, left positive")
    granted_acceleration_mps2: float = _column("acceleration granted by the gateway")
    brake_torque_nm: float = _column("brake torque commanded, all wheels")
    throttle_percent: float = _column("throttle commanded")
    measured_steering_rad: float = _column(
        "road-wheel angle that the car had reported when the controller was asked; NaN before the first report"
    )
    requested_x_m: float = _column("front bumper requested of SUMO for the next tick, map")
    requested_y_m: float = _column("as requested_x_m")
    requested_heading_rad: float = _column("as requested_x_m")
    requested_speed_mps: float = _column("speed requested of SUMO for the next tick")
    ego_sync_position_error_m: float = _column("distance of SUMO's ego from its request; NaN before there is one")
    ego_sync_speed_error_mps: float = _column("difference of SUMO's speed from the requested one")
    ego_sync_faults: str = _column("breaches of the contract with SUMO, codes joined by +")
    lane: str = _column("lane that SUMO maps the ego to; empty off the road")
    actors: int = _column("actors in the snapshot that the next tick looks at")
    contacts: str = _column("actors whose rectangle overlaps the ego's, joined by +")
    red_light: str = _column(
        "signal that was red as the front bumper passed its stop line in the step to the next tick; empty for none"
    )
    stop_sign: str = _column(
        "lane past whose stop sign the front bumper went in the step to the next tick, not having stood before it; "
        "empty for none"
    )


@dataclass(frozen=True, slots=True)
class GatewayRow:
    """A row of a live record for one step of the gateway's process, with all inputs and results."""

    step: int = _column("number of the step")
    time_s: float = _column("drive time of the step, as the gateway was told")
    setpoint: bytes = _column("the setpoint's datagram as it came; empty where none came since the last step")
    operator_command: str = _column("what the operator did since the last step; empty for nothing")
    process_faults: str = _column("faults that the gateway's process handed to this step, codes joined by +")
    frames_received: int = _column("frames of can.log that went into this step, in order")
    frames_sent: int = _column("frames of can.log that this step sent, right after those received")
    sequence: int = _column("of the newest setpoint taken; -1 before the first")
    state: str = _column("arming state after the step")
    reasons: str = _column("reason codes joined by +")
    limited: str = _column("limits that changed the setpoint, joined by +")
    steering_rad: float = _column("road-wheel angle granted, left positive")
    granted_acceleration_mps2: float = _column("acceleration granted")
    brake_torque_nm: float = _column("brake torque commanded, all wheels")
    throttle_percent: float = _column("throttle commanded")
    measured_steering_rad: float = _column("road-wheel angle that the car reports; NaN before the first report")
    wheel_speed_mps: float = _column("rear axle's speed from the wheels; NaN before the first report")
    gear: str = _column("gear that the car reports")


@dataclass(frozen=True, slots=True)
class PersonReportRow:
    """A datagram that came from a person's page or receiver, as it came."""

    step: int = _column("number of the step of the virtual road that first knew of it, counted from the first")
    received_s: float = _column("drive time at which it arrived")
    datagram: bytes = _column("the report: MessagePack in a head and a checksum")


@dataclass(frozen=True, slots=True)
class PersonRow:
    """A person at one step of the virtual road."""

    step: int = _column("number of the step of the virtual road, counted from the first")
    time_s: float = _column("drive time that the step leads to: of the tick that looks at it")
    person: str = _column("id in the scenario")
    presence: str = _column("`exact` (body), `area` (body and uncertainty), `warning` (as area) or `gone`")
    x_m: float = _column("estimated centre, map; NaN where nobody knows, as all that follow to age_s")
    y_m: float = _column("as x_m")
    heading_rad: float = _column("counter-clockwise from the map's +x")
    speed_mps: float = _column("estimated; 0 where it is no more than the positions' noise")
    radius_m: float = _column("of the circle that holds the true place with 95 %")
    age_s: float = _column("of the newest position that was believed")
    distance_m: float = _column("least possible real distance from the car's lot; negative inside, inf without a lot")
    refused: str = _column("why the newest position was not believed; empty for one that was")
    faults: str = _column("reason codes for which the car must not drive, joined by +")


@dataclass(frozen=True, slots=True)
class StationDatagramRow:
    """A datagram of the real on-board unit, as it came, and what was made of it."""

    step: int = _column("number of the step of the virtual road that first knew of it, counted from the first")
    received_s: float = _column("drive time at which it arrived")
    datagram: bytes = _column("GeoNetworking packet, or Ethernet frame with one")
    station: int = _column("ID of the station that it is of; -1 where it tells of no body")
    refused: str = _column("why it was not believed; empty for one that was")


@dataclass(frozen=True, slots=True)
class SignalRow:
    """A traffic signal that began to show another state, or whose plan changed."""

    time_s: float = _column("drive time of the tick that is the first to know of it")
    signal: str = _column("name in SUMO")
    state: str = _column("what it shows from then on: SUMO's letter for each of its links")
    end_s: float = _column("drive time up to which it shows this at least")
    coming: str = _column(
        "what it shows then, and for how long at least [s]: a JSON list of pairs, as far as it is fixed"
    )


@dataclass(frozen=True, slots=True)
class StationRow:
    """A real station that has a body, at one step of the virtual road."""

    step: int = _column("number of the step of the virtual road, counted from the first")
    time_s: float = _column("drive time that the step leads to: of the tick that looks at it")
    station: int = _column("ID")
    kind: str = _column("of its body")
    x_m: float = _column("middle of the body, map")
    y_m: float = _column("as x_m")
    heading_rad: float = _column("of its motion, counter-clockwise from the map's +x")
    speed_mps: float = _column("as its last message has it; 0 once that is too old to go on by")
    length_m: float = _column("of the body; what is usual for its kind where its messages have none")
    width_m: float = _column("as length_m")
    uncertainty_m: float = _column("of the circle that holds the place of its last message with 95 %")
    age_s: float = _column("of its last message that was believed")


@dataclass(frozen=True, slots=True)
class LatencyRow:
    """The times within one tick of a live drive; all are drive times [s], NaN where the event did not happen."""

    tick: int = _column("number of the tick")
    sequence: int = _column("of the setpoint; -1 for none")
    due_s: float = _column("when the tick was due")
    epoch_s: float = _column("epoch of the newest fix, on the drive's clock as estimated")
    received_s: float = _column("arrival of that fix's bytes: the kernel's stamp")
    woken_s: float = _column("the tick began")
    decoded_s: float = _column("bytes decoded, judged, placed and predicted")
    sensed_s: float = _column("sensors done")
    decided_s: float = _column("controller done")
    handed_s: float = _column("setpoint handed to the gateway")
    framed_s: float = _column("the send of the last command frame returned")
    simulated_s: float = _column("SUMO's step done")
    woken_by: str = _column("datagram, or deadline where the due one did not come")
    missed: int = _column("ticks skipped before this one because their time had passed")
