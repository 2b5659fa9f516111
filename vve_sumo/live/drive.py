"""Runs the drive's process: pose bytes in, setpoints out, once a tick, phase-locked to the receiver.

Waits on the sockets until a tick is due, runs `drive.tick`, and measures the tick's latency. Nothing here can reach the
car's bus, and a setpoint is sent only by the tick that computed it.
"""

from __future__ import annotations

import contextlib
import gc
import math
import select
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.brain import ExternalController, external_controller
from vve_sumo.drive.people_on_road import PeopleOnRoad
from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.standstill_cause import StandstillClassifier
from vve_sumo.drive.stations_on_road import StationsOnRoad
from vve_sumo.drive.termination import Outcome, TerminationMonitor
from vve_sumo.drive.tick import CarInput, CompletedTick, DueTick, EgoTick, Tick
from vve_sumo.drive.virtual_road import open_world, scenario_engine
from vve_sumo.errors import VveError
from vve_sumo.frames import move_point
from vve_sumo.geometry import behind_bumper
from vve_sumo.live import messages, signals, spawn, start_pose
from vve_sumo.live.assembly import from_dict, pipeline_of, source_of
from vve_sumo.live.brain_link import ChannelLink, key_of, open_setpoints, tells_own, tells_signals, wired_sensors
from vve_sumo.live.channel import Channel
from vve_sumo.live.jitter_wait import JitterWait, gateway_lateness
from vve_sumo.live.latency_monitor import LatencyMonitor
from vve_sumo.live.people_link import PeopleFeed
from vve_sumo.live.priority import DRIVE_NICE, DRIVE_PRIORITY, OOM_DRIVE, RealTimeSection, raise_priority, set_oom_score
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.live.road import LiveRoad
from vve_sumo.live.stations_link import StationsFeed
from vve_sumo.live.tick_scheduler import ScheduledTick, TickScheduler
from vve_sumo.live.view_feed import SampleContext, ViewFeed
from vve_sumo.people.person import People, PersonState
from vve_sumo.people.person_view import RoadCar, view_of
from vve_sumo.record.rows import LatencyRow
from vve_sumo.rig.resolve import mounting_of
from vve_sumo.rig.schema import Rig
from vve_sumo.stations.received_stations import ReceivedStations, StationsSetup
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, ArmingState, GatewayStatus, Point, Setpoint, newest_scan
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, DRIVER_REASONS, ENDING, WAITING
from vve_sumo.wire.outputs import KINDS

#: between two status messages to the console [s]
STATUS_PERIOD: Final = 0.1
#: ticks between work that takes half a millisecond and can wait: a small garbage collection, the clock's report
HOUSEKEEPING_TICKS: Final = 100
#: ticks between two messages to the people's pages
PEOPLE_TICKS: Final = 5
#: longest wait on the sockets [s]
MAX_WAIT: Final = 0.1
#: longest time to send the last messages to the recorder [s]
RECORDER_TIMEOUT: Final = 5.0

#: a gateway that has said nothing for so long is frozen [s]; an external controller's sensors then turn invalid
GATEWAY_SILENCE: Final = 0.07

_NO_STATUS: Final = GatewayStatus(ArmingState.DISARMED, (), 0.0, 0.0, (), 0.0, 0.0)


