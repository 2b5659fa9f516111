"""A receiver that a person carries: NMEA in datagrams, read by the decoder of every NMEA receiver.

Knows sentences by that decoder alone. A person's receiver need not say a heading.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.people.reports import PositionReport
from vve_sumo.people.track import CIRCLE_95
from vve_sumo.pose.nmea import Decoder
from vve_sumo.pose.sources import Source, open_udp
from vve_sumo.rig.connections import RigPerson
from vve_sumo.values import Fix

#: below this speed the course over ground is no direction [m/s]
MIN_COURSE_SPEED: Final = 0.5


class Rover:
    """The positions of one person's receiver."""

    def __init__(self, person: str, source: Source, t0: float, epoch: float) -> None:
        """`t0` is the monotonic second of drive time 0, `epoch` its GNSS second."""
        self._person, self._source, self._t0, self._epoch = person, source, t0, epoch
        self._decoder = Decoder(needs_attitude=False)

    def fileno(self) -> int:
        """Return the file descriptor to wait on."""
        return self._source.fileno()

    def receive(self) -> list[tuple[float, PositionReport]]:
        """Return the positions that have come, each with the drive time of its arrival [s]."""
        found = []
        for stamp, data in self._source.receive():
            received = stamp - self._t0
            found += [
                (received, report_of(fix, self._person, self._epoch)) for fix in self._decoder.feed(data, received)
            ]
        return found

    def close(self) -> None:
        """Close the socket."""
        self._source.close()


def report_of(fix: Fix, person: str, epoch: float) -> PositionReport:
    """Return the report that a fix is.

    Its accuracy is NaN, and the report not believed, where the fix has none or is not the receiver's own: estimated,
    set by hand or simulated.
    """
    speed = math.hypot(fix.velocity_east, fix.velocity_north)
    heading = math.atan2(fix.velocity_north, fix.velocity_east) if speed >= MIN_COURSE_SPEED else math.nan
    accuracy = CIRCLE_95 * fix.position_sigma if fix.locked else math.nan
    return PositionReport(person, fix.time - epoch, fix.latitude, fix.longitude, accuracy, heading)


def open_rover(person: RigPerson, t0: float, epoch: float) -> Rover:
    """Listen for a person's receiver, as `Rover` has it; raises RigError naming the key."""
    assert person.port is not None
    source = open_udp(person.address, person.port, person.sender, f"people.{person.id}", genuine=_holds_a_sentence)
    return Rover(person.id, source, t0, epoch)


def _holds_a_sentence(datagram: bytes) -> bool:
    decoder = Decoder()
    decoder.feed(datagram, 0.0)
    return decoder.sentences > 0
