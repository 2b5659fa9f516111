"""An external controller over a link that is neither socket nor process: what a drive asks of it, lockstep and live."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from tests.test_controller import OBSERVATION
from tests.wire.test_outputs import NOBODY, POSE, SCAN
from vve_sumo.drive.brain import OVERDUE, ExternalController, ExternalControllerKind, Link, NoLink, external_controller
from vve_sumo.drive.pipeline import SensorFrame
from vve_sumo.errors import RigError
from vve_sumo.frames import MapFrame, Mounting
from vve_sumo.timing import PERIOD
from vve_sumo.values import ControlCommand, Observation
from vve_sumo.wire.datagrams import SetpointDatagram, encode_setpoint
from vve_sumo.wire.sample import Sample, no_fix
from vve_sumo.wire.setpoints import FORGED, SILENT
from vve_sumo.wire.signature import signed

EPOCH = 1.4e9
FRAME = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-81 +datum=WGS84 +units=m +no_defs")
KEY = bytes(range(32))
STEERING = 0.25  #: that the car reports [rad]


class Memory:
    """A link to a brain that brakes, and steers by a 64th of the number of its answer."""

    def __init__(self, key: bytes = b"", deaf_from: int = 10_000) -> None:
        """From the tick `deaf_from` on the brain answers no more."""
        self.sent: list[Sample] = []
        self.waits: list[bool] = []
        self._key, self._deaf_from = key, deaf_from
        self._waiting: list[bytes] = []

    def send(self, sample: Sample) -> None:
        self.sent.append(sample)
        if sample.radar_valid and len(self.sent) <= self._deaf_from:
            number = len(self.sent)
            said = encode_setpoint(SetpointDatagram(number, sample.sequence, sample.time, 0.1, number / 64, -1.5))
            self._waiting.append(signed(said, self._key) if self._key else said)

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        self.waits.append(wait)
        came, self._waiting = [(now, data) for data in self._waiting], []
        if wait and not came:
            raise TimeoutError("no answer within 10 s")
        return came


class Own:
    """The scenario's own controller."""

    def step(self, observation: Observation) -> ControlCommand:
        return ControlCommand(observation.steering, 1.0, note="own")


def brain(kind: ExternalControllerKind, link: Link, key: bytes = b"", *, waits: bool = False) -> ExternalController:
    return external_controller(kind, link, FRAME, Mounting(0.0, 0.0), EPOCH, key, waits=waits)


def tick(subject: ExternalController, number: int, faults: tuple[str, ...] = (), seen: bool = True) -> ControlCommand:
    """One tick: the sensors' word goes out, and whoever drives is asked."""
    now = number * PERIOD
    frame = SensorFrame(replace(POSE, time=now), no_fix(now, now), NOBODY, {"radar": replace(SCAN, time=now)})
    subject.publisher.publish(now, frame if seen else None, faults)
    return subject.select_controller(Own).step(replace(OBSERVATION, time=now, steering=STEERING))


@pytest.mark.parametrize("waits", [False, True])
@pytest.mark.parametrize("key", [b"", KEY], ids=["unsigned", "signed"])
def test_a_brain_of_setpoints_drives_in_lockstep_and_live_alike(key: bytes, waits: bool) -> None:
    link = Memory(key)
    subject = brain("setpoints", link, key, waits=waits)
    assert subject.faults == (SILENT,), "before it is first asked"
    for number in range(5):
        command = tick(subject, number, subject.faults)
        assert (command.steering, command.acceleration) == ((number + 1) / 64, -1.5)
        assert subject.faults == ()
    assert [sample.sequence for sample in link.sent] == [1, 2, 3, 4, 5]
    assert [sample.time for sample in link.sent] == [EPOCH + PERIOD * number for number in range(5)]
    assert (subject.taken, subject.refused) == (5, {})
    subject.require_answer()


def test_answers_signed_with_another_key_are_counted_and_nothing_is_asked_of_the_car() -> None:
    subject = brain("setpoints", Memory(), KEY)
    command = tick(subject, 0)
    assert (command.steering, command.acceleration) == (STEERING, 0.0)
    assert (subject.faults, subject.taken, subject.refused) == ((SILENT,), 0, {FORGED: 1})


def test_only_lockstep_waits_and_only_for_the_answer_to_what_is_valid() -> None:
    for waits in (False, True):
        link = Memory()
        subject = brain("setpoints", link, waits=waits)
        tick(subject, 0)
        assert link.waits[0] is waits
        assert not any(link.waits[1:]), "what else has come is taken without a wait"
        for invalid in ({"faults": ("geofence_breach",)}, {"seen": False}):
            link.waits.clear()
            tick(subject, 1, **invalid)  # type: ignore[arg-type]
            assert link.waits == [False]
            assert not link.sent[-1].valid


def test_a_brain_that_falls_silent_is_overdue_in_lockstep_and_never_waited_for_again() -> None:
    link = Memory(deaf_from=2)
    subject = brain("setpoints", link, waits=True)
    tick(subject, 0)
    tick(subject, 1)
    tick(subject, 2)
    assert subject.faults == (OVERDUE,)
    assert subject.overdue == "drive time 0.04 s: no answer within 10 s"
    subject.require_answer()
    link.waits.clear()
    tick(subject, 3)
    assert link.waits == [False]


def test_a_brain_that_never_answers_in_lockstep_is_not_there() -> None:
    subject = brain("setpoints", Memory(deaf_from=0), waits=True)
    tick(subject, 0)
    with pytest.raises(RigError, match=r"does not answer, drive time 0\.00 s: no answer within 10 s: start it"):
        subject.require_answer()


def test_live_a_setpoint_outlives_its_brain_by_its_lifetime() -> None:
    subject = brain("setpoints", Memory(deaf_from=1))
    faults = []
    for number in range(8):
        tick(subject, number)
        faults.append(subject.faults)
    assert faults == [()] * 6 + [(SILENT,)] * 2, "0.1 s are five ticks"
    assert subject.overdue == ""


def test_a_brain_that_only_looks_leaves_the_car_to_the_scenarios_controller() -> None:
    link = Memory()
    subject = brain("own", link)
    assert tick(subject, 0).note == "own"
    assert link.sent[0].valid
    assert (subject.faults, subject.overdue, subject.taken, subject.refused, link.waits) == ((), "", 0, {}, [])


def test_a_brain_that_commands_the_car_itself_sees_nothing_before_the_go() -> None:
    link = Memory()
    subject = brain("external", link)
    command = tick(subject, 0)
    assert (command.steering, command.acceleration) == (STEERING, 0.0)
    subject.publisher.awaiting_start = False
    tick(subject, 1)
    subject.publisher.over = True
    tick(subject, 2)
    assert [sample.valid for sample in link.sent] == [False, True, False]
    assert (subject.faults, subject.overdue, link.waits) == ((), "", [])


def test_over_no_link_nobody_answers_and_nobody_is_waited_for() -> None:
    subject = brain("setpoints", NoLink(), waits=True)
    assert tick(subject, 0).acceleration == 0.0
    assert subject.faults == (SILENT,)
