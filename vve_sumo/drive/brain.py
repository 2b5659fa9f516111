"""An external controller (brain): a computer that gets samples, beside the scenario's controller or in its place.

Its setpoints come back. The module knows samples and setpoints; it must not know what carries them, which is a `Link`.
`external_controller` makes the one object that every drive has of it, in lockstep, live, certified or replayed. Time
is the drive's: in lockstep the external controller is waited for at every tick, live it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, Protocol

from vve_sumo.controller import Controller
from vve_sumo.drive.pipeline import SensorFrame
from vve_sumo.errors import RigError
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.intersections import SignalPhase
from vve_sumo.values import (
    CameraObjects,
    ControlCommand,
    Detections,
    Observation,
    PointCloud,
    SensorOutput,
    Stations,
    StopLines,
    newest_scan,
)
from vve_sumo.wire.sample import LidarTurn, OwnMotion, Sample, SampleContent, sequence_of, virtual_fix
from vve_sumo.wire.setpoints import SILENT, SetpointInbox
from vve_sumo.wire.vlp16 import turn_of

#: note of a command in whose place no setpoint is alive; the fault beside it makes the gateway stop. Records hold this
#: note and the one below, and are compared with them: so both keep the words that they had first
_NOTHING: Final = "no foreign setpoint"
#: note of the command of a car that an external controller commands itself
_COMMANDS_ITSELF: Final = "external brain"

#: reason code of a brain that has let its whole time pass in lockstep
OVERDUE: Final = "brain_overdue"

#: who decides, as `brain.kind` of a rig says: the scenario's own controller, whose sensors an external one only sees;
#: an external controller by setpoints; one that commands the car itself
ExternalControllerKind = Literal["own", "setpoints", "external"]


class Link(Protocol):
    """The way to an external controller and back."""

    def send(self, sample: Sample) -> None:
        """Send a sample on all outgoing wires; neither waits nor raises."""

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the datagrams that have come by drive time `now` [s], each with its time of arrival [s].

        With `wait`, those until the first; raises TimeoutError, with one line that says for how long nothing came, for
        a brain that lets its time pass.
        """


class NoLink:
    """The way to nobody, of a drive whose brain cannot be asked again."""

    def send(self, sample: Sample) -> None:
        """Send nothing."""

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return nothing, at once."""
        return ()


def virtual_placement(frame: MapFrame, mounting: Mounting, epoch: float) -> Placement:
    """Return the placement of a receiver that drives on the virtual road itself: the virtual road's map is its own."""
    return Placement(frame, Alignment(), mounting, epoch)


