"""Words a live drive's status: its phase, the reasons, what operator and driver do next, how often the bell rings.

Pure functions of the status messages of gateway, drive and console; no terminal, no clock.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Mapping
from typing import Any, Final

from vve_sumo.drive.reasons import in_words
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, WAITING
from vve_sumo.vehicle.observer import EXTERNAL

#: a drive without a status message for this long counts as silent [s]
SILENCE: Final = 0.5
#: largest number of reasons written out in a picture, and in the line of a transition
MAX_REASONS: Final = 8
MAX_REASONS_IN_A_LINE: Final = 4


class GatewayProcessState(enum.StrEnum):
    """What the console knows of the gateway's process, which sends it a message about ten times a second."""

    RESPONDING = "responding"  #: or not yet heard for the first time
    SILENT = "silent"  #: it exists and sends nothing: it was stopped, or is not scheduled
    GONE = "gone"  #: it ended while it commanded the car
    ENDED = "ended"  #: it ended, having let go of the car
    LEFT = "left"  #: the console has let go of it


SILENT: Final = "gateway silent: brake"
GONE: Final = "gateway gone: brake"
BRAKES: Final = "brakes do not answer: brake"
NEEDED: Final = "brake, shift to P: the gateway lets go when you do"
CONTROL: Final = "driver has control"
ROLLS: Final = "nobody brakes the car: brake"
CONTROL_OVER: Final = "driver has control, drive over"
PARKED: Final = "parked, drive over"
OVER: Final = "drive over: the driver has the car"
NEVER: Final = "drive over: nothing was engaged"
LEFT: Final = "nobody is at the controls: the gateway stops the car"
HELD: Final = "engaged and held: the driver lets go of the pedals"
DRIVING: Final = "driving: any key stops"
SHADOW_GONE: Final = "shadow drive over: the gateway is gone"
SHADOW_HELD: Final = "shadow mode: g begins, any other key ends it"
SHADOW_DRIVING: Final = "shadow mode: the driver drives, any key ends it"
BRAIN_SILENT: Final = "gateway silent: the external controller's sensors are invalid"
BRAIN_GONE: Final = "gateway gone: the external controller's sensors are invalid"
BRAIN_LEFT: Final = "nobody is at the controls: the external controller's sensors turn invalid"
BRAIN_HELD: Final = "the external controller's sensors are invalid until g"
BRAIN_DRIVING: Final = "the external controller drives: any key makes its sensors invalid"

_PHASES: Final = {
    ArmingState.DISARMED: "not ready",
    ArmingState.READY: "ready: e engages",
    ArmingState.ENGAGED: DRIVING,
    ArmingState.STOPPING: "stopping",
    ArmingState.STOPPED: "at rest: brake, shift to P",
    ArmingState.FAULT: "fault: press r",
}
#: the same while every enable bit is off: what this program does moves and stops nothing
_SHADOW_PHASES: Final = {
    ArmingState.DISARMED: "not ready",
    ArmingState.READY: "ready for a shadow drive: e engages",
    ArmingState.ENGAGED: SHADOW_DRIVING,
    ArmingState.STOPPING: "shadow drive over: the driver brakes",
    ArmingState.STOPPED: "shadow drive over: shift to P",
    ArmingState.FAULT: "fault: press r",
}
#: the same while an external controller commands the car: this program decides only whether its sensors are valid
_BRAIN_PHASES: Final = {
    ArmingState.DISARMED: "not ready",
    ArmingState.READY: "ready for the external controller: e begins",
    ArmingState.ENGAGED: BRAIN_DRIVING,
    ArmingState.STOPPING: "the external controller's sensors are invalid: it has to stop the car",
    ArmingState.STOPPED: "the external controller's sensors are invalid, the car stands",
    ArmingState.FAULT: "fault: press r",
}
_ENGAGED_PHASES: Final = {
    "engaging": "engaging: the DBW controller is being enabled",
    "shifting": "engaging: the car shifts to drive",
    WAITING: "engaged and held: g goes, any other key stops",
}
#: reasons that every phase they come with, or its advice, already states
_STATED_REASONS: Final = frozenset({*_ENGAGED_PHASES, "shadow", EXTERNAL})
#: reasons that this phase already states
_STATED_BY_PHASE: Final = {
    BRAKES: {"brake_not_following"},
    NEEDED: {"driver_needed"},
    ROLLS: {"driver_needed"},
    PARKED: {"drive_over"},
    OVER: {"drive_over"},
}
#: the driver's foot is on a pedal; an engaged car does not go before it is off
_DRIVER: Final = frozenset({"driver_on_brake", "driver_on_throttle"})
#: with one of these the gateway does not hear the car, or the car does not hear the gateway
_UNHEARD: Final = frozenset({"bus_down", "brake_report_stale", "gear_report_stale", "wheel_speeds_stale"})

