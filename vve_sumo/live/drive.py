"""The process that drives: pose bytes and SUMO's street in, setpoints out, once a tick, phase-locked to the receiver.

Sense and act first: the setpoint is on its way to the gateway before anything else is done. The way to rest, the record
and SUMO's step come in the slack after it. Nothing here can reach the car's bus, and nothing here sends a setpoint but
the tick that computed it.
"""

from __future__ import annotations

import contextlib
import gc
import json
import math
import select
import sys
import time
import traceback
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, Final

from vve_sumo.drive.latency_monitor import LatencyMonitor
from vve_sumo.drive.lockstep import WAITING
from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.resolved_scenario import PERIOD
from vve_sumo.drive.termination import Outcome, TerminationMonitor
from vve_sumo.drive.tick_rows import RecordedTick, keep_scan, tick_row
from vve_sumo.drive.tick_scheduler import ScheduledTick, TickScheduler
from vve_sumo.drive.virtual_road import VirtualRoad, cast_of, open_world
from vve_sumo.errors import VveError
from vve_sumo.live import signals, spawn, start_pose
from vve_sumo.live.alignment import LotAlignment
from vve_sumo.live.assembly import chain_of, restored, source_of
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import DRIVE, TAKEN_NEXT, prefer, when_memory_ends
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.values import ArmingState, GatewayStatus, LatencyRow, Pose, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming import COMMANDING, ENDING
from vve_sumo.world.ego_sync import EgoSyncReport

#: between two looks of the console at the drive [s]
STATUS_PERIOD: Final = 0.1
#: ticks between what takes half a millisecond and can wait: a small garbage collection, a look at the clocks
SELDOM: Final = 100
#: on the sockets [s]
LONGEST_WAIT: Final = 0.1
#: what the last words to the recorder may take [s]
PATIENCE: Final = 5.0

_NOTHING: Final = GatewayStatus(ArmingState.DISARMED, (), 0.0, 0.0, (), 0.0, 0.0)


