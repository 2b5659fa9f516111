"""The fault matrix as a table: what breaks, how that is brought about, and what is right to happen then.

Data alone; `stage` runs a row, `test_matrix` judges it, docs/faults.md shows it. Units are SI.
"""

from __future__ import annotations

import enum
import signal
import tomllib
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from tests import vehicles
from tests.conftest import REPOSITORY
from vve_sumo.plant.injected_faults import VALUES
from vve_sumo.timing import MAX_REPORT_AGE, NOTICED, PERIOD, SETPOINT_LIFETIME
from vve_sumo.vehicle.limits import Limits

#: the injected faults begin so long after the car first moves, at about 4.7 m/s; the others at this speed
AT: Final = 3.0
SPEED: Final = 4.4

# From the fault to the moment at which whoever stops the car knows of it.
STEP: Final = NOTICED  # the gateway looks at what it received
EXPIRY: Final = SETPOINT_LIFETIME + STEP  # the last setpoint is acted on to its end
FIX: Final = 0.150 + PERIOD + STEP  # a fix that counts is too old, a tick says so
REPORT: Final = MAX_REPORT_AGE + STEP  # a report is too old
WRITE: Final = 0.200 + STEP  # the recorder tries to write, and says that it could not
#: faults that are ridden through in one drive come one after the other, so long each [s]
EACH: Final = 3.0
#: reports come every 20 ms, the truth every 10, the operator is heard within 50: nothing here is timed better [s]
TOLERANCE: Final = 0.100


class Right(enum.StrEnum):
    """What is right to happen."""

    RIDDEN = "ridden through"
    DRIVER = "driver has control"
    REST = "at rest"


class Layer(NamedTuple):
    """Who stops the car, and how it is known to do it."""

    words: str
    deceleration: float
    rise: float  #: from the first deceleration to the full one, linearly [s]
    lag: float  #: from knowing to the first deceleration [s]


