"""Arming state machine as one table, which says when the car may be commanded; and the reason codes in plain words.

Every transition is defined in this file; the gateway decides which events occur.
"""

from __future__ import annotations

import enum
from typing import Final

from vve_sumo.values import ArmingState


class ArmingEvent(enum.StrEnum):
    """What can happen to the arming machine."""

    CONDITIONS_MET = "conditions_met"  #: everything needed to engage is there
    CONDITIONS_LOST = "conditions_lost"  #: something needed to engage is missing
    ENGAGE = "engage"  #: the operator's first act: the car is taken over, and held
    GO = "go"  #: the operator's second act: the car may move
    EXPIRED = "expired"  #: no setpoint that is still valid
    FAULT = "fault"  #: something is broken; the car can still be commanded
    OVERRIDE = "override"  #: the driver took over
    DRIVER = "driver"  #: the driver touches a pedal of a car under way, short of taking it over
    STOP = "stop"  #: the operator's act, or the drive is over
    AT_REST = "at_rest"  #: the car stands and is held
    PARKED = "parked"  #: the car stands in park
    DISARM = "disarm"  #: the operator's act


_DISARMED, _READY, _ENGAGED = ArmingState.DISARMED, ArmingState.READY, ArmingState.ENGAGED
_STOPPING, _STOPPED, _FAULT = ArmingState.STOPPING, ArmingState.STOPPED, ArmingState.FAULT

#: State to (event to next state); complete, so that nothing is left to a default.
#: ENGAGED is entered only from READY, on ENGAGE. GO changes no state: it lets an ENGAGED car move. From ENGAGED every
#: trouble leads to STOPPING and so to rest, except OVERRIDE: it gives the car to the driver at once, as FAULT commands
#: nothing. DRIVER, a foot that takes nothing over, leads to rest as well: no car that a foot has slowed goes on by
#: itself. STOPPED is left only on PARKED or on OVERRIDE: no operator command can let the car creep.
TRANSITIONS: Final[dict[ArmingState, dict[ArmingEvent, ArmingState]]] = {
    _DISARMED: {
        ArmingEvent.CONDITIONS_MET: _READY,
        ArmingEvent.CONDITIONS_LOST: _DISARMED,
        ArmingEvent.ENGAGE: _DISARMED,
        ArmingEvent.GO: _DISARMED,
        ArmingEvent.EXPIRED: _DISARMED,
        ArmingEvent.FAULT: _FAULT,
        ArmingEvent.OVERRIDE: _DISARMED,
        ArmingEvent.DRIVER: _DISARMED,
        ArmingEvent.STOP: _DISARMED,
        ArmingEvent.AT_REST: _DISARMED,
        ArmingEvent.PARKED: _DISARMED,
        ArmingEvent.DISARM: _DISARMED,
    },
    _READY: {
        ArmingEvent.CONDITIONS_MET: _READY,
        ArmingEvent.CONDITIONS_LOST: _DISARMED,
        ArmingEvent.ENGAGE: _ENGAGED,
        ArmingEvent.GO: _READY,
        ArmingEvent.EXPIRED: _DISARMED,
        ArmingEvent.FAULT: _FAULT,
        ArmingEvent.OVERRIDE: _DISARMED,
        ArmingEvent.DRIVER: _READY,
        ArmingEvent.STOP: _DISARMED,
        ArmingEvent.AT_REST: _READY,
        ArmingEvent.PARKED: _READY,
        ArmingEvent.DISARM: _DISARMED,
    },
    _ENGAGED: {
        ArmingEvent.CONDITIONS_MET: _ENGAGED,
        ArmingEvent.CONDITIONS_LOST: _ENGAGED,
        ArmingEvent.ENGAGE: _ENGAGED,
        ArmingEvent.GO: _ENGAGED,
        ArmingEvent.EXPIRED: _STOPPING,
        ArmingEvent.FAULT: _STOPPING,
        ArmingEvent.OVERRIDE: _FAULT,
        ArmingEvent.DRIVER: _STOPPING,
        ArmingEvent.STOP: _STOPPING,
        ArmingEvent.AT_REST: _ENGAGED,
        ArmingEvent.PARKED: _ENGAGED,
        ArmingEvent.DISARM: _STOPPING,
    },
    _STOPPING: {
        ArmingEvent.CONDITIONS_MET: _STOPPING,
        ArmingEvent.CONDITIONS_LOST: _STOPPING,
        ArmingEvent.ENGAGE: _STOPPING,
        ArmingEvent.GO: _STOPPING,
        ArmingEvent.EXPIRED: _STOPPING,
        ArmingEvent.FAULT: _STOPPING,
        ArmingEvent.OVERRIDE: _FAULT,
        ArmingEvent.DRIVER: _STOPPING,
        ArmingEvent.STOP: _STOPPING,
        ArmingEvent.AT_REST: _STOPPED,
        ArmingEvent.PARKED: _STOPPING,
        ArmingEvent.DISARM: _STOPPING,
    },
    _STOPPED: {
        ArmingEvent.CONDITIONS_MET: _STOPPED,
        ArmingEvent.CONDITIONS_LOST: _STOPPED,
        ArmingEvent.ENGAGE: _STOPPED,
        ArmingEvent.GO: _STOPPED,
        ArmingEvent.EXPIRED: _STOPPED,
        ArmingEvent.FAULT: _STOPPED,
        ArmingEvent.OVERRIDE: _FAULT,
        ArmingEvent.DRIVER: _STOPPED,
        ArmingEvent.STOP: _STOPPED,
        ArmingEvent.AT_REST: _STOPPED,
        ArmingEvent.PARKED: _DISARMED,
        ArmingEvent.DISARM: _STOPPED,
    },
    _FAULT: {
        ArmingEvent.CONDITIONS_MET: _FAULT,
        ArmingEvent.CONDITIONS_LOST: _FAULT,
        ArmingEvent.ENGAGE: _FAULT,
        ArmingEvent.GO: _FAULT,
        ArmingEvent.EXPIRED: _FAULT,
        ArmingEvent.FAULT: _FAULT,
        ArmingEvent.OVERRIDE: _FAULT,
        ArmingEvent.DRIVER: _FAULT,
        ArmingEvent.STOP: _FAULT,
        ArmingEvent.AT_REST: _FAULT,
        ArmingEvent.PARKED: _FAULT,
        ArmingEvent.DISARM: _DISARMED,
    },
}