class LiveDrive:
    """One live drive's loop, with all that it holds open."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel]) -> None:
        """Put everything together; raises VveError where something in the configuration is not usable."""
        self._t0: float = config["t0"]
        self._gateway, self._console = channels["gateway"], channels["console"]
        self._tap = RecorderClient(channels["recorder"])
        working = FilePath(config["working"])
        self._setting, self._rig = restored(config["resolved"], working)
        ground = LotAlignment.of(config["resolved"])
        self._chain = chain_of(self._setting, self._rig, ground, working)
        self._found: tuple[str, ...] = tuple(config["not_ready"])
        self._broken = ""  # the story of a mistake of ours that the street ended with
        self._street = VirtualRoad(open_world(self._setting, time.perf_counter), cast_of(self._setting))
        self._source = source_of(self._rig)
        latency = self._rig.latency
        self._ledger = LatencyMonitor(latency.budget_ms / 1000.0, latency.breaches)
        self._pacer = TickScheduler(self._clock(), PERIOD, latency.deadline_ms / 1000.0)
        self._ending = TerminationMonitor(self._setting.path.length, self._setting.scenario.after_stop_s)
        self._feedback: link.Feedback | None = None
        self._late: tuple[str, ...] = ()
        self._datagrams = 0
        self._received = self._woken = math.nan
        self._has_engaged = False
        self._went_at: float | None = None
        self._outcome: Outcome | None = None
        self._why: tuple[str, ...] = ()  # the gateway's reasons for stopping, which it forgets once it has let go
        self._told_at = -math.inf
        self._clocks: dict[str, Any] = {}
        self._ears: list[Any] = [self._source, self._gateway, self._console]

    def run(self) -> None:
        """Tick until the gateway is gone: while the car moves there is a way to rest to be told, console or none."""
        gc.collect()
        gc.freeze()
        gc.disable()
        # Not before: to load a street takes a second, in which nobody else would get this core.
        prefer(DRIVE)
        while not self._gateway.closed:
            self._wait()
            self._tick()
        self._end()

    def _clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self._t0

    # Before a tick.

    def _wait(self) -> None:
        """Wait on the sockets until the next tick is to begin, and take in what has come."""
        self._hear()
        while (left := self._pacer.wait_until() - self._clock()) > 0.0:
            left = min(left, self._source.next_due() - time.monotonic(), LONGEST_WAIT)
            # select, not poll: a millisecond of rounding is a lot here.
            select.select(self._ears, [], [], max(left, 0.0))
            self._hear()

    def _hear(self) -> None:
        self._woken = self._clock()
        self._take()

    def _take(self) -> None:
        """Take in what has come; the kernel's stamp tells when."""
        for stamp, data in self._source.receive():
            received = stamp - self._t0
            self._chain.receive(received, data)
            self._tap.received_pose(received, data)
            self._datagrams += 1
            self._received = received
            self._pacer.arrived(received, self._chain.heard)
        for data in self._gateway.receive():
            feedback = link.decode_feedback(data)
            if isinstance(feedback, link.Feedback):
                self._feedback = feedback
                self._has_engaged |= feedback.verdict.state in COMMANDING
                self._ledger.framed(feedback.sequence, feedback.sent)
        self._console.receive()
        for ear, gone in ((self._source, self._source.lost), (self._console, self._console.closed)):
            if gone and ear in self._ears:
                # A dead connection is always ready, and would make the wait a busy one.
                self._ears.remove(ear)

    # A tick.

    def _tick(self) -> None:
        decoded = self._clock()
        begun = self._pacer.begin(decoded)
        feedback = self._feedback
        steering = feedback.measured_steering if feedback else math.nan
        self._chain.see(begun.due, self._street.actors)
        seen = self._clock()
        decided = self._chain.decide(begun.tick, begun.due, steering, self._faults(begun))
        computed = self._clock()
        handed = self._hand_over(decided.setpoint)
        # All that follows happens in the slack.
        self._keep(begun, decided, steering)
        row = LatencyRow(
            tick=begun.tick,
            sequence=decided.setpoint.sequence if decided.setpoint else -1,
            due_s=begun.due,
            epoch_s=self._chain.heard,
            received_s=self._received,
            woken_s=self._woken,
            decoded_s=decoded,
            seen_s=seen,
            decided_s=computed,
            handed_s=handed,
            framed_s=math.nan,
            simulated_s=self._clock(),
            woken_by=begun.woken_by,
            missed=begun.missed,
        )
        self._late = self._ledger.step(row)
        for done in self._ledger.completed():
            self._tap.timed(done)
        verdict = feedback.verdict if feedback else _NOTHING
        self._watch_for_the_end(begun.due, decided, verdict)
        self._tap.flush()
        self._tell(begun, decided, verdict)
        if begun.tick % SELDOM == 0:
            self._clocks = self._chain.clock_report()
            gc.collect(0)

    def _faults(self, begun: ScheduledTick) -> tuple[str, ...]:
        recording = (self._tap.failure,) if self._tap.failure else ()
        street = self._before_engaging() + self._street.found
        return self._found + street + begun.faults + self._late + recording + self._source.found()

    def _before_engaging(self) -> tuple[str, ...]:
        """Reason codes of what has to hold until the car is engaged, and then no more; to be asked after the pose."""
        if self._has_engaged:
            return ()
        waits = () if self._street.fits else ("street_not_measured",)
        pose = self._chain.pose
        return waits if pose is None else waits + start_pose.of(pose, self._setting.path).faults()

    def _details(self, decided: TickResult) -> dict[str, str]:
        """Return the numbers behind reason codes of this tick, in words."""
        if decided.pose is None:
            return {}
        stands = start_pose.of(decided.pose, self._setting.path)
        numbers = {
            "start_position": stands.place(),
            "start_heading": stands.turn(),
            "off_path": f"{abs(decided.deviation):.1f} m",
        }
        return {code: words for code, words in numbers.items() if code in decided.faults}

    @property
    def _state(self) -> ArmingState:
        return self._feedback.verdict.state if self._feedback else ArmingState.DISARMED

    def _hand_over(self, setpoint: Setpoint | None) -> float:
        """Send a setpoint to the gateway; a gateway that takes none hears of it by its lifetime."""
        if setpoint is None or not self._gateway.send(link.encode_setpoint(setpoint)):
            return math.nan
        return self._clock()

    def _keep(self, begun: ScheduledTick, decided: TickResult, steering: float) -> None:
        """Prepare the way to rest, let the street reach the next tick, and record this one."""
        chain, street, tap = self._chain, self._street, self._tap
        chain.prepare(begun.due + PERIOD, steering)
        keep_scan(tap, begun.tick, decided)
        tap.snapshot(begun.tick, street.actors)
        asked, report = self._advance(begun)
        verdict = self._feedback.verdict if self._feedback else _NOTHING
        moment = RecordedTick(begun.tick, begun.due, self._datagrams, steering, decided, verdict)
        tap.ticked(tick_row(moment, None, self._setting.path, asked, report, street))

    def _advance(self, begun: ScheduledTick) -> tuple[Pose | None, EgoSyncReport | None]:
        """Have the street reach the next tick and return what it was asked and says; nothing once it broke.

        What breaks in it, SUMO, traffic or the scenario's actors, stops the car by this process, which goes on: the
        gateway has the newest way to rest, and the record its end.
        """
        asked = report = None
        try:
            for step in range(0 if self._broken else begun.catch_up + 1):
                asked = self._chain.front_bumper_at(self._pacer.next_due - (begun.catch_up - step) * PERIOD)
                report = self._street.advance(asked, waits=self._went_at is None)
        except VveError:
            raise  # of the first pose alone, before which nothing is armed: the drive is refused
        except Exception:
            self._broken = traceback.format_exc()
            self._found += ("street_failed",)
        return asked, report

    def _watch_for_the_end(self, now: float, decided: TickResult, verdict: GatewayStatus) -> None:
        """Find how the drive ends; its time counts from the operator's go."""
        if verdict.state in ENDING:
            self._why = verdict.reasons
        if self._outcome is not None or verdict.state not in COMMANDING | {ArmingState.FAULT}:
            return
        if self._feedback is None or (verdict.state is ArmingState.ENGAGED and WAITING in verdict.reasons):
            return
        if self._went_at is None:
            if verdict.state is ArmingState.FAULT:
                return
            self._went_at = now
        pose, contact = decided.pose, bool(self._street.contacts)
        speed, driven = pose.speed if pose else math.nan, now - self._went_at
        outcome = self._ending.step(driven, speed, decided.station, verdict.state, contact)
        if outcome is None and driven > self._setting.scenario.duration_s:
            outcome = Outcome.TIMEOUT
        if outcome in (Outcome.STOPPED, Outcome.ARRIVED, Outcome.TIMEOUT):
            self._close(outcome, verdict.reasons)

    def _close(self, outcome: Outcome, reasons: tuple[str, ...]) -> None:
        self._outcome = outcome
        self._tap.ended(self._how(outcome, reasons))

    def _close_by_the_gateway(self) -> None:
        """Name the ending of a drive that the gateway has ended."""
        if self._state in COMMANDING:
            # It went without a word while the car was its own.
            self._close(Outcome.FAULT, (*self._why, "gateway_gone"))
        elif self._went_at is None:
            self._close(Outcome.INTERRUPTED, self._why)
        elif "driver_override" in self._why:
            self._close(Outcome.DRIVER, self._why)
        elif self._ending.collided:
            self._close(Outcome.CONTACT, self._why)
        elif set(self._why[:1]) <= {"stop_asked", "operator_gone"}:
            # What was found on the way to rest stands with the reasons; the drive was over by then.
            self._close(Outcome.INTERRUPTED, self._why)
        else:
            self._close(Outcome.FAULT, self._why)

    def _how(self, outcome: Outcome, reasons: tuple[str, ...]) -> dict[str, Any]:
        street = self._street
        return {
            "outcome": outcome.value,
            "reasons": list(reasons),
            "cleared": list(street.cleared),
            "standoffs": list(street.standoffs),
            "warnings": list(street.warnings),
            "text": self._chain.failure or self._broken or street.detail,
            "clock": self._chain.clock_report(),
            "receiver": self._source.told(),
            "headroom": street.load,
        }

    def _tell(self, begun: ScheduledTick, decided: TickResult, verdict: GatewayStatus) -> None:
        """Tell the console how it goes; it may be slow, and then it misses something."""
        now = self._clock()
        if now - self._told_at < STATUS_PERIOD and self._outcome is None:
            return
        self._told_at = now
        pose = decided.pose
        detections = decided.detections
        status = {
            "tick": begun.tick,
            "time_s": now,
            "faults": list(decided.faults),
            "details": self._details(decided),
            "pose_reasons": list(decided.pose_reasons),
            "speed_mps": pose.speed if pose else None,
            "to_go_m": self._setting.path.length - decided.station if pose else None,
            "deviation_m": decided.deviation if pose else None,
            "range_m": float(detections.range.min()) if len(detections.range) else None,
            "note": decided.setpoint.note if decided.setpoint else "",
            "latency": self._ledger.screen(),
            "missed": self._pacer.missed,
            "clock": self._clocks,
            "outcome": None if self._outcome is None else self._outcome.value,
        }
        self._console.send(json.dumps(status).encode())

    def _end(self) -> None:
        """Leave everything as whole as it can be; the car stands or is the gateway's."""
        self._take()  # that it is gone may have shown in sending, before all was read that it had said
        if self._outcome is None:
            self._close_by_the_gateway()
        for row in self._ledger.close():
            self._tap.timed(row)
        self._tap.finish(PATIENCE)
        self._source.close()
        self._street.close()


def main() -> int:
    """Run the process; its exit code tells the console who is to blame."""
    # This process ends with the gateway: while the car moves there is a way to rest to be told.
    signals.ignore()
    when_memory_ends(TAKEN_NEXT)
    config, channels = spawn.begin()
    folder = FilePath(config["folder"])
    try:
        LiveDrive(config, channels).run()
    except VveError as error:
        channels["console"].send(json.dumps({"refused": str(error), "exit_code": error.exit_code}).encode())
        return error.exit_code
    except Exception:
        # A mistake of ours: the gateway stops the car as soon as this process is gone; the story lies in the record.
        with contextlib.suppress(OSError):
            (folder / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