_LIMITS, _CAR, _CALIBRATION = Limits(), vehicles.FUSION.vehicle, vehicles.FUSION.calibration
_LAG = _CAR.brake_delay + _CAR.brake_lag
_TESTED = tomllib.loads((REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8"))["watchdog_test"]
GATEWAY: Final = Layer("gateway", _LIMITS.stop_deceleration, _LIMITS.stop_deceleration / _LIMITS.stop_jerk, _LAG)
HARD: Final = Layer(
    "gateway, hard", _LIMITS.critical_deceleration, _LIMITS.critical_deceleration / _LIMITS.critical_jerk, _LAG
)
# One that has found the brakes weak presses them as hard as it may; this is what is left of that at half strength, and
# against an engine that pushes.
_FULL_RISE: Final = _CAR.deceleration_limit / _LIMITS.emergency.jerk
HALF: Final = Layer("gateway, with all that the brakes give", _CAR.deceleration_limit / 2.0, _FULL_RISE, _LAG)
OPEN_THROTTLE: Final = 0.3  # of full force
PUSH: Final = _CALIBRATION.drive_force(OPEN_THROTTLE, 0.0) / _CALIBRATION.mass  # [m/s2]
PUSHED: Final = Layer("gateway, with all that the brakes give", _CAR.deceleration_limit - PUSH, _FULL_RISE, _LAG)
WATCHDOG: Final = Layer("the DBW watchdog", _TESTED["deceleration_mps2"], 0.0, PERIOD + _TESTED["delay_s"])


class Fault(NamedTuple):
    """A fault that the simulated vehicle puts on (`plant.injected_faults`)."""

    kind: str
    duration: float = 3600.0
    value: float | None = None
    later: float = 0.0  #: than `AT`; negative is sooner
    flapping: float | None = None  #: on for so long and off for so long [s]


class Signal(NamedTuple):
    """A signal to one of the processes, under way."""

    process: str
    number: signal.Signals
    times: int = 1
    continued: float | None = None  #: SIGCONT so much later [s]


@dataclass(frozen=True, slots=True)
class Row:
    """One fault; one of `faults`, `signal`, `controller` and `stage` brings it about.

    Where a controller goes with `faults`, it does what makes them felt, and the moment is that of the later of the two.
    """

    name: str
    fault: str  #: in words
    right: Right
    reasons: tuple[str, ...] = ()  #: codes that must stand in the record
    stops: Layer | None = None
    notice: float = 0.0  #: from the fault to whoever stops knowing of it, at most
    ending: str = "fault"  #: the outcome in summary.json
    first: tuple[str, ...] = ()  #: other codes that the stop may begin with, where two are as good
    fix: tuple[str, ...] = ()  #: why the fixes were refused: one of these stands with a tick
    faults: tuple[Fault, ...] = ()
    signal: Signal | None = None
    controller: str = ""  #: function in tests/live/spoilt.py
    stage: str = ""  #: stalled, full, hangup
    pole: bool = False  #: the lot has a pole beside the way
    budget_ms: float = 40.0  #: the rig's
    push: float = 0.0  #: acceleration that the fault adds until it is noticed [m/s2]
    by_reason: bool = False  #: the fault's moment is the one at which the gateway hears of it


def _pose(name: str, fault: str, kind: str, *fix: str) -> Row:
    return Row(name, fault, Right.REST, ("pose_stale",), GATEWAY, FIX, fix=fix, faults=(Fault(kind),))


def _ridden(name: str, fault: str, kind: str) -> Row:
    return Row(name, fault, Right.RIDDEN, ("stop_asked",), ending="interrupted", faults=(Fault(kind),))


def _lies(
    name: str, fault: str, fault_of: Fault, reasons: tuple[str, ...], notice: float, first: tuple[str, ...] = ()
) -> Row:
    return Row(name, fault, Right.REST, reasons, GATEWAY, notice + PERIOD + STEP, first=first, faults=(fault_of,))


def _report(name: str, fault: str, fault_of: Fault, reasons: tuple[str, ...], stops: Layer) -> Row:
    return Row(name, fault, Right.REST, reasons, stops, PERIOD + STEP, faults=(fault_of,))


def _foot(name: str, fault: str, *faults: Fault, reasons: tuple[str, ...], notice: float) -> Row:
    """A foot that takes nothing over, or that no module reports: the gateway stops the car for it."""
    return Row(name, fault, Right.REST, reasons, GATEWAY, notice + STEP, "driver_has_control", faults=faults)


def _driver(name: str, fault: str, *faults: Fault, reasons: tuple[str, ...] = ("driver_override",)) -> Row:
    return Row(name, fault, Right.DRIVER, reasons, ending="driver_has_control", faults=faults)


#: the driver's foot, soon after: whoever has control of a car has to stop it
_BRAKES = Fault("brake_override", later=0.9)

MATRIX: Final = (
    # The processes.
    Row(
        # The kernel frees a killed process's memory before it closes its sockets, and that takes its time.
        "drive_killed", "the drive's process is killed", Right.REST, ("drive_gone",), GATEWAY, EXPIRY, "broken",
        ("setpoint_expired",), signal=Signal("drive", signal.SIGKILL),
    ),
    Row(
        "drive_frozen", "the drive's process is stopped for good (SIGSTOP)", Right.REST, ("setpoint_expired",),
        GATEWAY, EXPIRY, "broken", signal=Signal("drive", signal.SIGSTOP),
    ),
    Row(
        "sumo_stalled", "a step of SUMO takes 2 s and lets nothing else of its process run", Right.REST,
        ("setpoint_expired",), GATEWAY, EXPIRY, stage="stalled",
    ),
    Row(
        "gateway_killed", "the gateway's process is killed", Right.REST, ("gateway_gone",), WATCHDOG,
        signal=Signal("gateway", signal.SIGKILL),
    ),
    Row(
        "gateway_paused", "the gateway's process is stopped for 0.3 s, then goes on", Right.REST, ("timer_gap",),
        WATCHDOG, signal=Signal("gateway", signal.SIGSTOP, continued=0.3),
    ),
    Row(
        "recorder_killed", "the recorder's process is killed", Right.REST, ("record_lost",), GATEWAY, PERIOD + STEP,
        signal=Signal("recorder", signal.SIGKILL),
    ),
    Row(
        "disk_full", "the record cannot be written: no room", Right.REST, ("record_failed",), GATEWAY, WRITE,
        stage="full",
    ),
    Row(
        "console_killed", "the console's process is killed", Right.REST, ("operator_gone",), GATEWAY, STEP,
        "interrupted", signal=Signal("console", signal.SIGKILL),
    ),
    Row(
        "ctrl_c_hammered", "Ctrl-C, fifty times", Right.REST, ("stop_asked",), GATEWAY, STEP, "interrupted",
        signal=Signal("console", signal.SIGINT, times=50),
    ),
    Row(
        "terminal_closed", "the terminal is closed", Right.REST, ("stop_asked",), GATEWAY, STEP, "interrupted",
        stage="hangup",
    ),
    # The controller, and how long a tick takes.
    Row(
        "controller_raises", "the controller raises an exception", Right.REST, ("controller_raised",), GATEWAY,
        PERIOD + STEP, controller="raising",
    ),
    Row(
        "controller_nan", "the controller asks for what is not a number", Right.REST, ("controller_not_finite",),
        GATEWAY, PERIOD + STEP, controller="not_a_number",
    ),
    Row(
        "controller_hangs", "the controller never returns", Right.REST, ("setpoint_expired",), GATEWAY, EXPIRY,
        "broken", controller="hanging",
    ),
    Row(
        "overrun", "the controller takes 30 ms of every tick of 20", Right.REST, ("overrun",), GATEWAY, 0.300 + STEP,
        controller="slow",
    ),
    Row(
        "latency_budget", "ticks keep their time, but take longer than the rig's budget", Right.REST,
        ("latency_budget",), GATEWAY, 0.320 + STEP, controller="slowish", budget_ms=10.0,
    ),
    Row(
        # The thirteenth within a second, and two ticks in which the gateway answers.
        "late_thirds", "every third tick takes 30 ms, within the rig's budget", Right.REST, ("latency_budget",),
        GATEWAY, 13 * 3 * PERIOD + 2 * PERIOD + STEP, first=("overrun",), controller="limping",
    ),
    Row(
        "speeding", "the controller asks for 2 m/s2 for ever", Right.REST, ("above_desired_speed",), GATEWAY,
        PERIOD + STEP, controller="racing", by_reason=True,
    ),
    Row(
        "geofence_breach", "the controller steers off the path, towards a pole in the lot", Right.REST,
        ("geofence_breach",), GATEWAY, PERIOD + STEP, controller="wandering", pole=True, by_reason=True,
    ),
    # The pose.
    _pose("pose_lost", "no fixes come any more", "pose_lost"),
    _pose("pose_frozen", "the position stays what it was, while time goes on", "pose_frozen", "frozen_pose"),
    # A tick sees every second fix, so it may see the jump or what is said of the fixes after it.
    _pose("pose_jumps", "the position jumps by 5 m", "pose_jump", "pose_jump", "settling"),
    _pose("rtk_lost", "the receiver loses RTK", "pose_rtk_lost", "not_rtk_fixed"),
    Row(
        "rtk_flaps", "the receiver loses RTK and has it again, every 0.1 s", Right.REST, ("pose_unsteady",), GATEWAY,
        0.6 + PERIOD + STEP, fix=("not_rtk_fixed",), faults=(Fault("pose_rtk_lost", flapping=0.1),),
    ),
    _pose("pose_backwards", "the receiver's clock goes back by 1 s", "pose_backwards"),
    _ridden("pose_bursts", "fixes come in bursts of 48 ms", "pose_bursts"),
    _ridden("pose_garbage", "random bytes between the packets, and instead of every fifth", "pose_garbage"),
    _ridden("pose_duplicates", "every packet comes twice", "pose_duplicates"),
    _ridden("pose_reordered", "of every two packets the later one comes first", "pose_reordered"),
    _ridden("pose_minute_wrong", "one packet says a minute 5 later, with right checksums", "pose_minute_wrong"),
    _ridden("pose_ahead_once", "one fix is dated 12 s ahead", "pose_ahead_once"),
    _ridden("pose_forged", "another sender's packets come 10 ms ahead of the true ones and drift", "pose_forged"),
    # Fixes that lie and agree among themselves; the notice is the time in which the lie has become 0.75 m, or has led
    # the car 0.5 m astray.
    _lies(
        "pose_drifts", "the position drifts to the left with 0.4 m/s, and the velocity agrees",
        Fault("pose_drift_lateral"), ("position_mismatch",), 0.75 / 0.4,
    ),
    _lies(
        "pose_steps", "the position steps to the left by 0.2 m each second", Fault("pose_steps"),
        ("position_mismatch",), 2.0,
    ),
    _lies(
        "pose_heading_drifts", "the heading drifts with 0.08 rad/s, and the yaw rate agrees",
        Fault("pose_heading_drift"), ("heading_mismatch",), 1.5, ("position_mismatch", "yaw_rate_mismatch"),
    ),
    _lies(
        "pose_overtaken", "just before each packet comes another sender's of the same time, drifting with 0.4 m/s",
        Fault("pose_overtaken"), ("position_mismatch",), 0.75 / 0.4,
    ),
    # The bus, and what the car says of itself.
    Row(
        "bus_dead", "the bus is dead for 4 s, both ways", Right.REST, ("steering_report_stale", "dbw_watchdog"),
        WATCHDOG, first=("brake_report_stale", "wheel_speeds_stale"), faults=(Fault("bus_silent", 4.0),),
    ),
    Row(
        "reports_stale", "the car reports nothing for 4 s, but obeys", Right.REST,
        ("steering_report_stale", "wheel_speeds_stale"), HARD, REPORT, first=("brake_report_stale",),
        faults=(Fault("reports_stale", 4.0),),
    ),
    # Both are heard, so the bound is that of the weaker of the two; this torque is worth 2.4 m/s2.
    _report(
        "another_writer", "another node commands straight steering and weaker brakes, with our identifiers",
        Fault("another_writer", 8.0, round(_LIMITS.stop_deceleration * _CALIBRATION.brake_gain)), ("another_writer",),
        GATEWAY,
    ),
    _report("brake_fault", "the brake module reports a fault", Fault("brake_fault"), ("brake_fault",), HARD),
    _report(
        "throttle_fault", "the throttle module reports a fault", Fault("throttle_fault"), ("throttle_fault",), GATEWAY
    ),
    _report(
        "steering_fault", "the steering module reports a fault", Fault("steering_fault"), ("steering_fault",), HARD
    ),
    _report(
        "report_malformed", "steering reports come one byte short", Fault("report_malformed"), ("report_malformed",),
        GATEWAY,
    ),
    _report(
        "steering_drops_out", "the steering module works no more", Fault("dbw_dropout", value=3.0),
        ("steering_disabled",), HARD,
    ),
    _report(
        "throttle_drops_out", "the throttle module works no more", Fault("dbw_dropout", value=2.0),
        ("throttle_disabled",), GATEWAY,
    ),
    # After 8 s wheel speeds are right again: what stands by no evidence but wheels that never change needs its driver.
    _lies(
        "wheel_speeds_zero", "the car says that it stands", Fault("wheel_speeds_zero", 8.0), ("speed_mismatch",), 0.120,
        ("position_mismatch",),
    ),
    _lies(
        "wheel_speeds_scaled", "wheel speeds are three quarters of the true ones", Fault("wheel_speeds_scaled"),
        ("speed_mismatch",), 1.5, ("position_mismatch",),
    ),
    _lies(
        "wheel_speeds_frozen", "wheel speeds stay what they were, while the car gains speed",
        Fault("wheel_speeds_frozen", 8.0, later=-0.75), ("wheel_speeds_frozen",), 1.2,
        ("position_mismatch", "speed_mismatch"),
    ),
    Row(
        "steering_report_frozen", "the steering report stays what it was, while the car weaves", Right.REST,
        ("steering_report_frozen",), GATEWAY, 2.0 + STEP, first=("steering_mismatch",),
        faults=(Fault("steering_report_frozen"),), controller="weaving",
    ),
    Row(
        "brakes_weak", "the brakes give half of what is commanded, and report all of it", Right.REST,
        ("brake_not_following",), HALF, 1.5, faults=(Fault("brakes_weak", value=0.5, later=-1.0),),
        controller="braking",
    ),
    Row(
        "drive_unasked", "the throttle is stuck open by 0.3, and nobody asked", Right.REST, ("brake_not_following",),
        PUSHED, 2.0, first=("drive_not_following",), faults=(Fault("drive_unasked", value=OPEN_THROTTLE),),
        push=PUSH,
    ),
    # The driver.
    _driver("brake_override", "the driver is on the brake", Fault("brake_override")),
    _foot(
        "driver_touch", "the driver brakes gently for 3 s, short of taking over", Fault("driver_touch", 3.0, 0.215),
        reasons=("driver_on_brake",), notice=2.0 * PERIOD,
    ),
    _foot(
        "foot_unreported", "the driver brakes hard for 4 s, and the brake report is frozen",
        Fault("brake_override", 4.0, 0.30), Fault("brake_report_frozen", later=-1.0),
        reasons=("driver_inferred",), notice=0.2,
    ),
    _foot(
        "foot_seen_by_motion", "the driver brakes hard for 4 s; the brake report and the reported torque are frozen",
        Fault("brake_override", 4.0, 0.30), Fault("brake_report_frozen", later=-1.0),
        Fault("brake_torque_frozen", later=-1.0), reasons=("driver_inferred",), notice=0.3,
    ),
    Row(
        "override_false", "the brake module reports an override for 50 ms, and nobody touches anything", Right.REST,
        ("override_unconfirmed",), GATEWAY, 2.0 * PERIOD + STEP, faults=(Fault("override_false", 0.05),),
    ),
    _driver("throttle_override", "the driver is on the throttle, then on the brake",
            Fault("throttle_override", 0.6), _BRAKES),
    _driver("steering_override", "the driver turns the wheel, then brakes", Fault("steering_override", 0.6), _BRAKES),
    _driver(
        "brakes_drop_out", "the brake module works no more, and the driver brakes", Fault("dbw_dropout", value=1.0),
        Fault("brake_override", later=1.5), reasons=("brake_disabled", "driver_override"),
    ),
    replace(
        _driver(
            "brakes_dead", "the brakes give nothing of what is commanded, and the driver brakes",
            Fault("brakes_weak", value=0.0, later=-1.0), Fault("brake_override", later=1.5),
            reasons=("brake_not_following", "driver_override"),
        ),
        controller="braking",
    ),
)  # fmt: skip

#: rows that the simulated vehicle brings about and that are not ridden through: `tests/drive/test_fault_matrix.py`
#: drives them in closed loop
INJECTED: Final = tuple(row for row in MATRIX if row.faults and row.right is not Right.RIDDEN)
#: of these, one for each wire between the processes; live they stand for the others, which `./check slow` tries live
WITNESSES: Final = frozenset({"pose_lost", "bus_dead", "another_writer", "wheel_speeds_frozen", "brake_override"})
#: rows whose stop is noticed and made as that of a row beside them
ALIKE: Final = frozenset(
    {"sumo_stalled", "gateway_paused", "ctrl_c_hammered", "controller_nan", "overrun", "late_thirds"}
)
#: rows that `./check slow` alone tries live
SLOW: Final = ALIKE | {row.name for row in INJECTED} - WITNESSES
#: rows that `./check test` tries live: those of one drive, and one for each layer that stops the car
QUICK: Final = frozenset({"pose_lost", "drive_killed", "gateway_killed", "controller_hangs", "brake_override"}) | {
    row.name for row in MATRIX if row.right is Right.RIDDEN
}


def in_turn(rows: tuple[Row, ...]) -> Row:
    """Return the row that puts the faults of rows on in one drive, one after the other; a single row is itself."""
    if len(rows) == 1:
        return rows[0]
    faults = tuple(
        fault._replace(duration=EACH, later=turn * EACH) for turn, row in enumerate(rows) for fault in row.faults
    )
    return replace(rows[0], name="+".join(row.name for row in rows), faults=faults)


def bound(row: Row, speed: float, acceleration: float) -> float:
    """Most that the car may drive from the fault to rest [m], from a speed and an acceleration when it sets in.

    The closed form of a delay and a linear rise to a constant deceleration. Until the brakes set in, the car gains what
    it is gaining, and as much longer as the drive force takes to fade, and what the fault itself pushes it.
    """
    layer = row.stops
    assert layer is not None
    delay, a, rise = row.notice + layer.lag, layer.deceleration, layer.rise
    v = speed + max(acceleration, 0.0) * (delay + _CALIBRATION.drive_lag) + row.push * delay
    assert v > a * rise / 2.0
    closed = v * delay + v * rise - a * rise * rise / 6.0 + (v - a * rise / 2.0) ** 2 / (2.0 * a)
    return closed + speed * TOLERANCE


def pace(row: Row) -> float:
    """Hardest that the gateway brakes in a stop of its own pace [m/s2].

    It brakes by the wheels' speed, so a car whose wheel speeds are reported too small is braked as much harder.
    """
    scaled = [fault.value or VALUES[fault.kind][0] for fault in row.faults if fault.kind == "wheel_speeds_scaled"]
    return GATEWAY.deceleration / min(scaled, default=1.0) + 0.5


def table() -> str:
    """The matrix as docs/faults.md shows it."""
    lines = ["| fault | what is right | who stops the car | in the record |", "|---|---|---|---|"]
    for row in MATRIX:
        who = "the driver" if row.right is Right.DRIVER else row.stops.words if row.stops else ""
        codes = list(row.fix[:1]) + list(row.reasons) * (row.right is not Right.RIDDEN)
        lines.append(f"| {row.fault} | {row.right} | {who} | {', '.join(f'`{code}`' for code in codes)} |")
    return "\n".join(lines)
