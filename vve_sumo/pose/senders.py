"""Accepts one sender on the receiver's UDP port, and reports every other.

It knows addresses; it must not know sockets or the content of a datagram. UDP proves nothing: any device on the same
segment can forge the receiver's address. This detects mistakes and stray senders, not a deliberate attack.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from typing import Any, Final

#: time for which a fault is reported after the last datagram of another sender [s]
STANDS: Final = 1.0
#: other senders that are counted by name; a flood may come from any number of them
MAX_NAMED: Final = 8
REST: Final = "others"


class Senders:
    """Accepts one sender for good: the first that sends from `source`, by its address and port.

    `source` is an IPv4 address; None accepts the first program of this machine (127.0.0.0/8). A receiver that comes
    back from another port is another sender: it cannot be told from a second one.
    """

    def __init__(self, source: str | None) -> None:
        self._source = source
        self._first: tuple[str, int] | None = None
        self._refused: Counter[str] = Counter()
        self._last: dict[str, float] = {}  # reason code to the time of its last datagram [s]

    def accepts(self, now: float, sender: tuple[str, int]) -> bool:
        """Whether to accept a datagram of `sender` (address, port) that is read at monotonic time `now` [s]."""
        if sender == self._first:
            return True
        ours = self._is_ours(sender[0])
        if ours and self._first is None:
            self._first = sender
            return True
        self._last["pose_two_senders" if ours else "pose_foreign_sender"] = now
        name = f"{sender[0]}:{sender[1]}"
        self._refused[name if name in self._refused or len(self._refused) < MAX_NAMED else REST] += 1
        return False

    def found(self, now: float) -> tuple[str, ...]:
        """Return reason codes of the other senders that have sent within the last `STANDS` seconds."""
        return tuple(code for code, last in self._last.items() if now - last <= STANDS)

    def sender_report(self) -> dict[str, Any]:
        """Return the accepted sender and the number of refused datagrams by sender, as plain JSON."""
        sender = None if self._first is None else f"{self._first[0]}:{self._first[1]}"
        return {"sender": sender, "refused": dict(self._refused)}

    def _is_ours(self, address: str) -> bool:
        return ipaddress.ip_address(address).is_loopback if self._source is None else address == self._source
