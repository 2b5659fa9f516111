"""Accepts one sender on the receiver's UDP port, and reports every other.

It knows addresses; it must not know sockets, and of the content of a datagram only whether it is one that a receiver
sends. UDP proves nothing: any device on the same segment can forge the receiver's address. This detects mistakes and
stray senders, not a deliberate attack.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

#: time for which a fault is reported after the last datagram of another sender [s]
STANDS: Final = 1.0
#: other senders that are counted by name; a flood may come from any number of them
MAX_NAMED: Final = 8
REST: Final = "others"


class Senders:
    """Accepts one sender for good: the first of which a genuine datagram comes from `source`, by its address and port.

    `source` is an IPv4 address; None accepts the first program of this machine (127.0.0.0/8). A receiver that comes
    back from another port is another sender: it cannot be told from a second one. `genuine` says whether a datagram is
    one that a receiver sends. Before the first such one every datagram from `source` is accepted, so that whoever
    decodes it can say what is wrong with it; it is counted as refused, unless its sender becomes the one.
    """

    def __init__(self, source: str | None, genuine: Callable[[bytes], bool] = bool) -> None:
        self._source, self._genuine = source, genuine
        self._first: tuple[str, int] | None = None
        self._refused: Counter[str] = Counter()
        self._last: dict[str, float] = {}  # reason code to the time of its last datagram [s]

    def accepts(self, now: float, sender: tuple[str, int], data: bytes) -> bool:
        """Whether to accept a datagram of `sender` (address, port) that is read at monotonic time `now` [s]."""
        if sender == self._first:
            return True
        ours, name = self._is_ours(sender[0]), f"{sender[0]}:{sender[1]}"
        unknown = ours and self._first is None
        if unknown and self._genuine(data):
            self._first = sender
            del self._refused[name]
            return True
        if not unknown:
            self._last["pose_two_senders" if ours else "pose_foreign_sender"] = now
        self._refused[name if name in self._refused or len(self._refused) < MAX_NAMED else REST] += 1
        return unknown

    def faults(self, now: float) -> tuple[str, ...]:
        """Return reason codes of the other senders that have sent within the last `STANDS` seconds."""
        return tuple(code for code, last in self._last.items() if now - last <= STANDS)

    def sender_report(self) -> dict[str, Any]:
        """Return the accepted sender and the number of refused datagrams by sender, as plain JSON."""
        sender = None if self._first is None else f"{self._first[0]}:{self._first[1]}"
        return {"sender": sender, "refused": dict(self._refused)}

    def _is_ours(self, address: str) -> bool:
        return ipaddress.ip_address(address).is_loopback if self._source is None else address == self._source
