"""Takes the setpoints of a control computer: the newest that is whole, newer than the last, timely, and still alive.

Knows datagrams and times; it must not know sockets, and nothing of what a gateway does with a setpoint. Every datagram
that is not taken has a reason code; none of them raises. With a key every datagram is signed. Sequences begin again
with every drive, so a setpoint that was recorded in an earlier drive is told by its time, which the key signs too.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import Final

from vve_sumo.values import ControlCommand
from vve_sumo.wire.datagrams import SEQUENCES, SetpointDatagram, Wrong, decode_setpoint
from vve_sumo.wire.signature import without_tag

#: a setpoint that answers an older datagram than the last so many counts as late: 0.2 s of ticks
MAX_ANSWERED: Final = 10
#: a setpoint that answers a datagram from longer ago counts as late [s]: MAX_ANSWERED ticks
MAX_AGE: Final = 0.2
#: between a tick's nominal time and the clock that dates arrivals [s], at most: an assumption
CLOCK_TOLERANCE: Final = 0.05
#: reason codes beside `datagrams.Wrong`
REPLAYED, UNASKED, LATE = "setpoint_replayed", "setpoint_unasked", "setpoint_late"
#: reason code of a control computer that has sent no setpoint that is still alive
SILENT: Final = "brain_silent"
#: reason code of a datagram that was not made with the key
FORGED: Final = "setpoint_forged"


def is_setpoint(data: bytes, key: bytes = b"") -> bool:
    """Return whether a datagram is a whole setpoint, signed where there is a `key`."""
    body = without_tag(data, key)
    return body is not None and isinstance(decode_setpoint(body), SetpointDatagram)


class SetpointInbox:
    """The newest setpoint of one control computer."""

    def __init__(self, epoch: float, key: bytes = b"") -> None:
        """`epoch` is the GNSS second of drive time 0. With a `key`, only datagrams signed with it are taken."""
        self._epoch, self._key = epoch, key
        self.counts: Counter[str] = Counter()  #: datagrams that were not taken, by reason code
        self.taken = 0  #: setpoints taken
        self._sent_sequences: deque[int] = deque(
            maxlen=MAX_ANSWERED
        )  # sequences of the newest datagrams that were sent
        self._newest: SetpointDatagram | None = None
        self._expires = -math.inf

    def sample_sent(self, sequence: int) -> None:
        """Note the sequence of a radar datagram that was just sent; a setpoint must answer one of the last."""
        self._sent_sequences.append(sequence % SEQUENCES)

    def take(self, now: float, data: bytes) -> str:
        """Take a datagram that arrived at drive time `now` [s]; return why it was not taken, empty where it was."""
        body = without_tag(data, self._key)
        if body is None:
            self.counts[FORGED] += 1
            return FORGED
        setpoint = decode_setpoint(body)
        reason = setpoint.value if isinstance(setpoint, Wrong) else self._refusal(now, setpoint)
        if isinstance(setpoint, Wrong) or reason:
            self.counts[reason] += 1
            return reason
        self._newest, self._expires = setpoint, now + setpoint.lifetime
        self.taken += 1
        return ""

    def _refusal(self, now: float, setpoint: SetpointDatagram) -> str:
        if self._newest is not None:
            ahead = (setpoint.sequence - self._newest.sequence) % SEQUENCES
            if not 0 < ahead < SEQUENCES // 2:
                return REPLAYED
        age = self._epoch + now - setpoint.time
        if age < -CLOCK_TOLERANCE:
            return UNASKED
        if age > MAX_AGE + CLOCK_TOLERANCE:
            return LATE
        if setpoint.answers in self._sent_sequences:
            return ""
        newest = self._sent_sequences[-1] if self._sent_sequences else None
        older = newest is not None and (newest - setpoint.answers) % SEQUENCES < SEQUENCES // 2
        return LATE if older else UNASKED

    def answered(self, sequence: int) -> bool:
        """Whether the newest setpoint answers the radar datagram of this sequence."""
        return self._newest is not None and self._newest.answers == sequence % SEQUENCES

    def command(self, now: float) -> ControlCommand | None:
        """Return what the newest setpoint asks for; None where there is none that is alive at drive time `now` [s]."""
        newest = self._newest
        if newest is None or now > self._expires:
            return None
        return ControlCommand(newest.steering, newest.acceleration, newest.emergency, "foreign setpoint")