#: Reason code of a car that is enabled, in drive, and held until the operator says go.
WAITING: Final = "waiting_for_go"

#: States in which the DBW controller is enabled and commanded.
COMMANDING: Final = frozenset({_ENGAGED, _STOPPING, _STOPPED})
#: States in which the gateway reports why a drive has ended.
ENDING: Final = frozenset({_STOPPING, _STOPPED, _FAULT})

#: Reason code to plain words; every code that the gateway itself or its process gives is here.
REASONS: Final[dict[str, str]] = {
    "another_writer": "another node on the bus sends our command frames",
    "brake_disabled": "the brake module dropped out although it is commanded to work",
    "brake_fault": "the brake module reports a fault",
    "brake_not_following": "the car brakes less than its brakes are commanded to: the driver must brake",
    "brake_report_frozen": "the brake report stays the same although the brakes are commanded otherwise",
    "brake_report_stale": "no brake report for too long",
    "brake_timeout": "the brake module misses our commands",
    "brakes_latched": "the driver's foot has taken the brakes from the gateway until the next engagement",
    "bus_down": "the car's bus takes no frames",
    "dbw_already_enabled": "the DBW controller is enabled although nobody asked it to be",
    "dbw_braking": "the DBW controller's own watchdog is braking the car",
    "dbw_watchdog": "the DBW controller's watchdog has latched",
    "disarm_asked": "the operator asked to disarm; the car is stopped first",
    "drive_gone": "the process that computes setpoints is gone",
    "drive_not_following": "the car gains speed although nothing asks it to",
    "drive_over": "the drive is over",
    "driver_inferred": "the car brakes or slows down as under a driver's foot, though no module reports one",
    "driver_needed": "the driver must hold the car: brake, and shift to park",
    "driver_not_on_brake": "in drive the driver's brake must hold the car until it is taken over",
    "driver_on_brake": "the driver's foot is on the brake",
    "driver_on_throttle": "the driver's foot is on the throttle",
    "driver_override": "the driver has control",
    "engaging": "waiting for the DBW controller to report that it is enabled",
    "external_brain": "an external controller commands the car; not one frame is sent from here",
    "gear_fault": "the shift module reports a fault",
    "gear_lost": "the car left drive by itself",
    "gear_not_confirmed": "the car did not confirm drive in time",
    "gear_not_park_or_drive": "the gear is neither park nor drive",
    "gear_report_stale": "no gear report for too long",
    "go_too_early": "go counts only while the gateway waits for it",
    "handshake_timeout": "the DBW controller did not report that it is enabled in time",
    "heading_mismatch": "the receiver's heading and the car's gyroscope disagree",
    "interface_raised": "the drive-by-wire interface's own code failed; what it said is in the summary or gateway.log",
    "no_setpoint": "no setpoint that is still good",
    "not_in_park": "cannot disarm before the car is in park: it would creep away",
    "not_standing": "the car is not known to stand",
    "operator_gone": "nobody is at the controls any more",
    "override_unconfirmed": "a module says that the driver took over, and nothing else shows a driver",
    "position_mismatch": "the receiver's position and dead reckoning from the wheels disagree",
    "profile_invalid": "a setpoint's fallback path is malformed and the setpoint was refused",
    "report_invalid": "the car reports one of its measurements as invalid",
    "report_malformed": "a report has the wrong length or an impossible value",
    "reports_inconsistent": "the car's reports jump to and fro faster than a car can: old ones among fresh ones",
    "setpoint_corrupt": "a setpoint arrived damaged",
    "setpoint_expired": "the last setpoint is too old to act on",
    "setpoint_from_future": "a setpoint is dated after now and was refused",
    "setpoint_incomplete": "a setpoint has no sequence number, time or expiry and was refused",
    "setpoint_lifetime": "a setpoint wants to live longer than allowed and was refused",
    "setpoint_not_finite": "a setpoint holds a number that is not one",
    "setpoint_out_of_order": "a setpoint does not count up and was refused",
    "shadow": "shadow mode: every enable bit stays off",
    "shifting": "waiting for the car to confirm drive",
    "speed_above_limit": "the car is faster than the rig's speed limit",
    "speed_mismatch": "satellite speed and wheel speeds disagree",
    "standstill_uncertain": "the wheels and the receiver disagree on whether the car stands",
    "steering_disabled": "the steering module dropped out although it is commanded to work",
    "steering_fault": "the steering module reports a fault",
    "steering_mismatch": "the reported steering angle and the car's gyroscope disagree",
    "steering_not_following": "the steering does not follow its command",
    "steering_report_frozen": "the steering report stays the same although the steering is commanded to move",
    "steering_report_stale": "no steering report for too long",
    "steering_timeout": "the steering module misses our commands",
    "stop_asked": "the operator asked to stop",
    "stop_asked_by_page": "somebody asked to stop over the page in a browser",
    "stop_input": "the stop button on the bus was pressed",
    "throttle_disabled": "the throttle module dropped out although it is commanded to work",
    "throttle_fault": "the throttle module reports a fault",
    "throttle_report_frozen": "the throttle report stays the same although the throttle is commanded otherwise",
    "throttle_report_stale": "no throttle report for too long",
    "throttle_timeout": "the throttle module misses our commands",
    "timer_gap": "the gateway's own clock jumped: it was not run in time",
    WAITING: "the car is held until the operator says go",
    "wheel_speeds_frozen": "the wheel speeds stay the same although the car's speed changes",
    "wheel_speeds_stale": "no wheel-speed report for too long",
    "yaw_rate_frozen": "the gyroscope stays the same although the car turns",
    "yaw_rate_mismatch": "satellite yaw rate and the car's gyroscope disagree",
    "yaw_rate_stale": "no gyroscope report for too long",
}

#: Reasons that say that the driver has stepped in.
DRIVER_REASONS: Final = frozenset({"driver_inferred", "driver_on_brake", "driver_on_throttle", "driver_override"})

#: Reasons for the harder stop: the car does not follow its commands, two nodes command it, or it is not monitored.
CRITICAL: Final = frozenset(
    {
        "another_writer",
        "brake_disabled",
        "brake_fault",
        "brake_not_following",
        "brake_report_frozen",
        "brake_timeout",
        "bus_down",
        "drive_not_following",
        "gear_lost",
        "dbw_braking",
        "dbw_watchdog",
        "steering_disabled",
        "steering_fault",
        "steering_not_following",
        "steering_report_stale",
        "steering_timeout",
        "timer_gap",
        "wheel_speeds_stale",
    }
)


def transition(state: ArmingState, event: ArmingEvent) -> ArmingState:
    """State after `event`."""
    return TRANSITIONS[state][event]