class Publisher:
    """Makes the sample of every tick and sends it."""

    def __init__(
        self,
        send: Callable[[Sample], None],
        placement: Placement,
        epoch: float,
        *,
        awaiting_start: bool = False,
        wired: Collection[str] = (),
        needs_signals: bool = False,
        needs_ego: bool = False,
    ) -> None:
        """`placement` is `virtual_placement`'s; `epoch` is the GNSS second of drive time 0.

        `awaiting_start`: nothing is valid until the drive begins, for a brain that would drive off by what it sees.
        `wired` are the lidars and cameras that the wires carry; `needs_signals`: whether one carries the signals;
        `needs_ego`: whether one tells others of the ego also while nothing is valid.
        """
        self._needs_ego = needs_ego
        self._send, self._placement, self._epoch, self._wired = send, placement, epoch, tuple(wired)
        self._turned: dict[str, float] = {}  # drive time of the newest turn of each lidar that was sent
        self.sequence = 0  #: of the newest sample
        self.radar_valid = False  #: whether the newest sample holds a scan
        self.state = ""  #: of the gateway, as the drive knew it last
        self.over = False  #: set when the drive ends: from then on every sample is invalid
        self.needs_signals = needs_signals  #: whether the drive has to set `signals`
        #: returns what the signals of the virtual road show at a drive time [s]
        self.signals: Callable[[float], Mapping[str, SignalPhase]] = lambda now: {}
        self.awaiting_start = awaiting_start  #: whether every sample is invalid because the drive has not begun

    def publish(self, now: float, seen: SensorFrame | None, faults: tuple[str, ...]) -> None:
        """Send the sample of a tick; any fault but the brain's own silence makes it invalid, and so does no pose."""
        # A live tick keeps to the receiver's clock, so two may lie within one period of ours.
        self.sequence = max(self.sequence + 1, sequence_of(now))
        sound = seen is not None and not (self.over or self.awaiting_start) and all(code == SILENT for code in faults)
        measured = self._measured(now, seen) if seen is not None and sound else None
        own = self._own(seen, faults) if self._needs_ego else None
        sample = Sample(self.sequence, self._epoch + now, now, measured, own, faults, self.state)
        self.radar_valid = sample.radar_valid
        self._send(sample)

    def _own(self, seen: SensorFrame | None, faults: tuple[str, ...]) -> OwnMotion | None:
        """Return where the ego knows itself to be; None where it does not."""
        return None if seen is None or "pose_stale" in faults else OwnMotion(seen.pose, seen.fix.position_sigma)

    def _measured(self, now: float, seen: SensorFrame) -> SampleContent:
        scan = newest_scan(seen.sensors)
        age = now - scan.time if math.isfinite(scan.time) else math.inf
        others = {
            name: output
            for name, output in seen.sensors.items()
            if output is not scan and isinstance(output, Detections)
        }
        fix = virtual_fix(seen.pose, self._placement, seen.fix)
        wired = {name: seen.sensors[name] for name in self._wired if name in seen.sensors}
        lists = {name: output for name, output in wired.items() if isinstance(output, CameraObjects)}
        return SampleContent(
            fix,
            seen.pose,
            scan,
            age,
            seen.actors,
            others,
            self._new_turns(wired),
            lists=lists,
            stations_by_receiver={name: output for name, output in wired.items() if isinstance(output, Stations)},
            lines={name: output for name, output in wired.items() if isinstance(output, StopLines)},
            signals=self.signals(now),
        )

    def _new_turns(self, wired: Mapping[str, SensorOutput]) -> dict[str, LidarTurn]:
        """Return the turns of the lidars that a wire carries, each once."""
        turns = {}
        for name, cloud in wired.items():
            if isinstance(cloud, PointCloud) and cloud.time > self._turned.get(name, -math.inf):
                self._turned[name] = cloud.time
                turns[name] = turn_of(cloud)
        return turns


class SetpointController:
    """Answers an observation with the newest external setpoint that is alive."""

    def __init__(self, publisher: Publisher, link: Link, inbox: SetpointInbox, *, waits: bool) -> None:
        """`waits`: whether a tick waits for the setpoint that answers its sample."""
        self._publisher, self._link, self._waits = publisher, link, waits
        self.inbox = inbox  #: what has come, and why of it what was refused
        self.faults: tuple[str, ...] = (SILENT,)  #: reason codes for the next tick
        self.overdue = ""  #: one line, set when the brain has let its time pass: it is never waited for again

    def step(self, observation: Observation) -> ControlCommand:
        """Return what the newest setpoint asks for; a brain that asks for nothing is a fault of the next tick."""
        now, publisher, inbox = observation.time, self._publisher, self.inbox
        inbox.sample_sent(publisher.sequence)
        try:
            self._take(now)
        except TimeoutError as error:
            self.overdue = f"drive time {now:.2f} s: {error}"
        command = inbox.command(now)
        self.faults = () if command is not None else (SILENT,)
        if self.overdue:
            self.faults = (OVERDUE,)
        return command or ControlCommand(_steering_as_reported(observation), 0.0, note=_NOTHING)

    def _take(self, now: float) -> None:
        publisher, inbox = self._publisher, self.inbox
        while True:
            # No brain needs to answer what is invalid.
            owed = self._waits and not self.overdue and publisher.radar_valid
            owed = owed and not inbox.answered(publisher.sequence)
            came = self._link.receive(now, owed)
            for received, data in came:
                inbox.take(received, data)
            if not (came and owed):
                return

    def require_answer(self) -> None:
        """Raise RigError where the brain has let its time pass before its first setpoint: it is not there."""
        if self.overdue and not self.inbox.taken:
            refused = ", ".join(f"{count} x {code}" for code, count in sorted(self.inbox.counts.items()))
            was = f"of its answers none was taken ({refused})" if refused else "start it before the drive"
            raise RigError(f"the brain does not answer, {self.overdue}: {was}")