#: phases at whose every picture the bell rings
ALARMS: Final = frozenset({SILENT, GONE, BRAKES, ROLLS, BRAIN_SILENT, BRAIN_GONE})

_DBW_BRAKES: Final = "nothing is commanded any more; the DBW watchdog brakes only where it is armed: the driver brakes"
_ADVICE: Final = {
    SILENT: f"{_DBW_BRAKES}, shifts to P",
    GONE: f"{_DBW_BRAKES}, shifts to P",
    BRAKES: "the driver brakes with the pedal, and with the parking brake, and shifts to P",
    NEEDED: "the gateway is not sure that the car stands, or is in P: the driver holds it",
    ROLLS: "the driver has control and touches no pedal: brake to rest, shift to P",
    CONTROL: "nothing is commanded; drive, or brake to rest: the gateway ends by itself",
    HELD: "then g goes",
    _ENGAGED_PHASES["engaging"]: "the driver lets go of the pedals",
    _ENGAGED_PHASES["shifting"]: "the driver lets go of the pedals",
    _SHADOW_PHASES[ArmingState.READY]: "nothing will be enabled: the driver drives, and brakes",
    SHADOW_HELD: "the DBW controller is not enabled: the driver holds the car",
    SHADOW_DRIVING: "no key stops the car: the driver does",
    BRAIN_SILENT: "the brain has to stop the car; where it does not, the driver brakes",
    BRAIN_GONE: "the brain has to stop the car; where it does not, the driver brakes",
    _BRAIN_PHASES[ArmingState.READY]: "the brain takes the car over by itself; its sensors are invalid so far",
    BRAIN_HELD: "the brain and the driver hold the car; then g begins the drive",
    BRAIN_DRIVING: "nothing from here brakes the car: the brain does, or the driver",
    _BRAIN_PHASES[ArmingState.STOPPING]: "where the brain does not stop the car, the driver brakes",
    _BRAIN_PHASES[ArmingState.STOPPED]: "the brain or the driver holds it; the drive ends after a second",
    _PHASES[ArmingState.STOPPING]: "wait; the driver's brake takes over at once, and ends it",
    _PHASES[ArmingState.STOPPED]: "the gateway ends once P is reported, or the driver's brake has taken over",
    _SHADOW_PHASES[ArmingState.STOPPING]: "it ends once the car stands in P",
    _SHADOW_PHASES[ArmingState.STOPPED]: "it ends once P is reported",
    _PHASES[ArmingState.FAULT]: "nothing was engaged; r asks again",
}
_NOBODY_HEARS: Final = "the car is not heard: brake, shift to P; the gateway ends 60 s after its last report"


def phase(status: Mapping[str, Any]) -> str:
    """Return the drive's phase, in words; a change of phase is a transition."""
    engaged = bool(status.get("engaged"))
    match status.get("gateway"):
        case GatewayProcessState.SILENT if not in_shadow(status):
            return BRAIN_SILENT if brain_commands(status) else SILENT
        case GatewayProcessState.GONE:
            return SHADOW_GONE if in_shadow(status) else BRAIN_GONE if brain_commands(status) else GONE
        case GatewayProcessState.LEFT if engaged:
            return BRAIN_LEFT if brain_commands(status) else LEFT
        case GatewayProcessState.LEFT:
            return NEVER
        case GatewayProcessState.ENDED if not engaged:
            return NEVER
    return _by_state(status, engaged) if "state" in status else "starting"


