"""Runs the process of the outgoing wires: samples of the drive in, datagrams and frames to an external controller out.

It is fed one way and holds no way back: nothing that happens on a wire can slow the drive or reach the car's bus. It
has a timer of its own: while the drive says nothing, every wire says *invalid* at the rate of the ticks. When this
process dies, the counters on the wires stop.
"""

from __future__ import annotations

import contextlib
import gc
import select
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import msgspec

from vve_sumo.bus import Bus
from vve_sumo.errors import VveError
from vve_sumo.intersections import Intersection
from vve_sumo.live import messages, signals
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import DRIVE_NICE, OOM_DRIVE, raise_priority, set_oom_score
from vve_sumo.live.pty_bus import PtyOutlet
from vve_sumo.live.spawn import receive_config
from vve_sumo.messages import MalformedMessage
from vve_sumo.pty_link import PREFIX
from vve_sumo.sensors.port import STANDARD
from vve_sumo.timing import PERIOD
from vve_sumo.values import Vehicle
from vve_sumo.wire.outlets import CanOutlet, Outlet, SerialOutlet, TcpOutlet, UdpOutlet
from vve_sumo.wire.outputs import KINDS, Context, OfOtherSensor, Output
from vve_sumo.wire.sample import Sample, sequence_of
from vve_sumo.wire.sample_codec import decode_sample
from vve_sumo.wire.signature import signed

#: a sample that is this much later than due is no longer waited for [s]: the wires turn invalid
SAMPLE_TIMEOUT: Final = 0.03
#: so long every wire says invalid after the drive has ended [s], before it falls silent
FINAL_INVALID_TIME: Final = 0.3


class OutputWire(NamedTuple):
    """One outgoing wire."""

    name: str  #: of the rig's table
    output: Output
    outlet: Outlet[Any]


def opened(tables: list[Mapping[str, Any]], context: Context) -> list[OutputWire]:
    """Open the wires of a rig's `[[outputs]]`; raises VveError naming the table that cannot be opened."""
    wires: list[OutputWire] = []
    for number, table in enumerate(tables):
        name = f"outputs.{number}"
        try:
            wires.append(_wire(name, table, context))
        except VveError as error:
            for wire in wires:
                wire.outlet.close()
            raise type(error)(f"{name}: {error}") from None
    return wires


def _wire(name: str, table: Mapping[str, Any], context: Context) -> OutputWire:
    outlet = _outlet(table, context.key)
    receive = outlet.receive if table["host"] == "bus" and isinstance(outlet, CanOutlet | PtyOutlet) else None
    of_this = replace(context, receive=receive, stop_id=table["can_id"])
    try:
        output = KINDS[table["kind"]].make(of_this)
        sensor = table.get("sensor") or STANDARD
        return OutputWire(name, output if sensor == STANDARD else OfOtherSensor(output, sensor), outlet)
    except VveError:
        outlet.close()
        raise


def _outlet(table: Mapping[str, Any], key: bytes) -> Outlet[Any]:
    if table.get("udp"):
        seal = partial(signed, key=key) if key and KINDS[table["kind"]].signed else bytes
        return UdpOutlet(*_place(table["udp"]), seal)
    if table.get("tcp"):
        return TcpOutlet(*_place(table["tcp"]))
    if table.get("device"):
        return SerialOutlet(table["device"], table["baud"])
    if table["channel"].startswith(PREFIX):
        return PtyOutlet(table["channel"])
    return CanOutlet(Bus(table["interface"], table["channel"], table["bitrate"]))