class NoController:
    """Asks for nothing: the external controller commands the car itself."""

    faults: tuple[str, ...] = ()
    overdue = ""

    def require_answer(self) -> None:
        """Nobody waits for a brain that commands the car by itself."""

    def step(self, observation: Observation) -> ControlCommand:
        """Return the steering that the car reports, and no acceleration."""
        return ControlCommand(_steering_as_reported(observation), 0.0, note=_COMMANDS_ITSELF)


def _steering_as_reported(observation: Observation) -> float:
    return observation.steering if math.isfinite(observation.steering) else 0.0


class CommandSource(Protocol):
    """What stands in the place of a drive's controller."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Reason codes for the next tick."""
        ...

    @property
    def overdue(self) -> str:
        """One line on a brain that has let its time pass in lockstep; else empty."""
        ...

    def step(self, observation: Observation) -> ControlCommand:
        """Return the command of a tick, as a controller does."""
        ...

    def require_answer(self) -> None:
        """Raise RigError where the brain was waited for and is not there."""
        ...


@dataclass(frozen=True, slots=True)
class ExternalController:
    """What a drive has of external controllers: the wires out, and what stands in the place of its controller."""

    publisher: Publisher | None  #: None: nothing goes out on wires
    controller: CommandSource | None = None  #: None: the scenario's own controller drives

    @property
    def faults(self) -> tuple[str, ...]:
        """Reason codes for the next tick."""
        return () if self.controller is None else self.controller.faults

    @property
    def refused(self) -> dict[str, int]:
        """Answers that were not taken: how many, by reason code."""
        return dict(self.controller.inbox.counts) if isinstance(self.controller, SetpointController) else {}

    @property
    def taken(self) -> int:
        """How many setpoints were taken."""
        return self.controller.inbox.taken if isinstance(self.controller, SetpointController) else 0

    @property
    def overdue(self) -> str:
        """One line on a brain that has let its time pass in lockstep; else empty."""
        return "" if self.controller is None else self.controller.overdue

    def require_answer(self) -> None:
        """Raise RigError where the brain was waited for and is not there."""
        if self.controller is not None:
            self.controller.require_answer()

    def select_controller(self, own: Callable[[], Controller]) -> Controller:
        """Return the controller of the drive; the scenario's own is made only where it drives."""
        return own() if self.controller is None else self.controller


def external_controller(
    kind: ExternalControllerKind,
    link: Link,
    frame: MapFrame,
    mounting: Mounting,
    epoch: float,
    key: bytes = b"",
    *,
    waits: bool = False,
    wired: Collection[str] = (),
    needs_signals: bool = False,
    needs_ego: bool = False,
) -> ExternalController:
    """Return what a drive has of the external controller that a link leads to; `kind` is `brain.kind` of a rig.

    `frame` is the virtual road's map, `mounting` the receiver's, `epoch` the GNSS second of drive time 0, `key` signs
    setpoints. `waits`: whether a tick waits for the setpoint that answers its sample. `wired` are the lidars and
    cameras that the wires carry, `needs_signals` says whether one carries the signals, `needs_ego` whether one tells
    others of the ego.
    """
    # A brain that commands the car by itself would drive off by what it sees: it sees nothing before the go.
    placement, waits_for_go = virtual_placement(frame, mounting, epoch), kind == "external"
    publisher = Publisher(
        link.send,
        placement,
        epoch,
        awaiting_start=waits_for_go,
        wired=wired,
        needs_signals=needs_signals,
        needs_ego=needs_ego,
    )
    if kind == "setpoints":
        return ExternalController(
            publisher, SetpointController(publisher, link, SetpointInbox(epoch, key), waits=waits)
        )
    return ExternalController(publisher, NoController() if kind == "external" else None)