def _by_state(status: Mapping[str, Any], engaged: bool) -> str:
    state, reasons = ArmingState(status["state"]), status.get("reasons", ())
    if state is ArmingState.FAULT and "driver_override" in reasons:
        if "driver_needed" in reasons and status.get("gateway") != GatewayProcessState.ENDED:
            return ROLLS
        return CONTROL_OVER if status.get("gateway") == GatewayProcessState.ENDED else CONTROL
    if state is ArmingState.DISARMED and engaged:
        return PARKED if status.get("gear") == "park" else OVER
    rolls = state is ArmingState.STOPPED and "driver_needed" in reasons
    if "brake_not_following" in reasons and (rolls or state in (ArmingState.ENGAGED, ArmingState.STOPPING)):
        return BRAKES
    if "driver_needed" in reasons and state in COMMANDING and not in_shadow(status):
        return NEEDED
    if state is ArmingState.ENGAGED:
        return _engaged(status, reasons)
    if brain_commands(status):
        return _BRAIN_PHASES[state]
    return (_SHADOW_PHASES if in_shadow(status) else _PHASES)[state]


def _engaged(status: Mapping[str, Any], reasons: Collection[str]) -> str:
    if in_shadow(status):
        return SHADOW_HELD if WAITING in reasons else SHADOW_DRIVING
    if brain_commands(status):
        return BRAIN_HELD if WAITING in reasons else BRAIN_DRIVING
    for code, words in _ENGAGED_PHASES.items():
        if code in reasons:
            return words
    # Before the go the driver's foot keeps the car waiting; under way it is a reason to stop, of another state.
    return DRIVING if status.get("went", True) or _DRIVER.isdisjoint(reasons) else HELD


def in_shadow(status: Mapping[str, Any]) -> bool:
    """Whether every enable bit is off."""
    return "shadow" in status.get("reasons", ())


def brain_commands(status: Mapping[str, Any]) -> bool:
    """Whether an external controller commands the car, and this program nothing."""
    return EXTERNAL in status.get("reasons", ())


def bell_count(status: Mapping[str, Any]) -> int:
    """Return how often the bell rings when the drive comes to this status: twice for stopping, thrice for trouble."""
    if phase(status) in {*ALARMS, NEEDED}:
        return 3
    return {"stopping": 2, "fault": 3}.get(status.get("state", ""), 1)


def advice(status: Mapping[str, Any]) -> str:
    """Return what the people in the car and at the controls do next; empty where there is nothing to add."""
    words, plain = phase(status), (_PHASES[ArmingState.STOPPING], _PHASES[ArmingState.STOPPED])
    if words in plain and not _UNHEARD.isdisjoint(status.get("reasons", ())):
        return _NOBODY_HEARS
    return _ADVICE.get(words, "")


def transition(status: Mapping[str, Any]) -> str:
    """Return the line that tells of a transition, with its reasons."""
    time_s, words = status.get("time_s"), why(status)
    if len(words) > MAX_REASONS_IN_A_LINE:
        words = [*words[:MAX_REASONS_IN_A_LINE], f"and {len(words) - MAX_REASONS_IN_A_LINE} more"]
    line = f"{_number(time_s, '8.2f')} s  {_whose(status)}{phase(status).upper()}"
    return f"{line}: {'; '.join(words)}" if words else line


def why(status: Mapping[str, Any]) -> list[str]:
    """Return the reasons for the drive's phase, the gateway's first, in words and with their numbers."""
    details = status.get("details", {})
    return [f"{in_words(code)}: {details[code]}" if code in details else in_words(code) for code in _reasons(status)]


def answer(key: str, status: Mapping[str, Any]) -> str:
    """Return the line that answers a key that comes too early."""
    waits = "; ".join(why(status)) or phase(status)
    if status.get("state") == ArmingState.ENGAGED:
        return f"  {key} came too early and stops the drive: {waits}"
    if status.get("state") == ArmingState.FAULT:
        return f"  {key} does nothing: a fault waits for r: {waits}"
    if status.get("state") == ArmingState.READY:
        return f"  {key} does nothing yet: e engages first"
    return f"  {key} does nothing yet, it waits for this: {waits}"


