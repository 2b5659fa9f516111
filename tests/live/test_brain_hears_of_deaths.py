"""Each of our processes is killed or frozen while an external controller drives: its sensors say so, and the car stops.

The brains are the shipped ones, processes that know only the wires: one that answers with setpoints, which our gateway
stops in place of, and an external one, which commands the car and has to stop it by itself. Another process listens at
the far ends of the wires and dates what arrives. A run that fails while the machine itself was seen to stand still is
repeated.
"""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.live.matrix import GATEWAY, PERIOD, SPEED, STEP, WATCHDOG, Layer, Right, Row, Signal, bound
from tests.live.stage import Evidence, Stage, free_ports, read_truth
from tests.live.test_matrix import speed_at, way_to_rest
from tests.live.wiretap import Heard, heard, tapped
from tests.live.witness import stalls, witness
from vve_sumo.live.gateway import SILENCE
from vve_sumo.wire import esr

ATTEMPTS: Final = 4
WITHIN: Final = 0.100  #: from a death to the last valid datagram [s]
CYCLES: Final = 2.0 * esr.PERIOD  #: the same on CAN [s]
REST: Final = 15.0  #: time for the car to come to rest [s]
HEARD: Final = WITHIN + 2.0 * PERIOD  #: until the brain acts on what it hears, or on its fix being too old [s]
EXPIRED: Final = 0.1 + WITHIN + STEP  #: the brain falls silent, its last setpoint expires, the gateway knows of it [s]

#: until a frozen recorder is full: 2 s of backlog, and what its queue holds of a drive without traffic [s]
FULL: Final = 8.0

_CAR = vehicles.FUSION.vehicle
#: `drive_by_wire.py`: it asks for 2.5 m/s2 at once, at its next period
BRAIN: Final = Layer("the brain", 2.5, 0.0, PERIOD + _CAR.brake_delay + _CAR.brake_lag)

#: what the tap hears, beside the brain
TAPPED = """
[[outputs]]
kind = "ncom"
udp = "127.0.0.1:{gnss_heard}"

[[outputs]]
kind = "radar"
udp = "127.0.0.1:{radar_heard}"

[[outputs]]
kind = "esr"
interface = "slcan"
channel = "pty:{folder}/esr"

[[outputs]]
kind = "ncom"
udp = "127.0.0.1:{gnss}"
"""
SETPOINTS = """
[[outputs]]
kind = "radar"
udp = "127.0.0.1:{radar}"

[brain]
kind = "setpoints"
port = {setpoints}
"""
EXTERNAL = """
[[outputs]]
kind = "esr"
interface = "slcan"
channel = "pty:{folder}/brain_esr"
host = "bus"

[brain]
kind = "external"
"""


class Death(NamedTuple):
    """What is done to a process, and what is right then."""

    process: str
    number: signal.Signals
    notice: float  #: until whoever stops the car knows of it, at most [s]
    stops: Layer = GATEWAY
    #: until our side itself can know of it [s]; the wires have 100 ms or two cycles after that
    unknown: float = 0.0
    external: bool = False  #: the brain commands the car

    @property
    def name(self) -> str:
        """Of the test."""
        return f"{'external-' * self.external}{self.process}-{self.number.name}"


def of_external(death: Death) -> Death:
    """Return the same death beside an external controller: it stops the car, whatever of ours has died."""
    return death._replace(external=True, stops=BRAIN, notice=death.unknown + HEARD)


KILL, STOP = signal.SIGKILL, signal.SIGSTOP
DEATHS: Final = (
    Death("drive", KILL, EXPIRED),
    Death("drive", STOP, EXPIRED),
    Death("gateway", KILL, STEP, WATCHDOG),
    Death("gateway", STOP, STEP, WATCHDOG),
    Death("outputs", KILL, EXPIRED),
    Death("outputs", STOP, EXPIRED),
    Death("console", KILL, STEP),
    Death("console", STOP, SILENCE + STEP, unknown=SILENCE + STEP),
    Death("recorder", KILL, PERIOD + STEP),
    Death("recorder", STOP, FULL + STEP, unknown=FULL + STEP),
)
ALL: Final = (*DEATHS, *map(of_external, DEATHS))
#: what is tried each time; the others are noticed as one of these is, and `./check slow` tries them
USUAL: Final = {"drive-SIGSTOP", "gateway-SIGSTOP", "external-outputs-SIGKILL"}


