"""On the search path of a live drive: makes one step of the drive's SUMO take 2 s, with the interpreter locked."""

import ctypes
import os
import sys
import time

DURATION = 2.0  # [s]
AFTER = 3.0  # from the first pose faster than `MOVES` [s]
MOVES = 0.5  # [m/s]


def spoil() -> None:
    """Wrap the placing and the stepping of the virtual road."""
    from pathlib import Path

    from vve_sumo.world.world import World

    place, step = World.place, World.step
    due = [float("inf")]

    def watching(self, pose, *arguments, **named):  # type: ignore[no-untyped-def]
        if pose.speed > MOVES:
            due[0] = min(due[0], time.monotonic() + AFTER)
        return place(self, pose, *arguments, **named)

    def stalling(self):  # type: ignore[no-untyped-def]
        if time.monotonic() > due[0] > 0.0:
            due[0] = 0.0
            Path(os.environ["VVE_TEST_MOMENT"]).write_text(f"{time.monotonic()}\n")
            # PyDLL, unlike CDLL, keeps the interpreter's lock while the function runs.
            ctypes.PyDLL(None).usleep(int(1e6 * DURATION))
        return step(self)

    World.place, World.step = watching, stalling  # type: ignore[method-assign]


if "vve_sumo.live.drive" in sys.orig_argv:
    spoil()