def picture(status: Mapping[str, Any], silent: float = 0.0) -> list[str]:
    """Return the lines of the picture; `silent` is the time since the drive's last message [s]."""
    fresh = silent < SILENCE
    lines = [_motion(status, fresh)]
    if todo := advice(status):
        lines.append(f"  > {todo}")
    lines.append(_health(status))
    if status.get("doctor_overridden"):
        lines.append(f"  ! {doctor_overridden(status['doctor_overridden'])}")
    if status.get("gateway") == GatewayProcessState.SILENT:
        lines.append("  ! the gateway's process tells nothing: it is not run")
    if not fresh and "tick" not in status:
        lines.append(f"  the drive's process loads the virtual road: {_number(silent, '.0f')} s")
    elif not fresh and status.get("gateway") not in (GatewayProcessState.ENDED, GatewayProcessState.GONE):
        lines.append(f"  ! the drive's process has sent nothing for {_number(silent, '.1f')} s")
    words = why(status)
    words += [f"fix: {in_words(code)}" for code in status.get("pose_reasons", ())]
    lines += [f"  - {word}" for word in words[:MAX_REASONS]]
    if len(words) > MAX_REASONS:
        lines.append(f"  - and {len(words) - MAX_REASONS} more")
    return lines


def doctor_overridden(reason: str) -> str:
    """Return the line that says for the whole drive that the car is armed without the doctor's GO."""
    return f"DOCTOR OVERRIDDEN: {reason}"


def _motion(status: Mapping[str, Any], fresh: bool) -> str:
    """Return the line of the car's motion; a silent drive's last speed and distances are not shown."""
    speed = status.get("speed_mps") if fresh else status.get("wheel_speed_mps")
    parts = [f"{_whose(status)}{phase(status).upper()}", f"{_number(_times(3.6, speed), '.1f')} km/h"]
    parts.append(f"{_number(status.get('to_go_m') if fresh else None, '.0f')} m to go")
    parts.append(f"ahead {_number(status.get('range_m') if fresh else None, '.1f')} m")
    if status.get("note"):
        parts.append(str(status["note"]))
    return "  ".join(parts)


def _whose(status: Mapping[str, Any]) -> str:
    """Return whose status this is, in a drive of several real cars; empty in that of one."""
    return f"{status['car']}: " if status.get("car") else ""


def _health(status: Mapping[str, Any]) -> str:
    latency, clock = status.get("latency", {}), status.get("clock", {})
    fix = "no pose yet" if status.get("speed_mps") is None else "fix good"
    if status.get("pose_reasons"):
        fix = "FIX REFUSED"
    broken = any(code.startswith("record_") for code in (*status.get("reasons", ()), *status.get("faults", ())))
    p50, p99 = (_number(_times(1000.0, latency.get(name)), ".1f") for name in ("p50", "p99"))
    times = f"latency {p50}, p99 {p99} ms"
    parts = [fix, times, f"missed {status.get('missed', 0)}", "RECORD BROKEN" if broken else "recording"]
    if clock:
        parts.append(f"clock {clock.get('age')}, drift {_number(clock.get('drift_ppm'), '.1f')} ppm")
    return "  ".join(parts)


def _reasons(status: Mapping[str, Any]) -> list[str]:
    """Return all codes once, the gateway's first, without those that the phase already states.

    The drive's own codes count only while the gateway is disarmed. Afterwards they reach the gateway with the setpoints
    and are among its codes, while those of the drive's last message may be 0.1 s old and over.
    """
    missing = status.get("state", ArmingState.DISARMED) == ArmingState.DISARMED
    codes = dict.fromkeys([*status.get("reasons", ()), *(status.get("faults", ()) if missing else ())])
    return [code for code in codes if code not in _STATED_REASONS | _STATED_BY_PHASE.get(phase(status), set())]


def _number(value: Any, form: str) -> str:
    return f"{value:{form}}" if isinstance(value, (int, float)) and math.isfinite(value) else "-"


def _times(factor: float, value: Any) -> Any:
    return factor * value if isinstance(value, (int, float)) else None
