"""Runs the drive's process: pose bytes in, setpoints out, once a tick, phase-locked to the receiver.

Waits on the sockets until a tick is due, runs `drive.tick`, and measures the tick's latency. Nothing here can reach a
car's bus, and a setpoint is sent only by the tick that computed it.

A drive has one real car or several, each with its own receiver and gateway, and simulated egos beside them. All share
one tick and one virtual road. The tick is phase-locked to the receiver of the car of [ego]. A car that can no longer
be counted on stays where it is on the road, and every other car is told.
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
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.stations_on_road import StationsOnRoad
from vve_sumo.drive.tick import CarInput, CompletedTick, DueTick, Tick
from vve_sumo.drive.virtual_road import open_world, scenario_engine
from vve_sumo.errors import VveError
from vve_sumo.frames import move_point
from vve_sumo.geometry import behind_bumper
from vve_sumo.live import messages, signals, spawn
from vve_sumo.live.assembly import from_dict, pipeline_of, with_rigs
from vve_sumo.live.brain_link import ChannelLink, key_of, needs_ego, needs_signals, open_setpoints, wired_sensors
from vve_sumo.live.car import CarParts, LiveCar
from vve_sumo.live.channel import Channel
from vve_sumo.live.other_cars import OtherCars
from vve_sumo.live.people_link import PeopleFeed
from vve_sumo.live.priority import DRIVE_NICE, DRIVE_PRIORITY, OOM_DRIVE, RealTimeSection, raise_priority, set_oom_score
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.live.road import LiveRoad
from vve_sumo.live.simulated_ego import SimulatedEgo
from vve_sumo.live.stations_link import StationsFeed
from vve_sumo.live.tick_scheduler import ScheduledTick, TickScheduler
from vve_sumo.live.view_feed import ViewFeed
from vve_sumo.people.person import People, PersonState
from vve_sumo.people.person_view import RoadCar, view_of
from vve_sumo.rig.resolve import mounting_of
from vve_sumo.rig.schema import Rig
from vve_sumo.stations.received_stations import ReceivedStations, StationsSetup
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Point
from vve_sumo.wire.outputs import KINDS

#: between two status messages to the console [s]
STATUS_PERIOD: Final = 0.1
#: ticks between work that takes half a millisecond and can wait: a small garbage collection, the clock's report
HOUSEKEEPING_TICKS: Final = 100
#: ticks between two messages to the people's pages
PEOPLE_TICKS: Final = 5
#: longest wait on the sockets [s]
MAX_WAIT: Final = 0.1
#: longest time to send the last messages to all recorders [s]
RECORDER_TIMEOUT: Final = 5.0


class _CarInputs:
    """What a tick takes of the egos' cars, each when it is asked for."""

    def __init__(self, cars: Sequence[LiveCar], simulated: Sequence[SimulatedEgo], due: DueTick) -> None:
        self._cars = {car.id: car for car in cars}
        self._simulated = {ego.id: ego for ego in simulated}
        self._due = due

    def __getitem__(self, ego: str, /) -> CarInput:
        if (car := self._cars.get(ego)) is not None:
            if ego != EGO:
                # The tick begins with the fix of the car of [ego]; that of another car may have come since then.
                car.take_newest()
            return car.input()
        return self._simulated[ego].drive_to(self._due)


