"""Datagrams between two processes of a live drive, over a socket that only they have.

Knows bytes and queues; not what a datagram says. Nothing here ever waits: whoever cannot be told now is not told.
"""

from __future__ import annotations

import errno
import socket
from typing import Final

#: asked of the kernel for every queue [bytes]: what Linux allows everybody, and counts twice; so that whoever stops
#: listening is found out equally soon on every machine
QUEUE_SIZE: Final = 212_992
#: datagrams taken at once, so that a flood cannot keep its reader from everything else
MAX_DATAGRAMS: Final = 500
#: what a process says that has nothing to say but that it runs
ALIVE: Final = b"alive"
#: longest datagram [bytes]
MAX_DATAGRAM_SIZE: Final = 400_000


class Channel:
    """One end of a datagram channel; it keeps boundaries and order, and what it has accepted it delivers."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        for queue in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            end.setsockopt(socket.SOL_SOCKET, queue, QUEUE_SIZE)
        self._socket = end
        self.closed = False  #: the other end is gone, as far as sending or receiving has shown

    def send(self, data: bytes) -> bool:
        """Hand over a datagram, not empty; False where the other end is gone or the queue has no room for it."""
        if len(data) > MAX_DATAGRAM_SIZE:
            return False
        try:
            self._socket.send(data, socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            # Longer than the whole queue is as good as a full queue; anything else is an end that is gone.
            self.closed = self.closed or error.errno not in (errno.EMSGSIZE, errno.ENOBUFS)
            return False
        return True

    def receive(self) -> list[bytes]:
        """Return the waiting datagrams in order, at most MAX_DATAGRAMS, also those that a closed other end had sent."""
        waiting: list[bytes] = []
        while len(waiting) < MAX_DATAGRAMS:
            try:
                data = self._socket.recv(MAX_DATAGRAM_SIZE)
            except (BlockingIOError, InterruptedError):
                return waiting
            except ConnectionResetError:
                # Said once, where the other end went without reading all; what it had sent comes after it.
                self.closed = True
                continue
            except OSError:
                self.closed = True
                return waiting
            if not data:
                self.closed = True
                return waiting
            waiting.append(data)
        return waiting

    def fileno(self) -> int:
        """Return the file descriptor, for poll and select."""
        return self._socket.fileno()

    def close(self) -> None:
        """Let go of this end; the other end sees it as gone."""
        self.closed = True
        self._socket.close()


def pair() -> tuple[Channel, Channel]:
    """Return the two ends of a new channel."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return Channel(ours), Channel(theirs)


def adopt(descriptor: int) -> Channel:
    """Return the channel whose end came to this process as file `descriptor`; its own children shall not have it."""
    end = socket.socket(fileno=descriptor)
    end.set_inheritable(False)
    return Channel(end)
