"""Reads a Delphi ESR's tracks from a CAN bus of its own, and tells the radar how the car moves, as its host has to."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from types import SimpleNamespace

from driving import Scan

from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.wire import esr

STAMPS = 0.256  # after so long the radar's time stamp begins again [s]
ROUNDING = 0.002  # of the time stamp [s]
LIFETIME = 0.2  # of a cycle, which comes every 50 ms [s]
OPEN_TIMEOUT = 60.0  # for the file of a bus to appear [s]


def open_bus(place: str) -> Bus:
    """Open INTERFACE:CHANNEL by python-can; a serial port that is not there yet is waited for."""
    interface, _, channel = place.partition(":")
    until = time.monotonic() + OPEN_TIMEOUT
    while interface == "slcan" and not Path(channel).exists() and time.monotonic() < until:
        time.sleep(0.05)
    return Bus(interface, channel)


class EsrRadar:
    """The newest whole cycle of a radar."""

    def __init__(self, bus: Bus) -> None:
        self.bus, self._decoder = bus, esr.Decoder()
        self._cycle: esr.Cycle | None = None
        self._came = float("-inf")

    def listen(self, now: float) -> None:
        """Take what has come by a time [s]; a bus that is gone is a radar that sees nothing, not the brain's end."""
        try:
            frames = self.bus.drain()
        except RigError:
            self._cycle = None
            return
        for cycle in self._decoder.feed(frames):
            # A cycle that repeats the scan index shows no new scan: a radar that hangs repeats it for good.
            if self._cycle is None or cycle.scan_index != self._cycle.scan_index:
                self._came = now
            self._cycle = cycle

    def tell(self, speed: float, yaw_rate: float) -> None:
        """Send the vehicle messages: speed [m/s], yaw rate [rad/s], and the order to radiate."""
        with contextlib.suppress(RigError):
            for frame in esr.encode_host(esr.HostMotion(speed, yaw_rate)):
                self.bus.send(frame)

    def scan(self, now: float, time: float, speed: float) -> Scan | None:
        """Return what the radar sees at GNSS `time` [s]; None where a cycle is not valid, or too old at `now` [s]."""
        cycle = self._cycle
        if cycle is None or not cycle.valid or now - self._came > LIFETIME:
            return None
        found = [SimpleNamespace(range=one.range, azimuth=one.angle, range_rate=one.range_rate) for one in cycle.tracks]
        # A stamp is rounded, so that a scan of this very moment may seem to come from a little later.
        age = (time - cycle.time_stamp + ROUNDING) % STAMPS - ROUNDING
        return Scan(time, time - max(age, 0.0), speed, found)