class Driven(Stage):
    """A drive by the shipped brain, with a tap on every wire."""

    def __init__(self, death: Death, folder: Path) -> None:
        row = Row(death.name, "", Right.REST, signal=Signal(death.process, death.number), stops=death.stops,
                  notice=death.notice)  # fmt: skip
        super().__init__(row, folder)
        names = ("setpoints", "gnss", "radar", "gnss_heard", "radar_heard")
        self._ports = dict(zip(names, free_ports(len(names)), strict=True))
        self._external, self._heard = death.external, folder / "heard.txt"
        rig = folder / "rig.toml"
        text = rig.read_text(encoding="utf-8")
        if death.external:
            text = text.replace("[car_start]", f'[car_start]\nbrain_channel = "pty:{folder}/car"')
        text += (TAPPED + (EXTERNAL if death.external else SETPOINTS)).format(**self._ports, folder=folder)
        rig.write_text(text, encoding="utf-8")

    def evidence(self) -> tuple[Evidence, list[Heard]]:
        """Drive, break, wait until the car stands; return what is left, and what was heard on the wires."""
        file, ports = self.folder / "witness.txt", self._ports
        with (
            witness(file),
            tapped(self._heard, ports["gnss_heard"], ports["radar_heard"], self.folder / "esr"),
            self._brain(),
            self._console() as console,
        ):
            moment = self._send(self.row.signal.process) if self.row.signal and self._under_way(console) else math.nan
            begin, end = moment - 0.5, self._wait_for_rest(moment)
        said = self._said.read_text(errors="replace")
        stood = tuple((a - self.t0, b - self.t0) for a, b in stalls(file, begin, end))
        return Evidence(self.record, self.t0, moment - self.t0, said, (), stood), heard(self._heard)

    @contextlib.contextmanager
    def _brain(self) -> Iterator[None]:
        program, options = "stop_for_parked.py", ["gnss", "radar", "setpoints"]
        wires: list[str] = []
        if self._external:
            program, options = "drive_by_wire.py", ["gnss"]
            wires = ["--esr", f"slcan:{self.folder}/brain_esr", "--car", f"slcan:{self.folder}/car"]
        command = [sys.executable, str(REPOSITORY / "examples/brains" / program)]
        command += [str(REPOSITORY / "routes" / "linden_17th.csv"), "--speed", "5.0", *wires]
        for name in options:
            command += [f"--{name}", str(self._ports[name])]
        with subprocess.Popen(command, cwd=REPOSITORY) as process:
            try:
                yield
            finally:
                process.kill()

    def _wait_for_rest(self, moment: float) -> float:
        while time.monotonic() < moment + REST:
            time.sleep(0.2)
            if read_truth(self.record)["speed_mps"][-1] == 0.0:
                break
        return time.monotonic()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.live
@pytest.mark.parametrize("death", with_slow(list(ALL), lambda one: one.name in USUAL), ids=lambda one: one.name)
def test_the_brain_hears_of_it_in_time_and_the_car_comes_to_rest(death: Death, tmp_path: Path) -> None:
    for number in range(1, ATTEMPTS + 1):
        drive = Driven(death, tmp_path / str(number))
        evidence, messages = drive.evidence()
        print(measured(death, evidence, messages))
        try:
            judge(drive.row, death, evidence, messages)
        except AssertionError:
            if not evidence.stalls or number == ATTEMPTS:
                raise
        else:
            return


def last_valid(evidence: Evidence, messages: list[Heard], wire: str) -> float:
    """Return how long after the death the last valid message came [s]; negative where none came after it."""
    return max(one.time for one in messages if one.wire == wire and one.valid) - evidence.t0 - evidence.moment


def measured(death: Death, evidence: Evidence, messages: list[Heard]) -> str:
    """What came out, as a row of docs/measurements.md."""
    if math.isnan(evidence.moment):
        return f"{death.name}: never under way: {evidence.said[-300:]}"
    late = " | ".join(f"{1e3 * last_valid(evidence, messages, wire):.0f}" for wire in ("ncom", "radar", "esr"))
    driven, speed = way_to_rest(evidence, evidence.moment), speed_at(evidence, evidence.moment)[0]
    stood = f" (the machine stood still {len(evidence.stalls)} times)" * bool(evidence.stalls)
    return f"| {death.name} | {late} | {speed:.2f} | {driven:.2f} |{stood}"


def judge(row: Row, death: Death, evidence: Evidence, messages: list[Heard]) -> None:
    """Assert that the brain drove, heard of the death in time and nothing valid afterwards; the car stands."""
    assert not math.isnan(evidence.moment), f"it never came to the fault: {evidence.said}"
    assert speed_at(evidence, evidence.moment)[0] > SPEED - 1.0
    for wire, most in (("ncom", WITHIN), ("radar", WITHIN), ("esr", CYCLES)):
        before = [one for one in messages if one.wire == wire and one.time < evidence.t0 + evidence.moment]
        assert before[-1].valid, "nothing was wrong before"
        assert last_valid(evidence, messages, wire) <= death.unknown + most, wire
    assert evidence.truth["speed_mps"][-1] == 0.0
    if death.external:
        assert not evidence.truth["watchdog_braking"].any(), "the DBW controller stopped the car, not the brain"
        assert _senders(evidence.folder / "bus.log") == {"car", "brain"}, "a frame of ours was on the car's bus"
    assert way_to_rest(evidence, evidence.moment) <= bound(row, *speed_at(evidence, evidence.moment))


def _senders(log: Path) -> set[str]:
    """Return who sent on the car's bus, as far as the log's lines are whole."""
    text = log.read_text(encoding="ascii")
    return {line.split()[1] for line in text[: text.rfind("\n") + 1].splitlines()}


def test_an_old_valid_message_is_found() -> None:
    """The measure itself: the last valid message counts, whatever invalid ones come in between."""
    evidence = Evidence(Path(), 10.0, 5.0, "", (), ())
    messages = [Heard(14.9, "ncom", True, 0), Heard(15.02, "ncom", False, 0), Heard(15.3, "ncom", True, 0)]
    assert last_valid(evidence, messages, "ncom") == pytest.approx(0.3)
    assert last_valid(evidence, messages[:2], "ncom") == pytest.approx(-0.1)
