"""Says when a station sends its next awareness message: a vehicle its CAM, a person or a cyclist the VAM.

The rules are those of ETSI EN 302 637-2 V1.4.1 (6.1.3) and TS 103 300-3 V2.1.1 (6.4): a message is due when the
station has turned, moved or changed its speed by so much since the last one, and no later than after a longest
interval. Of the rules for a VAM those about paths that meet, distances that are no longer safe and clusters are left
out. Times are whole microseconds. Knows no message and no radio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

#: between two checks of a station, and shortest interval between two messages [us]
CHECK_PERIOD: Final = 100_000
#: longest interval between two messages of a vehicle [us]
LONGEST_CAM: Final = 1_000_000
#: longest interval between two messages of a person or a cyclist [us]
LONGEST_VAM: Final = 5_000_000
#: so many CAMs follow each other by a shortened interval alone, before it is the longest again
SHORTENED: Final = 3
#: what a station must have turned since its last message [rad]
TURNED: Final = math.radians(4.0)
#: what it must have moved [m]
MOVED: Final = 4.0
#: by what its speed must have changed [m/s]
CHANGED_SPEED: Final = 0.5
#: slower than this nobody can tell the direction of a velocity [m/s]: an assumption
DIRECTED: Final = 0.1


class Motion(NamedTuple):
    """What a check compares with the last message."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: [rad]
    speed: float  #: [m/s]


@dataclass(slots=True)
class CamTrigger:
    """The rule of a vehicle. Pass it every check in order."""

    _last: Motion | None = None
    _sent: int = 0  # time of the last message [us]
    _interval: int = LONGEST_CAM  # after which a message is due in any case [us]
    _by_interval: int = 0  # messages in a row that were due by it

    def due(self, now: int, motion: Motion) -> bool:
        """Say whether a CAM is to be sent at a time [us]; the first check sends one."""
        last, elapsed = self._last, now - self._sent
        if last is None:
            pass
        elif elapsed < CHECK_PERIOD:
            return False
        elif _turned(last, motion) or _moved_or_changed(last, motion):
            self._interval, self._by_interval = min(elapsed, LONGEST_CAM), 0
        elif elapsed >= self._interval:
            self._by_interval += 1
            if self._by_interval >= SHORTENED:
                self._interval, self._by_interval = LONGEST_CAM, 0
        else:
            return False
        self._last, self._sent = motion, now
        return True


@dataclass(slots=True)
class VamTrigger:
    """The rule of a person or a cyclist. Pass it every check in order."""

    _last: Motion | None = None
    _sent: int = 0  # time of the last message [us]

    def due(self, now: int, motion: Motion) -> bool:
        """Say whether a VAM is to be sent at a time [us]; the first check sends one."""
        last, elapsed = self._last, now - self._sent
        if last is not None:
            moves = min(last.speed, motion.speed) > DIRECTED
            differs = (moves and _turned(last, motion)) or _moved_or_changed(last, motion)
            if elapsed < CHECK_PERIOD or not (differs or elapsed >= LONGEST_VAM):
                return False
        self._last, self._sent = motion, now
        return True


def _turned(last: Motion, motion: Motion) -> bool:
    return abs(math.remainder(motion.heading - last.heading, math.tau)) > TURNED


def _moved_or_changed(last: Motion, motion: Motion) -> bool:
    moved = math.hypot(motion.x - last.x, motion.y - last.y) > MOVED
    return moved or abs(motion.speed - last.speed) > CHANGED_SPEED
