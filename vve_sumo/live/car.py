"""One real car of a live drive, as the drive's process has it: receiver, pipeline, the way to its gateway, its record.

Its tick hands the setpoint over and reads what the gateway says; nothing here can reach the car's bus. It knows nothing
of other cars: what follows for another car where this one can no longer be counted on is the drive's to decide.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.standstill_cause import StandstillClassifier
from vve_sumo.drive.termination import Outcome, TerminationMonitor
from vve_sumo.drive.tick import CarInput, CompletedTick, EgoTick
from vve_sumo.live import messages, start_pose
from vve_sumo.live.assembly import source_of
from vve_sumo.live.brain_link import ChannelLink
from vve_sumo.live.channel import Channel
from vve_sumo.live.jitter_wait import JitterWait, gateway_lateness
from vve_sumo.live.latency_monitor import LatencyMonitor
from vve_sumo.live.other_cars import lost_reason
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.live.road import LiveRoad
from vve_sumo.live.tick_scheduler import DEADLINE, ScheduledTick
from vve_sumo.live.view_feed import SampleContext
from vve_sumo.people.person import PersonState
from vve_sumo.record.rows import LatencyRow
from vve_sumo.rig.schema import Rig
from vve_sumo.values import EGO, ArmingState, GatewayStatus, Setpoint, newest_scan
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, DRIVER_REASONS, ENDING, WAITING

#: a gateway that has said nothing for so long is frozen [s]; an external controller's sensors then turn invalid
GATEWAY_SILENCE: Final = 0.07
#: the gateway's reasons while an engaged car may not move yet
NOT_YET: Final = frozenset({"engaging", "shifting", WAITING})

_NO_STATUS: Final = GatewayStatus(ArmingState.DISARMED, (), 0.0, 0.0, (), 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class CarParts:
    """What a real car of a live drive is put together from."""

    ego: str  #: id of the car's ego
    resolved: ResolvedScenario  #: of this ego
    rig: Rig
    pipeline: Pipeline
    gateway: Channel
    recorder: RecorderClient
    not_ready: tuple[str, ...]  #: reason codes that keep the car from READY for as long as the drive lasts
    brain: ExternalController | None = None  #: None where the rig has no outputs
    link: ChannelLink | None = None  #: to the brain


class LiveCar:
    """One real car of a live drive: the shell of its ego's ticks, its latency, its outcome."""

    def __init__(
        self,
        parts: CarParts,
        road: LiveRoad,
        t0: float,
        handed_over: Callable[[], None],
        beside: Callable[[], tuple[str, ...]],
    ) -> None:
        """Open the car's receiver; raises RigError naming the rig's key.

        `t0` is the monotonic second of drive time 0. `handed_over` is called when the tick's setpoint is on its way;
        `beside` returns reason codes of what the drive found that is none of this car's.
        """
        resolved, rig = parts.resolved, parts.rig
        self.id, self.resolved, self.pipeline, self.recorder = parts.ego, resolved, parts.pipeline, parts.recorder
        self.gateway = parts.gateway
        self._road, self._t0, self._handed_over, self._beside = road, t0, handed_over, beside
        self._not_ready, self._brain, self._link = parts.not_ready, parts.brain, parts.link
        #: whether the car stops where it can no longer count on another one
        self.stops_with_others = rig.operator.when_another_car_stops == "stop"
        self.tick = EgoTick(self.id, self.pipeline, resolved.path, self, self.recorder)
        self.source = source_of(rig)
        self.latency = LatencyMonitor(rig.latency.budget_ms / 1000.0, rig.latency.breaches)
        self._termination = TerminationMonitor(resolved.path.length, resolved.scenario.after_stop_s)
        self._standstill_classifier = StandstillClassifier(
            resolved.scenario, resolved.path, resolved.vehicle, resolved.declared
        )
        self.scheduled_faults: tuple[str, ...] = ()  #: of the scheduler, of the tick under way
        self._latency_faults: tuple[str, ...] = ()  # of the tick before
        self._feedback: link.Feedback | None = None
        self._feedback_at = math.inf  # when the newest came; inf before the first
        self._received = self._handed = math.nan
        self._has_engaged = False
        # Never for a real car, whose operator is answered at once.
        self._calm = JitterWait() if rig.car == "simulated" else None
        self._gateway_late = 0.0  # of its steps since the last tick, the worst [s]
        self._go_time: float | None = None
        self.goes = False  #: whether the operator's go has let the car move
        self.outcome: Outcome | None = None
        self._let_go = False  # the gateway has parked the car, or disarmed
        self._stop_reasons: tuple[str, ...] = ()  # the gateway's, which it no longer reports once it has let go
        self._clock_report: dict[str, Any] = {}
        #: the other cars that this one can no longer count on, by their ids: code, time and reasons, for the summary
        self.other_cars_lost: dict[str, dict[str, Any]] = {}

    def _clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self._t0

    # Before a tick.

    def receive_fixes(self) -> Iterator[float]:
        """Take in the fixes that have arrived, portion by portion; yield when each did, by the kernel's stamp [s]."""
        for stamp, data in self.source.receive():
            received = stamp - self._t0
            self.tick.receive(received, data)
            self._received = received
            yield received

    def take_newest(self) -> None:
        """Take in what has arrived while the tick was under way, before this car's part of it."""
        for _received in self.receive_fixes():
            pass
        self.read_gateway()

    def read_gateway(self) -> None:
        """Take in what the gateway has said."""
        for data in self.gateway.receive():
            feedback = link.decode_feedback(data)
            if isinstance(feedback, link.Feedback):
                if self._feedback is not None:
                    late = gateway_lateness(self._feedback.time, feedback.time, self._handed)
                    self._gateway_late = max(self._gateway_late, late)
                self._feedback, self._feedback_at = feedback, self._clock()
                self._has_engaged |= feedback.status.state in COMMANDING
                self._update_validity(feedback.status)
                self.latency.gateway_answered(feedback.sequence, feedback.sent)

    def _update_validity(self, status: GatewayStatus) -> None:
        """Make an external controller's sensors invalid at the end, and before the go where it commands the car."""
        publisher = None if self._brain is None else self._brain.publisher
        if publisher is None:
            return
        publisher.state = status.state.value
        publisher.over |= self._has_engaged and status.state in ENDING
        if status.state is ArmingState.ENGAGED and WAITING not in status.reasons:
            publisher.awaiting_start = False

    def observe_wake_up(self, now: float, late: float) -> str:
        """Take the wake-up of this tick, which was `late` [s], and those of the gateway since the last one.

        Return a line for the operator, empty for none.
        """
        gateway_late, self._gateway_late = self._gateway_late, 0.0
        if self._calm is None or self._has_engaged:
            return ""
        self._calm.observe(now, max(late, gateway_late))
        return self._calm.news()

    def input(self) -> CarInput:
        """Return what the coming tick takes from the car."""
        return CarInput(self._feedback.measured_steering if self._feedback else math.nan)

    # In a tick.

    def faults(self) -> tuple[str, ...]:
        """Return the reason codes of this tick except those of the virtual road, which reports its own."""
        recording = (self.recorder.failure,) if self.recorder.failure else ()
        ready = self._not_ready + self._before_engaging()
        foreign = () if self._brain is None or self._link is None else self._brain.faults + self._link.faults()
        if self._brain is not None and self._gateway_is_silent():
            # Nothing else tells an external controller that nobody can stop the drive any more.
            foreign += ("gateway_silent",)
        return (
            ready
            + self.scheduled_faults
            + self._latency_faults
            + recording
            + self.source.sender_faults()
            + foreign
            + self._beside()
        )

    def _gateway_is_silent(self) -> bool:
        """Whether the gateway has said nothing for too long; what waits because this process was held up counts."""
        if self._clock() - self._feedback_at > GATEWAY_SILENCE:
            self.read_gateway()
        return self._clock() - self._feedback_at > GATEWAY_SILENCE

    def _before_engaging(self) -> tuple[str, ...]:
        """Reason codes of conditions required only until the car is engaged; called once the tick has its pose."""
        if self._has_engaged:
            return ()
        waits: tuple[str, ...] = () if self._road.step_time_fits else ("road_not_measured",)
        if self._calm is not None and self._calm.waits:
            waits += ("not_calm",)
        pose = self.pipeline.pose
        return waits if pose is None else waits + start_pose.start_pose_of(pose, self.resolved.path).faults()

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Send a setpoint to the gateway; return the gateway's newest status, which is of an earlier step.

        A setpoint that cannot be queued is dropped; the gateway notices once the previous one expires.
        """
        sent = setpoint is not None and self.gateway.send(link.encode_setpoint(setpoint))
        self._handed = self._clock() if sent else math.nan
        self._handed_over()
        return self._feedback.status if self._feedback else _NO_STATUS

    # After a tick.

    def measure(self, begun: ScheduledTick, done: CompletedTick, woken: float, decoded: float) -> None:
        """Record the tick's latency, leg by leg."""
        setpoint = done.result.setpoint
        row = LatencyRow(
            tick=begun.tick,
            sequence=setpoint.sequence if setpoint else -1,
            due_s=begun.due,
            epoch_s=self.pipeline.newest_epoch,
            received_s=self._received,
            woken_s=woken,
            decoded_s=decoded,
            sensed_s=done.seen,
            decided_s=done.decided,
            handed_s=self._handed,
            framed_s=math.nan,
            simulated_s=self._clock(),
            # A fix of another car than that of [ego] wakes no tick: its latency counts from the tick's wake-up.
            woken_by=begun.woken_by if self.id == EGO else DEADLINE,
            missed=begun.missed,
        )
        self._latency_faults = self.latency.step(row)
        for completed in self.latency.completed():
            self.recorder.timed(completed)

    def details(self, result: TickResult) -> dict[str, str]:
        """Return the numbers behind this tick's reason codes, as text by code."""
        if result.pose is None:
            return {}
        start = start_pose.start_pose_of(result.pose, self.resolved.path)
        numbers = {
            "start_position": start.place_text(),
            "start_heading": start.turn_text(),
            "off_path": f"{abs(result.d):.1f} m",
            "not_calm": "" if self._calm is None else self._calm.worst_text,
        }
        return {code: words for code, words in numbers.items() if words and code in result.faults}

    def context(
        self, begun: ScheduledTick, result: TickResult, missed: int, people: Sequence[PersonState]
    ) -> SampleContext:
        """Return what the page's process gets beside the completed tick; `people` are those that it saw."""
        now = self._clock()
        return SampleContext(
            tick=begun.tick,
            due=begun.due,
            wall=time.time() - (now - begun.due),
            fix=self.pipeline.newest_fix,
            feedback=self._feedback,
            feedback_age=now - self._feedback_at if self._feedback else math.inf,
            details=self.details(result),
            latency=self.latency.newest,
            missed=missed,
            signals=self._road.signals_now,
            people=people,
            outcome=None if self.outcome is None else self.outcome.value,
        )

    def status(self, tick: int, now: float, result: TickResult, missed: int) -> messages.DriveStatus:
        """Return what the console's screen shows of a tick."""
        pose, ranges = result.pose, newest_scan(result.sensors).range
        return messages.DriveStatus(
            tick=tick,
            time_s=now,
            faults=result.faults,
            details=self.details(result),
            pose_reasons=result.pose_reasons,
            speed_mps=pose.speed if pose else None,
            to_go_m=self.resolved.path.length - result.s if pose else None,
            deviation_m=result.d if pose else None,
            range_m=float(ranges.min()) if len(ranges) else None,
            note=result.setpoint.note if result.setpoint else "",
            latency=self.latency.screen(),
            missed=missed,
            clock=self._clock_report,
            outcome=None if self.outcome is None else self.outcome.value,
            ego=self.id,
        )

    def keep_clock_report(self) -> None:
        """Take the clock's report anew, which takes half a millisecond."""
        self._clock_report = self.pipeline.clock_report()

    # The end.

    @property
    def state(self) -> ArmingState:
        """The gateway's arming state, as it said last."""
        return self._feedback.status.state if self._feedback else ArmingState.DISARMED

    @property
    def go_time(self) -> float | None:
        """Drive time at which the car was first free to go [s]; None before."""
        return self._go_time

    def lost(self) -> str:
        """Return the reason code for which no other car can count on this one any more; empty while it can."""
        gone = self.gateway.closed or self._gateway_is_silent()
        return lost_reason(gone, self._has_engaged, self.state)

    def stop_reasons(self) -> tuple[str, ...]:
        """Return why the gateway stopped the car; empty while it has not."""
        return self._stop_reasons

    def watch_for_the_end(self, now: float, done: CompletedTick) -> None:
        """Find the car's outcome; its duration counts from the operator's go."""
        result, status = done.result, done.status
        self._let_go |= self._has_engaged and status.state is ArmingState.DISARMED
        self.goes |= status.state is ArmingState.ENGAGED and NOT_YET.isdisjoint(status.reasons)
        if status.state in ENDING and not self._let_go:
            # A fault after the car was parked is none of the drive's.
            self._stop_reasons = status.reasons
        if self.outcome is not None or status.state not in COMMANDING | {ArmingState.FAULT}:
            return
        if self._feedback is None or (status.state is ArmingState.ENGAGED and not NOT_YET.isdisjoint(status.reasons)):
            return
        if self._go_time is None:
            if status.state is ArmingState.FAULT:
                return
            self._go_time = now
        pose, contact = result.pose, bool(self._road.around[self.id].contacts)
        speed, driven = pose.speed if pose else math.nan, now - self._go_time
        ahead = partial(self._standstill_classifier.classify, pose, result.s, done.actors)
        outcome = self._termination.step(driven, speed, result.s, status.state, status.reasons, contact, ahead)
        if outcome is None and driven > self.resolved.scenario.duration_s:
            outcome = Outcome.TIMEOUT
        if outcome in (Outcome.STOPPED, Outcome.ARRIVED, Outcome.TIMEOUT):
            self._close(self._termination.unless_contact(outcome), status.reasons)

    def end_without_gateway(self) -> None:
        """End the drive of a car whose gateway is gone, while the drives of other cars go on."""
        self.read_gateway()  # a failed send may have shown it before its last messages were read
        if self.outcome is None:
            self._close_by_the_gateway()

    def end(self) -> None:
        """Set the outcome of a car whose gateway has gone before there was one, and record what is left."""
        if self.outcome is None:
            self._close_by_the_gateway()
        for row in self.latency.close():
            self.recorder.timed(row)

    def close(self) -> None:
        """Let go of the receiver and of the external controller."""
        self.source.close()
        if self._link is not None:
            self._link.close()

    def _close(self, outcome: Outcome, reasons: tuple[str, ...]) -> None:
        self.outcome = outcome
        self.recorder.ended(self._summary(outcome, reasons))

    def _close_by_the_gateway(self) -> None:
        """Set the outcome of a drive that the gateway has ended."""
        if self.state in COMMANDING:
            # The gateway ended without a message while it commanded the car.
            self._close(self._termination.unless_contact(Outcome.FAULT), (*self._stop_reasons, "gateway_gone"))
        elif self._go_time is None:
            self._close(Outcome.INTERRUPTED, self._stop_reasons)
        elif self._termination.collided:
            self._close(Outcome.CONTACT, self._stop_reasons)
        elif not DRIVER_REASONS.isdisjoint(self._stop_reasons):
            self._close(Outcome.DRIVER, self._stop_reasons)
        elif set(self._stop_reasons[:1]) <= {"stop_asked", "stop_asked_by_page", "operator_gone"}:
            # The first reason counts: the drive was over before any fault found on the fallback path.
            self._close(Outcome.INTERRUPTED, self._stop_reasons)
        else:
            self._close(Outcome.FAULT, self._stop_reasons)

    def _summary(self, outcome: Outcome, reasons: tuple[str, ...]) -> dict[str, Any]:
        road = self._road
        summary = {
            "outcome": outcome.value,
            "reasons": list(reasons),
            "signals": road.signals,
            "removed_at_entry": list(road.removed_at_entry),
            "removed_after_standoff": list(road.removed_after_standoff),
            "warnings": list(road.warnings),
            "text": self.pipeline.failure or road.traceback or road.around[self.id].detail,
            "clock": self.pipeline.clock_report(),
            "receiver": self.source.sender_report(),
            "step_time": road.step_time_summary,
            "no_calm_second": self._calm is not None and self._calm.given_up,
        }
        return summary | ({"other_cars": self.other_cars_lost} if self.other_cars_lost else {})