class LiveDrive:
    """The loop of one live drive, with everything that it holds open."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel]) -> None:
        """Assemble the drive; raises VveError where something in the configuration is not usable."""
        self._t0: float = config["t0"]
        self._gateway, self._console = channels["gateway"], channels["console"]
        self._recorder = RecorderClient(channels["recorder"])
        self._view = ViewFeed(channels["view"]) if "view" in channels else None
        working = Path(config["working"])
        self._resolved, rig = from_dict(config["resolved"], working)
        lot = LotAlignment.from_dict(config["resolved"])
        self._link, self._brain = self._foreign(rig, lot, channels.get("outputs"), working)
        self._pipeline = pipeline_of(self._resolved, rig, lot, working, self._brain)
        self._not_ready: tuple[str, ...] = tuple(config["not_ready"])
        self._road = LiveRoad(open_world(self._resolved, time.perf_counter), scenario_engine(self._resolved))
        self._ego = EgoTick(EGO, self._pipeline, self._resolved.path, self, self._recorder)
        publisher = None if self._brain is None else self._brain.publisher
        if publisher is not None and publisher.tells_signals:
            publisher.signals = self._road.timed_signals()
        self._tick = Tick([self._ego], self._road, self._clock)
        self._source = source_of(rig)
        self._urgent = RealTimeSection(DRIVE_PRIORITY)
        self._latency = LatencyMonitor(rig.latency.budget_ms / 1000.0, rig.latency.breaches)
        self._scheduler = TickScheduler(self._clock(), PERIOD, rig.latency.deadline_ms / 1000.0)
        self._termination = TerminationMonitor(self._resolved.path.length, self._resolved.scenario.after_stop_s)
        self._standstill_classifier = StandstillClassifier(
            self._resolved.scenario, self._resolved.path, self._resolved.vehicle
        )
        self._feedback: link.Feedback | None = None
        self._feedback_at = math.inf  # when the newest came; inf before the first
        self._scheduled_faults: tuple[str, ...] = ()  # of the tick under way
        self._latency_faults: tuple[str, ...] = ()  # of the tick before
        self._received = self._woken = self._handed = math.nan
        self._has_engaged = False
        # Never for a real car, whose operator is answered at once.
        self._calm = JitterWait() if rig.car == "simulated" else None
        self._gateway_late = 0.0  # of its steps since the last tick, the worst [s]
        self._go_time: float | None = None
        self._outcome: Outcome | None = None
        self._let_go = False  # the gateway has parked the car, or disarmed
        self._stop_reasons: tuple[str, ...] = ()  # the gateway's, which it no longer reports once it has let go
        self._status_sent_at = -math.inf
        self._clock_report: dict[str, Any] = {}
        self._inputs: list[Any] = [self._source, self._gateway, self._console]
        self._people: PeopleOnRoad | None = None
        if "people" in channels:
            self._people_feed = PeopleFeed(channels["people"])
            self._people = PeopleOnRoad(People(self._resolved.people), self._recorder)
            self._road.admit(self._people)
            self._inputs.append(self._people_feed)
        self._stations_feed: StationsFeed | None = None
        if "stations" in channels:
            setup = StationsSetup.from_dict(config["resolved"]["stations"])
            self._stations_feed = StationsFeed(channels["stations"])
            self._stations = StationsOnRoad(ReceivedStations(setup), self._recorder)
            self._road.admit_stations(self._stations)
            self._inputs.append(self._stations_feed)

    def _foreign(
        self, rig: Rig, lot: LotAlignment, outputs: Channel | None, working: Path
    ) -> tuple[ChannelLink | None, ExternalController | None]:
        """Return the way to an external controller, and the brain; neither where the rig has no outputs."""
        if outputs is None:
            return None, None
        brain, key, setpoints = rig.brain, key_of(rig.brain, working), None
        if brain.kind == "setpoints":
            setpoints = open_setpoints(brain, key)
        actors = any(KINDS[table.kind].tells_actors for table in rig.outputs)
        link_ = ChannelLink(outputs, setpoints, self._t0, actors=actors)
        frame, mounting, wired = self._resolved.map_frame, mounting_of(rig), wired_sensors(rig)
        return link_, external_controller(
            brain.kind,
            link_,
            frame,
            mounting,
            lot.epoch,
            key,
            wired=wired,
            tells_signals=tells_signals(rig),
            tells_own=tells_own(rig),
        )

    def run(self) -> None:
        """Tick until the gateway is gone: a moving car needs fallback paths even if the console is gone."""
        gc.collect()
        gc.freeze()
        gc.disable()
        # Not earlier: loading a network takes a second, during which no other process would get this core.
        raise_priority(DRIVE_NICE)
        self._urgent.begin()
        while not self._gateway.closed:
            self._wait()
            self._step()
        self._urgent.end()
        self._end()

    def _clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self._t0

    # Before a tick.

    def _wait(self) -> None:
        """Wait on the sockets until the next tick is to begin, and take in what arrives."""
        self._wake()
        while (left := self._scheduler.wait_until() - self._clock()) > 0.0:
            left = min(left, self._source.next_due() - time.monotonic(), MAX_WAIT)
            # select, because poll rounds to whole milliseconds.
            select.select(self._inputs, [], [], max(left, 0.0))
            self._wake()

    def _wake(self) -> None:
        self._woken = self._clock()
        self._take()

    def _take(self) -> None:
        """Take in what has arrived; a pose datagram's arrival time is the kernel's time stamp."""
        for stamp, data in self._source.receive():
            received = stamp - self._t0
            self._ego.receive(received, data)
            self._received = received
            self._scheduler.fix_arrived(received, self._pipeline.newest_epoch)
        self._read_gateway()
        self._console.receive()
        ends: list[tuple[Any, bool]] = [(self._source, self._source.lost), (self._console, self._console.closed)]
        if self._people is not None:
            for arrived in self._people_feed.receive():
                self._people.receive(arrived.received, arrived.datagram)
            ends.append((self._people_feed, self._people_feed.closed))
        if self._stations_feed is not None:
            for arrived_at, datagram, said in self._stations_feed.receive():
                self._stations.receive(arrived_at, datagram, said)
            ends.append((self._stations_feed, self._stations_feed.closed))
        for end, gone in ends:
            if gone and end in self._inputs:
                # select always finds a closed connection ready, which would make the wait a busy loop.
                self._inputs.remove(end)

    def _read_gateway(self) -> None:
        for data in self._gateway.receive():
            feedback = link.decode_feedback(data)
            if isinstance(feedback, link.Feedback):
                if self._feedback is not None:
                    late = gateway_lateness(self._feedback.time, feedback.time, self._handed)
                    self._gateway_late = max(self._gateway_late, late)
                self._feedback, self._feedback_at = feedback, self._clock()
                self._has_engaged |= feedback.status.state in COMMANDING
                self._update_validity(feedback.status)
                self._latency.gateway_answered(feedback.sequence, feedback.sent)

    def _update_validity(self, status: GatewayStatus) -> None:
        """Make an external controller's sensors invalid at the end, and before the go where it commands the car."""
        publisher = None if self._brain is None else self._brain.publisher
        if publisher is None:
            return
        publisher.state = status.state.value
        publisher.over |= self._has_engaged and status.state in ENDING
        if status.state is ArmingState.ENGAGED and WAITING not in status.reasons:
            publisher.awaiting_start = False

    # A tick.

    def _step(self) -> None:
        decoded = self._clock()
        begun = self._scheduler.begin(decoded)
        self._scheduled_faults = begun.faults
        self._observe_wake_up(decoded, decoded - begun.awaited)
        steering = self._feedback.measured_steering if self._feedback else math.nan
        due = DueTick(begun.tick, begun.due, self._scheduler.next_due, begun.catch_up)
        people = () if self._people is None else self._people.states
        done = self._tick.step(due, {EGO: CarInput(steering)})[EGO]
        self._measure(begun, done, decoded)
        self._watch_for_the_end(begun.due, done)
        self._recorder.flush()
        self._send_status(begun, done.result)
        if self._view is not None:
            self._view.send(done, partial(self._beside, begun, done.result, people))
        if begun.tick % PEOPLE_TICKS == 0:
            self._show_people(done)
        if begun.tick % HOUSEKEEPING_TICKS == 0:
            self._clock_report = self._pipeline.clock_report()
            gc.collect(0)
        if begun.missed:
            # Ticks that take too long would else take a whole processor from the gateway, with no wait in between.
            self._urgent.pause()
        else:
            self._urgent.begin()

    def faults(self) -> tuple[str, ...]:
        """Return the reason codes of this tick except those of the virtual road, which reports its own."""
        recording = (self._recorder.failure,) if self._recorder.failure else ()
        ready = self._not_ready + self._before_engaging()
        foreign = () if self._brain is None or self._link is None else self._brain.faults + self._link.faults()
        if self._brain is not None and self._gateway_is_silent():
            # Nothing else tells an external controller that nobody can stop the drive any more.
            foreign += ("gateway_silent",)
        if self._people is not None and self._people_feed.closed:
            foreign += ("people_gone",)
        if self._stations_feed is not None and self._stations_feed.closed:
            foreign += ("stations_gone",)
        return (
            ready + self._scheduled_faults + self._latency_faults + recording + self._source.sender_faults() + foreign
        )

    def _gateway_is_silent(self) -> bool:
        """Whether the gateway has said nothing for too long; what waits because this process was held up counts."""
        if self._clock() - self._feedback_at > GATEWAY_SILENCE:
            self._read_gateway()
        return self._clock() - self._feedback_at > GATEWAY_SILENCE

    def _before_engaging(self) -> tuple[str, ...]:
        """Reason codes of conditions required only until the car is engaged; called once the tick has its pose."""
        if self._has_engaged:
            return ()
        waits: tuple[str, ...] = () if self._road.step_time_fits else ("road_not_measured",)
        if self._calm is not None and self._calm.waits:
            waits += ("not_calm",)
        pose = self._pipeline.pose
        return waits if pose is None else waits + start_pose.start_pose_of(pose, self._resolved.path).faults()

    def _observe_wake_up(self, now: float, late: float) -> None:
        """Take the wake-up of this tick, which was `late` [s], and those of the gateway since the last one."""
        gateway_late, self._gateway_late = self._gateway_late, 0.0
        if self._calm is None or self._has_engaged:
            return
        self._calm.observe(now, max(late, gateway_late))
        if news := self._calm.news():
            self._console.send(messages.encode(messages.Notice(news)))

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Send a setpoint to the gateway; return the gateway's newest status, which is of an earlier step.

        A setpoint that cannot be queued is dropped; the gateway notices once the previous one expires.
        """
        sent = setpoint is not None and self._gateway.send(link.encode_setpoint(setpoint))
        self._handed = self._clock() if sent else math.nan
        self._urgent.end()
        return self._feedback.status if self._feedback else _NO_STATUS

    def _measure(self, begun: ScheduledTick, done: CompletedTick, decoded: float) -> None:
        """Record the tick's latency, leg by leg."""
        setpoint = done.result.setpoint
        row = LatencyRow(
            tick=begun.tick,
            sequence=setpoint.sequence if setpoint else -1,
            due_s=begun.due,
            epoch_s=self._pipeline.newest_epoch,
            received_s=self._received,
            woken_s=self._woken,
            decoded_s=decoded,
            sensed_s=done.seen,
            decided_s=done.decided,
            handed_s=self._handed,
            framed_s=math.nan,
            simulated_s=self._clock(),
            woken_by=begun.woken_by,
            missed=begun.missed,
        )
        self._latency_faults = self._latency.step(row)
        for completed in self._latency.completed():
            self._recorder.timed(completed)

    def _show_people(self, done: CompletedTick) -> None:
        """Have the people's pages show how their persons are, and what is around them."""
        if self._people is None:
            return
        pose, vehicle = done.result.pose, self._resolved.vehicle
        car = None
        if pose is not None:
            bumper = move_point(pose, vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER)
            box = behind_bumper(bumper.x, bumper.y, bumper.heading, vehicle.length, vehicle.width)
            car = RoadCar(box, pose.speed)
        actors = self._road.around[EGO].actors
        pairs = zip(self._resolved.people, self._people.states, strict=False)
        self._people_feed.show(self._state.value, [view_of(setup, state, car, actors) for setup, state in pairs])

    def _details(self, result: TickResult) -> dict[str, str]:
        """Return the numbers behind this tick's reason codes, as text by code."""
        if result.pose is None:
            return {}
        start = start_pose.start_pose_of(result.pose, self._resolved.path)
        numbers = {
            "start_position": start.place_text(),
            "start_heading": start.turn_text(),
            "off_path": f"{abs(result.d):.1f} m",
            "not_calm": "" if self._calm is None else self._calm.worst_text,
        }
        return {code: words for code, words in numbers.items() if words and code in result.faults}

    def _beside(self, begun: ScheduledTick, result: TickResult, people: Sequence[PersonState]) -> SampleContext:
        """Return what the page's process gets beside the completed tick; `people` are those that it saw."""
        now = self._clock()
        return SampleContext(
            tick=begun.tick,
            due=begun.due,
            wall=time.time() - (now - begun.due),
            fix=self._pipeline.newest_fix,
            feedback=self._feedback,
            feedback_age=now - self._feedback_at if self._feedback else math.inf,
            details=self._details(result),
            latency=self._latency.newest,
            missed=self._scheduler.missed,
            signals=self._road.signals_now,
            people=people,
            outcome=None if self._outcome is None else self._outcome.value,
        )

    @property
    def _state(self) -> ArmingState:
        return self._feedback.status.state if self._feedback else ArmingState.DISARMED

    def _watch_for_the_end(self, now: float, done: CompletedTick) -> None:
        """Find the drive's outcome; its duration counts from the operator's go."""
        result, status = done.result, done.status
        self._let_go |= self._has_engaged and status.state is ArmingState.DISARMED
        if status.state in ENDING and not self._let_go:
            # A fault after the car was parked is none of the drive's.
            self._stop_reasons = status.reasons
        if self._outcome is not None or status.state not in COMMANDING | {ArmingState.FAULT}:
            return
        if self._feedback is None or (status.state is ArmingState.ENGAGED and WAITING in status.reasons):
            return
        if self._go_time is None:
            if status.state is ArmingState.FAULT:
                return
            self._go_time = now
            self._road.start_actors()
        pose, contact = result.pose, bool(self._road.around[EGO].contacts)
        speed, driven = pose.speed if pose else math.nan, now - self._go_time
        ahead = partial(self._standstill_classifier.classify, pose, result.s, done.actors)
        outcome = self._termination.step(driven, speed, result.s, status.state, status.reasons, contact, ahead)
        if outcome is None and driven > self._resolved.scenario.duration_s:
            outcome = Outcome.TIMEOUT
        if outcome in (Outcome.STOPPED, Outcome.ARRIVED, Outcome.TIMEOUT):
            self._close(self._termination.unless_contact(outcome), status.reasons)

    def _close(self, outcome: Outcome, reasons: tuple[str, ...]) -> None:
        self._outcome = outcome
        self._recorder.ended(self._summary(outcome, reasons))

    def _close_by_the_gateway(self) -> None:
        """Set the outcome of a drive that the gateway has ended."""
        if self._state in COMMANDING:
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
        return {
            "outcome": outcome.value,
            "reasons": list(reasons),
            "signals": road.signals,
            "removed_at_entry": list(road.removed_at_entry),
            "removed_after_standoff": list(road.removed_after_standoff),
            "warnings": list(road.warnings),
            "text": self._pipeline.failure or road.traceback or road.around[EGO].detail,
            "clock": self._pipeline.clock_report(),
            "receiver": self._source.sender_report(),
            "step_time": road.step_time_summary,
            "no_calm_second": self._calm is not None and self._calm.given_up,
        }

    def _send_status(self, begun: ScheduledTick, result: TickResult) -> None:
        """Send the console a status; a console that is slow misses some."""
        now = self._clock()
        if now - self._status_sent_at < STATUS_PERIOD and self._outcome is None:
            return
        self._status_sent_at = now
        pose, ranges = result.pose, newest_scan(result.sensors).range
        status = messages.DriveStatus(
            tick=begun.tick,
            time_s=now,
            faults=result.faults,
            details=self._details(result),
            pose_reasons=result.pose_reasons,
            speed_mps=pose.speed if pose else None,
            to_go_m=self._resolved.path.length - result.s if pose else None,
            deviation_m=result.d if pose else None,
            range_m=float(ranges.min()) if len(ranges) else None,
            note=result.setpoint.note if result.setpoint else "",
            latency=self._latency.screen(),
            missed=self._scheduler.missed,
            clock=self._clock_report,
            outcome=None if self._outcome is None else self._outcome.value,
        )
        self._console.send(messages.encode(status))

    def _end(self) -> None:
        """Finish the record and close everything, after the gateway's process has gone."""
        self._take()  # a failed send may have shown that the gateway is gone before its last messages were read
        if self._outcome is None:
            self._close_by_the_gateway()
        for row in self._latency.close():
            self._recorder.timed(row)
        self._tick.finish()
        self._recorder.finish(RECORDER_TIMEOUT)
        self._source.close()
        if self._link is not None:
            self._link.close()
        if self._view is not None:
            self._view.close()
        if self._people is not None:
            self._people_feed.close()
        if self._stations_feed is not None:
            self._stations_feed.close()
        self._road.close()


def main() -> int:
    """Run the process and return its exit code: an error's own, 1 for a bug, else 0."""
    # Signals are ignored: this process ends with the gateway, for a moving car needs fallback paths.
    signals.ignore()
    set_oom_score(OOM_DRIVE)
    config, channels = spawn.receive_config()
    folder = Path(config["folder"])
    try:
        LiveDrive(config, channels).run()
    except VveError as error:
        channels["console"].send(messages.refusal(error))
        return error.exit_code
    except Exception:
        # A bug: the gateway stops the car as soon as this process is gone; the traceback goes to the record's folder.
        with contextlib.suppress(OSError):
            (folder / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
