"""Passes datagrams between two processes of a live drive, over a socket pair that only these two hold.

Knows bytes and queues, not what a datagram means. No call waits: a datagram that cannot be queued now is not sent.
"""

from __future__ import annotations

import errno
import socket
from typing import Final

#: size asked of the kernel for every queue [bytes]: Linux allows it to every user, and doubles it. With the same size,
#: a process that stops reading is noticed equally soon on every machine
QUEUE_SIZE: Final = 212_992
#: most datagrams that one `receive` returns, so that a flood cannot keep its reader from other work
MAX_DATAGRAMS: Final = 500
#: the sign of life of a process
ALIVE: Final = b"alive"
#: longest datagram [bytes]
MAX_DATAGRAM_SIZE: Final = 400_000


class Channel:
    """One end of a datagram channel; keeps datagram boundaries and order, and delivers every datagram it accepted."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        for queue in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            end.setsockopt(socket.SOL_SOCKET, queue, QUEUE_SIZE)
        self._socket = end
        self.closed = False  #: the other end is gone, as far as sending or receiving has shown

    def send(self, data: bytes) -> bool:
        """Queue a datagram, not empty; False if the other end is gone, or the datagram is too long or has no room."""
        if len(data) > MAX_DATAGRAM_SIZE:
            return False
        try:
            self._socket.send(data, socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            # A datagram longer than the queue counts as a full queue; every other error means that the end is gone.
            self.closed = self.closed or error.errno not in (errno.EMSGSIZE, errno.ENOBUFS)
            return False
        return True

    def receive(self) -> list[bytes]:
        """Return the waiting datagrams in order, at most MAX_DATAGRAMS, also those sent before the other end closed."""
        waiting: list[bytes] = []
        while len(waiting) < MAX_DATAGRAMS:
            try:
                data = self._socket.recv(MAX_DATAGRAM_SIZE)
            except (BlockingIOError, InterruptedError):
                return waiting
            except ConnectionResetError:
                # Raised once, if the other end closed with datagrams unread; those that it had sent come after it.
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
        """Close this end; the other end sees it as gone."""
        self.closed = True
        self._socket.close()


def pair() -> tuple[Channel, Channel]:
    """Return the two ends of a new channel."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return Channel(ours), Channel(theirs)


def adopt(descriptor: int) -> Channel:
    """Return the channel whose end this process inherited as file `descriptor`; its children do not inherit it."""
    end = socket.socket(fileno=descriptor)
    end.set_inheritable(False)
    return Channel(end)