def _place(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


class Outputs:
    """Sends what the drive says, and *invalid* where it says nothing."""

    def __init__(self, wires: list[OutputWire], drive: Channel, t0: float, epoch: float) -> None:
        """`t0` is the monotonic second of drive time 0, `epoch` its GNSS second."""
        self._wires, self._drive, self._t0, self._epoch = wires, drive, t0, epoch
        self._due = time.monotonic() + SAMPLE_TIMEOUT + PERIOD
        self._sequence = 0  # of the newest sample sent
        self._failed: set[str] = set()  # wires whose encoder has failed
        self.sent = self.silent = 0  #: samples of the drive, and ticks at which it said nothing

    def run(self) -> None:
        """Send until the drive is gone, and *invalid* for a little longer."""
        until = float("inf")
        while time.monotonic() < until:
            left = max(self._due - time.monotonic(), 0.0)
            watched = [] if self._drive.closed else [self._drive]
            select.select(watched, [], [], left)
            self._forward()
            if time.monotonic() >= self._due:
                self._say_invalid()
            if self._drive.closed and until == float("inf"):
                until = time.monotonic() + FINAL_INVALID_TIME

    def _forward(self) -> None:
        """Send the newest sample that waits; older ones would be old on the wire."""
        waiting = self._drive.receive()
        if not waiting:
            return
        sample = decode_sample(waiting[-1])
        if isinstance(sample, MalformedMessage):
            return
        now = time.monotonic()
        if now - self._t0 - sample.drive_time > SAMPLE_TIMEOUT or sample.sequence <= self._sequence:
            return  # the drive was held up after it had made the sample; the timer speaks in its place
        self._due = now + PERIOD + SAMPLE_TIMEOUT
        self.sent += 1
        self._send(sample)

    def _say_invalid(self) -> None:
        now = time.monotonic()
        self._due = now + PERIOD
        self.silent += 1
        drive_time = now - self._t0
        # Not after the sequence of a sample that may still come: one of a tick before SAMPLE_TIMEOUT is not sent.
        sequence = max(self._sequence + 1, sequence_of(drive_time - SAMPLE_TIMEOUT))
        self._send(Sample(sequence, self._epoch + drive_time, drive_time, None))

    def _send(self, sample: Sample) -> None:
        self._sequence = sample.sequence
        for wire in self._wires:
            # A bug in one encoder must not silence the others.
            try:
                wire.outlet.send(self._encoded(wire, sample))
            except Exception as error:
                self._say_once(wire, error)

    def _encoded(self, wire: OutputWire, sample: Sample) -> Sequence[Any]:
        """Return what a wire sends for a sample; where its encoder fails, *invalid*."""
        try:
            return wire.output.step(sample)
        except Exception as error:
            self._say_once(wire, error)
            return wire.output.step(replace(sample, measured=None))

    def _say_once(self, wire: OutputWire, error: Exception) -> None:
        if wire.name not in self._failed:
            _say(f"{wire.name}: {type(error).__name__}: {error}")
        self._failed.add(wire.name)

    def report(self) -> str:
        """Return the log's last line."""
        lost = {wire.name: wire.outlet.lost for wire in self._wires if wire.outlet.lost}
        silent = f"invalid for {self.silent} ticks in which the drive said nothing"
        return f"{self.sent} samples sent, {silent}, lost {lost}, encoders that failed {sorted(self._failed)}"


def _say(line: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(f"outputs: {line}", file=sys.stderr, flush=True)  # noqa: T201 (the log of a process without a terminal)


def _context(config: Mapping[str, Any]) -> Context:
    x, y = config["map_offset"]
    at_signals = msgspec.convert(config["intersections"], tuple[Intersection, ...])
    vehicle, key = Vehicle(**config["vehicle"]), bytes.fromhex(config["key"])
    return Context(vehicle, config["projection"], (x, y), intersections=at_signals, key=key)


def main() -> int:
    """Run the process and return its exit code."""
    signals.ignore()
    set_oom_score(OOM_DRIVE)
    config, channels = receive_config()
    try:
        wires = opened(config["outputs"], _context(config))
    except VveError as error:
        _say(str(error))
        channels["console"].send(messages.refusal(error))
        return error.exit_code
    channels["console"].send(messages.encode(messages.Ready()))
    raise_priority(DRIVE_NICE)
    gc.collect()
    gc.freeze()
    gc.disable()
    outputs = Outputs(wires, channels["drive"], config["t0"], config["epoch"])
    outputs.run()
    _say(outputs.report())
    for wire in wires:
        wire.outlet.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
