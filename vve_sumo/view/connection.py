"""One connection over a WebSocket: its parts run beside each other until one ends.

Knows WebSockets, times and counts; not what is said.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Coroutine
from typing import Any, Final

from starlette.websockets import WebSocket

#: who takes longer for a message, or for an answer to one, is dropped [s]
ANSWER_TIMEOUT: Final = 5.0
#: for the other end to say that it has heard of the connection's end [s]
CLOSE_TIMEOUT: Final = 1.0

# Of the WebSocket protocol (RFC 6455 and its registry).
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013


class DroppedError(Exception):
    """The other end is dropped, for what it did or did not do."""


class Rate:
    """Counts messages against the most that may come in a second."""

    def __init__(self, most: int) -> None:
        self._most, self._begun, self._count = most, -math.inf, 0

    def exceeded(self, time: float) -> bool:
        """Take in a message that comes at a time [s]; return whether there are too many."""
        if time - self._begun >= 1.0:
            self._begun, self._count = time, 0
        self._count += 1
        return self._count > self._most


def now() -> float:
    """Return the time of the event loop [s]."""
    return asyncio.get_running_loop().time()


async def send(message: Awaitable[None]) -> None:
    """Await that a message is taken; raises DroppedError where that takes too long."""
    try:
        await asyncio.wait_for(message, ANSWER_TIMEOUT)
    except TimeoutError:
        raise DroppedError from None


async def run(*parts: Coroutine[Any, Any, None]) -> bool:
    """Run the parts of a connection until the first of them ends, and end the others.

    Returns whether the other end was dropped; what else a part raised ended the connection and is no more than that.
    """
    tasks = [asyncio.create_task(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
    return any(isinstance(one, DroppedError) for one in results)


async def close(socket: WebSocket) -> None:
    """End a connection; for one that has ended, nothing."""
    with contextlib.suppress(Exception):
        await asyncio.wait_for(socket.close(POLICY_VIOLATION), CLOSE_TIMEOUT)