class LiveDrive:
    """The loop of one live drive, with everything that it holds open."""

    def __init__(self, config: Mapping[str, Any], channels: Mapping[str, Channel]) -> None:
        """Assemble the drive; raises VveError where something in the configuration is not usable."""
        self._t0: float = config["t0"]
        self._console = channels["console"]
        recorder = RecorderClient(channels["recorder"])
        self._view = ViewFeed(channels["view"]) if "view" in channels else None
        working = Path(config["working"])
        own, rig = from_dict(config["resolved"], working)
        lot = LotAlignment.from_dict(config["resolved"])
        link_, brain = self._foreign(own, rig, lot, channels.get("outputs"), working)
        pipeline = pipeline_of(own, rig, lot, working, brain)
        further = [self._further(one, channels, working) for one in config.get("further_cars", ())]
        self._resolved = with_rigs(own, [parts.resolved for parts in further])
        simulated = {one.ego_id for one in self._resolved.others} - {parts.ego for parts in further}
        self._simulated = [
            SimulatedEgo(one, working, RecorderClient(channels[f"recorder:{one.ego_id}"]))
            for one in self._resolved.others
            if one.ego_id in simulated
        ]
        self._road = LiveRoad(open_world(self._resolved, time.perf_counter), scenario_engine(self._resolved))
        publisher = None if brain is None else brain.publisher
        if publisher is not None and publisher.needs_signals:
            publisher.signals = self._road.timed_signals()
        first = CarParts(
            EGO, own, rig, pipeline, channels["gateway"], recorder, tuple(config["not_ready"]), brain, link_
        )
        self._urgent = RealTimeSection(DRIVE_PRIORITY)
        self._cars = self._opened([first, *further])
        self._first = self._cars[0]
        self._others = OtherCars(self._cars, self._say)
        self._tick = Tick(
            [*(car.tick for car in self._cars), *(ego.begin(self._road) for ego in self._simulated)],
            self._road,
            self._clock,
        )
        self._scheduler = TickScheduler(self._clock(), PERIOD, rig.latency.deadline_ms / 1000.0)
        self._woken = math.nan
        self._status_sent_at = -math.inf
        self._inputs: list[Any] = [*(part for car in self._cars for part in (car.source, car.gateway)), self._console]
        self._people: PeopleOnRoad | None = None
        if "people" in channels:
            self._people_feed = PeopleFeed(channels["people"])
            self._people = PeopleOnRoad(People(own.people), recorder)
            self._road.admit(self._people)
            self._inputs.append(self._people_feed)
        self._stations_feed: StationsFeed | None = None
        if "stations" in channels:
            setup = StationsSetup.from_dict(config["resolved"]["stations"])
            self._stations_feed = StationsFeed(channels["stations"])
            self._stations = StationsOnRoad(ReceivedStations(setup), recorder)
            self._road.admit_stations(self._stations)
            self._inputs.append(self._stations_feed)

    def _foreign(
        self, resolved: ResolvedScenario, rig: Rig, lot: LotAlignment, outputs: Channel | None, working: Path
    ) -> tuple[ChannelLink | None, ExternalController | None]:
        """Return the way to an external controller, and the brain; neither where the rig has no outputs."""
        if outputs is None:
            return None, None
        brain, key, setpoints = rig.brain, key_of(rig.brain, working), None
        if brain.kind == "setpoints":
            setpoints = open_setpoints(brain, key)
        actors = any(KINDS[table.kind].needs_actors for table in rig.outputs)
        link_ = ChannelLink(outputs, setpoints, self._t0, actors=actors)
        frame, mounting, wired = resolved.map_frame, mounting_of(rig), wired_sensors(rig)
        return link_, external_controller(
            brain.kind,
            link_,
            frame,
            mounting,
            lot.epoch,
            key,
            wired=wired,
            needs_signals=needs_signals(rig),
            needs_ego=needs_ego(rig),
        )

    @staticmethod
    def _further(config: Mapping[str, Any], channels: Mapping[str, Channel], working: Path) -> CarParts:
        """Return the parts of a real car besides that of [ego]."""
        content, ego = config["resolved"], config["ego"]
        resolved, rig = from_dict(content, working)
        pipeline = pipeline_of(resolved, rig, LotAlignment.from_dict(content), working)
        recorder = RecorderClient(channels[f"recorder:{ego}"])
        return CarParts(ego, resolved, rig, pipeline, channels[f"gateway:{ego}"], recorder, tuple(config["not_ready"]))

    def _opened(self, parts: Sequence[CarParts]) -> list[LiveCar]:
        """Return the cars with their receivers open; when the last has handed its setpoint over, no haste is left."""
        last = len(parts) - 1
        return [
            LiveCar(
                one,
                self._road,
                self._t0,
                self._urgent.end if place == last else _nothing,
                partial(self._beside, place),
            )
            for place, one in enumerate(parts)
        ]

    def run(self) -> None:
        """Tick until every gateway is gone: a moving car needs fallback paths even if the console is gone."""
        gc.collect()
        gc.freeze()
        gc.disable()
        # Not earlier: loading a network takes a second, during which no other process would get this core.
        raise_priority(DRIVE_NICE)
        self._urgent.begin()
        while not all(car.gateway.closed for car in self._cars):
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
            due = min(car.source.next_due() for car in self._cars)
            left = min(left, due - time.monotonic(), MAX_WAIT)
            # select, because poll rounds to whole milliseconds.
            select.select(self._inputs, [], [], max(left, 0.0))
            self._wake()

    def _wake(self) -> None:
        self._woken = self._clock()
        self._take()

    def _take(self) -> None:
        """Take in what has arrived; a pose datagram's arrival time is the kernel's time stamp."""
        for car in self._cars:
            for received in car.receive_fixes():
                if car is self._first:
                    self._scheduler.fix_arrived(received, car.pipeline.newest_epoch)
            car.read_gateway()
        self._console.receive()
        ends: list[tuple[Any, bool]] = [(self._console, self._console.closed)]
        for car in self._cars:
            ends += [(car.source, car.source.lost), (car.gateway, car.gateway.closed)]
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

    # A tick.

    def _step(self) -> None:
        decoded = self._clock()
        begun = self._scheduler.begin(decoded)
        for car in self._cars:
            car.scheduled_faults = begun.faults
            if news := car.observe_wake_up(decoded, decoded - begun.awaited):
                self._say(news)
        due = DueTick(begun.tick, begun.due, self._scheduler.next_due, begun.catch_up)
        people = () if self._people is None else self._people.states
        all_done = self._tick.step(due, _CarInputs(self._cars, self._simulated, due))
        done = all_done[EGO]
        for car in self._cars:
            car.measure(begun, all_done[car.id], self._woken, decoded)
            car.watch_for_the_end(begun.due, all_done[car.id])
        self._begin_road(begun.due)
        for ego in self._simulated:
            ego.ticked(all_done[ego.id], begun.due)
        for recorder in self._recorders():
            recorder.flush()
        self._send_status(begun, all_done)
        if self._view is not None:
            self._view.send(done, partial(self._first.context, begun, done.result, self._scheduler.missed, people))
        if begun.tick % PEOPLE_TICKS == 0:
            self._show_people(done)
        if begun.tick % HOUSEKEEPING_TICKS == 0:
            for car in self._cars:
                car.keep_clock_report()
            gc.collect(0)
        self._lose_cars()
        if begun.missed:
            # Ticks that take too long would else take a whole processor from the gateway, with no wait in between.
            self._urgent.pause()
        else:
            self._urgent.begin()

    def _begin_road(self, now: float) -> None:
        """Let actors and simulated egos begin once the car of [ego] goes."""
        if self._first.go_time is not None:
            self._road.start_actors()
        if self._first.goes:
            for ego in self._simulated:
                ego.go(now)

    def _lose_cars(self) -> None:
        """End the drive of a car whose gateway is gone while another car's is not; its body stays on the road."""
        if not all(car.gateway.closed for car in self._cars):
            for car in self._cars:
                if car.gateway.closed:
                    car.end_without_gateway()

    def _beside(self, place: int) -> tuple[str, ...]:
        """Return the reason codes of what is no single car's, for the car at this place."""
        found: tuple[str, ...] = ()
        if self._people is not None and self._people_feed.closed:
            found += ("people_gone",)
        if self._stations_feed is not None and self._stations_feed.closed:
            found += ("stations_gone",)
        return found + self._others.codes(place, self._clock()) if len(self._cars) > 1 else found

    def _say(self, line: str) -> None:
        self._console.send(messages.encode(messages.Notice(line)))

    def _recorders(self) -> list[RecorderClient]:
        return [*(car.recorder for car in self._cars), *(ego.recorder for ego in self._simulated)]

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
        states: Sequence[PersonState] = self._people.states
        pairs = zip(self._resolved.people, states, strict=False)
        self._people_feed.show(self._first.state.value, [view_of(setup, state, car, actors) for setup, state in pairs])

    def _send_status(self, begun: ScheduledTick, done: Mapping[str, CompletedTick]) -> None:
        """Send the console a status of every car; a console that is slow misses some."""
        now = self._clock()
        outcomes = sum(car.outcome is not None for car in self._cars)
        if now - self._status_sent_at < STATUS_PERIOD and outcomes < len(self._cars):
            return
        self._status_sent_at = now
        for car in self._cars:
            status = car.status(begun.tick, now, done[car.id].result, self._scheduler.missed)
            self._console.send(messages.encode(status))

    def _end(self) -> None:
        """Finish the record and close everything, after the gateways' processes have gone."""
        self._take()  # a failed send may have shown that a gateway is gone before its last messages were read
        for car in self._cars:
            car.end()
        for ego in self._simulated:
            ego.close(self._first.outcome)
        self._tick.finish()
        deadline = time.monotonic() + RECORDER_TIMEOUT
        for recorder in self._recorders():
            recorder.finish(max(deadline - time.monotonic(), 0.0))
        for car in self._cars:
            car.close()
        if self._view is not None:
            self._view.close()
        if self._people is not None:
            self._people_feed.close()
        if self._stations_feed is not None:
            self._stations_feed.close()
        self._road.close()


def _nothing() -> None:
    """Do nothing, where another car's setpoint is still to be handed over."""


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
