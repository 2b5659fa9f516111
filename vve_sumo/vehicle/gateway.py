"""Gateway, the last party before the car: commands the car while the monitored drive is in order, otherwise stops it.

Setpoints, report frames and the time are handed in: the module has no map, controller, bus or clock, and only the
drive-by-wire interface encodes and decodes frames. Every fault that a step finds becomes a reason code, not an
exception, and stops a commanded car, unless a driver who is seen has taken over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint, Vehicle, resolve_fallback_path
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.arming import COMMANDING, ArmingEvent
from vve_sumo.vehicle.arming_machine import ArmingMachine, OperatorCommand
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.engagement import Engagement
from vve_sumo.vehicle.interface import DEFAULT, ActuationCommand, Gear, VehicleInterface, error_text, load
from vve_sumo.vehicle.limits import Limits
from vve_sumo.vehicle.monitor import Monitor
from vve_sumo.vehicle.motion_control import MotionControl
from vve_sumo.vehicle.reports import TOLERANCE
from vve_sumo.vehicle.response import ResponseMonitor
from vve_sumo.vehicle.setpoint_validation import Debounce
from vve_sumo.vehicle.standstill import WHEEL_REST

MAX_STEP: Final = 2.0  # periods; a longer one is a fault, and rates count no more than this
# Time of uncertain standstill after which the driver must hold the car [s].
UNCERTAIN_TIME: Final = 3.0
# Park counts once it was reported this long without a break: a shift to drive under way would have shown by then.
PARK_TIME: Final = 1.0  # [s]
# A car that a driver has taken over, and that moves this long with no foot on a pedal, calls for the driver [s].
UNATTENDED_TIME: Final = 1.0
# A foot on a pedal that is reported for this long counts as one: a single old report among fresh ones is none [s].
ATTENDED_TIME: Final = 0.1

# Found once, for every step: looking them up in their class costs a call.
_ENGAGED, _STOPPING, _STOPPED = ArmingState.ENGAGED, ArmingState.STOPPING, ArmingState.STOPPED

#: Faults that latch even while nothing is commanded: they concern the gateway itself or a second node that commands.
_LATCHING: Final = frozenset({"another_writer", "timer_gap"})

#: Faults after which the brakes cannot be relied on, so that the driver is called while the car moves.
_HELPLESS: Final = frozenset({"brake_disabled", "brake_not_following", "override_unconfirmed"})

#: Faults while which it is not known how the car moves; of the gear that is no matter.
_MOTION_UNHEARD: Final = frozenset({"brake_report_stale", "bus_down", "wheel_speeds_stale"})


class GatewayOutput(NamedTuple):
    """Result of one step of the gateway."""

    status: GatewayStatus  #: what was made of the setpoint
    frames: tuple[Frame, ...]  #: to be sent now, in this order


class Gateway:
    """Turns setpoints into command frames once a `period` [s] while there is no fault; otherwise stops the car.

    Each step calls the `interface`'s encode exactly once. When nothing steps the gateway, the interface's counters
    therefore stand still, and its own watchdog brakes. Without an `interface` the `DEFAULT` one is used.
    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    With `shadow` everything is computed as usual while a driver drives: every enable bit stays off, no gear is
    requested, and neither the interface's confirmations nor the driver's inputs count.
    Raises ConfigError where `period` is longer than the interface's command timeout.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        calibration: Calibration,
        limits: Limits | None = None,
        period: float = PERIOD,
        interface: VehicleInterface | None = None,
        shadow: bool = False,
        wheel_bias: float = 0.0,
    ) -> None:
        interface = interface or load(DEFAULT)
        self.monitor = Monitor(vehicle, calibration, interface, wheel_bias)
        self._reports, self._standstill = self.monitor.reports, self.monitor.standstill
        self._arming = ArmingMachine(PARK_TIME, self._changed)
        self._ratio, self._wheel_bias = vehicle.steering_ratio, wheel_bias
        self._period = period
        self._interface = interface
        self._wire = wire = interface.facts
        if not period <= wire.command_timeout:
            raise ConfigError(f"{wire.title}: lets go after {wire.command_timeout:g} s, but a step takes {period:g} s")
        self._shadow = shadow
        self._wheel_rate = min(vehicle.steering_rate_limit * vehicle.steering_ratio, wire.wheel_rate_limit)
        self._engagement = Engagement(
            vehicle.steering_rate_limit * (vehicle.steering_delay + vehicle.steering_lag), shadow=shadow
        )
        self._motion = motion = MotionControl(
            vehicle, calibration, limits or Limits(), wire, self.monitor, self._arming, self._engagement
        )
        self._limiter, self._fallback_tracker = motion.limiter, motion.fallback_tracker
        # How hard a car that is commanded an acceleration brakes for it, its own controller decides.
        own_brakes = wire.acceleration_limits is not None
        self._response_monitor = ResponseMonitor(
            vehicle, calibration, motion.actuation.holding_torque, own_brakes=own_brakes
        )
        self._uncertain_long = Debounce(UNCERTAIN_TIME)

        self._last_now = math.nan
        self._elapsed = 0.0  # since the last step, bounded [s]
        self._last_pedals = Pedals(0.0, 0.0)  # at the last step
        self._fastest = math.nan  # largest speed by wheels or receiver, of a commanded car [m/s]; NaN where not known
        self._driver: list[str] = []  # pedals that the driver touches
        self._unattended_long, self._attended_long = Debounce(UNATTENDED_TIME), Debounce(ATTENDED_TIME)
        self._clear = False
        self._not_encoded = ""  # what the interface raised when it was to encode the step before

    def step(
        self,
        now: float,
        setpoint: Setpoint | None,
        reports: Sequence[Frame],
        command: OperatorCommand | None = None,
        process_faults: Sequence[str] = (),
    ) -> GatewayOutput:
        """Return gateway status and command frames at drive time `now` [s].

        `setpoint` is the newest one, or None if none arrived since the last step; `reports` are the frames received on
        the car's bus since the last step, in order; `command` is the operator's since then; `process_faults` are reason
        codes of what the caller found wrong, each of which is a fault even if this module does not know the code.
        """
        arming, shadow = self._arming, self._shadow
        self._clear = False
        faults = self._watch(now, setpoint, reports)
        if self._not_encoded:
            faults.append("interface_raised")
        faults += process_faults
        notes = self.monitor.notes
        arming.begin_step(
            ["shadow", *notes] if shadow else notes, frozenset() if shadow else self._reports.overrides()
        )  # fmt: skip
        if arming.state in COMMANDING:
            self._judge_commanded(now, faults)
        else:
            self._judge_idle(now, faults)
        if command is not None:
            self._apply_command(command)
        return self._encode(now)

    @property
    def interface_error(self) -> str:
        """What the interface's own code raised last, with the place; empty while it has raised nothing."""
        return self._not_encoded or self._reports.error

    @property
    def done(self) -> bool:
        """Whether a drive is over: it was begun and ended, and the car stands, or nothing has moved for long."""
        return self._arming.ended and self.monitor.supervision_over

    # Observation: nothing in this section changes the arming state.

    def _watch(self, now: float, setpoint: Setpoint | None, frames: Sequence[Frame]) -> list[str]:
        """Reason codes of the faults that are looked for in every arming state."""
        reports, monitor, state = self._reports, self.monitor, self._arming.state
        faults = reports.take(now, frames)
        gap = now - self._last_now
        # Time that stands still or runs backwards is a fault too. The first step has no gap: NaN fails the comparisons.
        longest = MAX_STEP * self._period
        if gap <= 0.0 or gap > longest + TOLERANCE or not math.isfinite(now):
            faults.append("timer_gap")
        self._last_now = now
        self._elapsed = (gap if gap < longest else longest) if gap > 0.0 else 0.0
        self._driver = [] if self._shadow else reports.driver()
        faults += monitor.check_inputs(now, setpoint)
        if setpoint is not None and monitor.fresh:
            self._take_fallback_path(now, setpoint)
        idle = state not in COMMANDING
        commanded = not (idle or self._shadow)
        limiter, steered = self._limiter, commanded and self._engagement.enabled
        faults += monitor.check_motion(
            now,
            self._elapsed,
            idle=idle,
            braking=-limiter.acceleration if commanded else None if reports.attended(now) else 0.0,
            steering=limiter.steering if steered else math.nan,
        )
        standstill = self._standstill
        # Wheel speeds of zero while standstill is not certain give no distance driven.
        believed = standstill.certain or not reports.fastest_wheel < WHEEL_REST
        self._fallback_tracker.move(gap, monitor.speed if believed else math.nan)
        if steered:
            faults += self._response_monitor.step(
                now,
                self._elapsed,
                self._last_pedals,
                reports,
                (monitor.speed, monitor.gnss_speed),
                self._motion.grade(),
                standstill=standstill,
                going=self._arming.going,
            )
        else:
            self._response_monitor.reset()
        return faults

    def _take_fallback_path(self, now: float, setpoint: Setpoint) -> None:
        """Follow the fallback path of an accepted setpoint from now on."""
        # Where the path of an expired setpoint begins, seen from the car, is not known. A setpoint with faults may
        # have no path: the path of an earlier setpoint is then better than none.
        if self.monitor.validator.valid(now) and (
            not setpoint.faults or resolve_fallback_path(setpoint.fallback_path) is not None
        ):
            self._fallback_tracker.take(now - setpoint.time, setpoint.fallback_path)

    def _missing(self, now: float) -> list[str]:
        """Reason codes of unmet conditions for engaging, apart from faults."""
        reports = self._reports
        missing = self.monitor.missing(now)
        if reports.gear.gear not in (Gear.PARK, Gear.DRIVE):
            missing.append("gear_not_park_or_drive")
        if reports.any_enabled():
            missing.append("dbw_already_enabled")
        if reports.throttle.driver:
            missing.append("driver_on_throttle")
        if reports.gear.gear is Gear.DRIVE and not reports.brake.driver:
            missing.append("driver_not_on_brake")
        return missing

    def _progress(self, now: float) -> list[str]:
        """Reason codes of the commands that the car does not follow."""
        if self._arming.state is not _ENGAGED:
            return self._engagement.dropped_out(self._reports)
        measured = (self._reports.steering.wheel_angle - self._wheel_bias) / self._ratio
        return self._engagement.follow(now, self._reports, self._limiter.steering - measured)

    # Consequences: arming events and operator commands.

    def _judge_idle(self, now: float, faults: list[str]) -> None:
        arming = self._arming
        latching = [code for code in faults if code in _LATCHING]
        if latching:
            arming.apply(ArmingEvent.FAULT, latching)
        if arming.state is not ArmingState.FAULT:
            arming.judge_idle(faults + self._missing(now))
            return
        attended = self._attended_long.step(now, self._reports.attended(now))
        # A receiver that says rest may be frozen: a car in gear whose wheels are not heard may creep.
        unheard = math.isnan(self.monitor.speed) and self._reports.gear.gear is not Gear.PARK
        alone = "driver_override" in arming.causes and (self._standstill.may_move or unheard) and not attended
        if self._unattended_long.step(now, alone and arming.ended):
            arming.notes.append("driver_needed")

    def _judge_commanded(self, now: float, faults: list[str]) -> None:
        arming, standstill = self._arming, self._standstill
        # The CLEAR sent on engaging resets older overrides. Once the DBW controller has confirmed and its handshake
        # time is over, every latched override counts.
        overrides = arming.new_overrides(self._engagement.settled(now))
        if overrides:
            confirmed = self._foot_inferred and self._response_monitor.confirms_override
            if confirmed or any(map(self._confirmed, overrides)):
                arming.apply(ArmingEvent.OVERRIDE, ["driver_override", *faults])
                return
            # The word of one module alone, which may be wrong: a car that nobody brakes must not be let go.
            faults.append("override_unconfirmed")
        arming.judge_pedals([*self._driver, "driver_inferred"] if self._foot_inferred else self._driver)
        self._fastest = self._largest_speed()
        if self._limiter.too_fast(self._fastest):
            faults.append("speed_above_limit")
        faults += self._progress(now)
        arming.judge(
            now,
            faults,
            expired=not self.monitor.validator.valid(now),
            at_rest=standstill.at_rest,
            parked=standstill.certain and self._reports.in_park(now),
        )
        self._judge_standstill(now)
        self._call_the_driver("brake" in overrides, faults)

    @property
    def _foot_inferred(self) -> bool:
        """Whether the car brakes as under a foot; where somebody else commands its brakes, that says nothing."""
        return self._response_monitor.driver_inferred and "another_writer" not in self._arming.causes

    def _judge_standstill(self, now: float) -> None:
        """Call the driver where it is not certain that the car stands."""
        standstill = self._standstill
        doubted = self._reports.fastest_wheel < WHEEL_REST and not standstill.certain
        # A car that pulls away after a long stand contradicts for a moment: the receiver sees slow motion as rest.
        if self._uncertain_long.step(now, doubted) or (standstill.contradicted and not self._arming.going):
            self._arming.notes += ["standstill_uncertain", "driver_needed"]

    def _confirmed(self, override: str) -> bool:
        """Whether something besides its own word confirms a module's override."""
        if override == "gear":
            # The gateway itself asks for drive before, and for park at rest.
            gear, asked = self._reports.gear.gear, Gear.PARK if self._arming.state is _STOPPED else Gear.DRIVE
            return self._engagement.in_drive and gear not in (Gear.DRIVE, asked)
        return self._reports.confirmed(override)

    def _call_the_driver(self, brake_overridden: bool, faults: list[str]) -> None:
        """Note that the gateway has no brakes, or does not hear the car, or that the car rolls though it is held."""
        if self._shadow:
            return
        arming = self._arming
        latched = self._response_monitor.brakes_latched or brake_overridden
        if latched:
            arming.notes.append("brakes_latched")
        # A car that is said to stand, and is not known to, may roll.
        helpless = latched or arming.state is _STOPPED or not _HELPLESS.isdisjoint(arming.causes)
        # Of an engaged car neither is so: either would have begun a stop.
        helpless |= self._fastest != self._fastest or not _MOTION_UNHEARD.isdisjoint(faults)
        if helpless and not self._standstill.certain:
            arming.notes.append("driver_needed")

    def _largest_speed(self) -> float:
        """Largest speed that wheels or receiver report [m/s]; NaN where neither is known."""
        wheels, gnss = abs(self.monitor.speed), abs(self.monitor.gnss_speed)
        return wheels if wheels >= gnss or gnss != gnss else gnss

    def _apply_command(self, command: OperatorCommand) -> None:
        if command is OperatorCommand.DISARM and self._arming.state is _STOPPED:
            # Without brakes a car in drive creeps away, and the DBW watchdog brakes when EN drops in gear.
            self._arming.notes.append("not_in_park")
            return
        # A held car is never let go without brakes.
        may_go = not self._response_monitor.brakes_latched and self._engagement.may_go(self._driver)
        self._arming.apply_command(command, may_go)

    def _changed(self, event: ArmingEvent) -> None:
        """Do with the car what follows from a change of the arming state."""
        state = self._arming.state
        if state is _ENGAGED:
            self._engage()
        elif state is _STOPPING:
            self._motion.begin_stop()
        elif event is ArmingEvent.DISARM or event is ArmingEvent.PARKED:
            self.monitor.forget_setpoints()
            self._fallback_tracker.take(0.0, None)  # no path outlives the drive that it was worked out for

    def _engage(self) -> None:
        self._engagement.begin(self._last_now)
        self._clear = True
        self._response_monitor.engage()
        self._unattended_long.reset()
        self._motion.engage()

    # Commands to the car.

    def _encode(self, now: float) -> GatewayOutput:
        pedals, acceleration, steering, limited = self._motion.step(now, self._elapsed, self._fastest, self._driver)
        torque, throttle, asked = pedals
        if torque > self._motion.torque_limit:
            torque = self._motion.torque_limit
            pedals = Pedals(torque, throttle, asked)
        self._last_pedals = pedals
        if self._wire.acceleration_limits is not None:
            asked = clamp(asked, self._motion.hardest, self._wire.acceleration_limits.maximum)
        enable = self._arming.state in COMMANDING and not self._shadow
        wheel_limit = self._wire.wheel_angle_limit
        wheel_angle = clamp(steering * self._ratio + self._wheel_bias, -wheel_limit, wheel_limit)
        clear = self._clear and not self._shadow
        gear = Gear.NONE if self._shadow else self._motion.gear(now)
        frames = self._encoded(
            ActuationCommand(torque, throttle, wheel_angle, self._wheel_rate, gear, enable, clear, asked)
        )
        status = GatewayStatus(
            state=self._arming.state,
            reasons=self._arming.reasons,
            steering=steering,
            acceleration=acceleration,
            limited=limited,
            brake_torque=torque,
            throttle=throttle,
        )
        return GatewayOutput(status, frames)

    def _encoded(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Return the frames of a command; none where the interface's own code raises.

        That is a fault of the next step. Without frames the DBW controller does what it does when commands stop.
        """
        try:
            frames = self._interface.encode(command)
        except Exception as error:
            self._not_encoded = error_text(error)
            return ()
        self._not_encoded = ""
        return frames
