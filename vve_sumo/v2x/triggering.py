"""Says when a station sends its next awareness message, and what it has seen of others that is worth one.

A vehicle sends CAMs, a person or a cyclist VAMs. The rules are those of ETSI EN 302 637-2 V1.4.1 (6.1.3) and TS 103
300-3 V2.1.1 (6.4): a message is due when the station has turned, moved or changed its speed by so much since the last
one, and no later than after a longest interval. Of the rules for a VAM those about paths that meet, distances that are
no longer safe and clusters are left out. What a station's sensors see goes into its CPMs by the same thresholds (TS 103
324 V2.1.1, 6.1), each object by itself. Times are whole microseconds. Knows no message and no radio.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Final, NamedTuple

#: between two checks of a station, and shortest interval between two messages [us]
CHECK_PERIOD: Final = 100_000
#: longest interval between two messages of a vehicle [us]
LONGEST_CAM: Final = 1_000_000
#: longest interval between two messages of a person or a cyclist [us]
LONGEST_VAM: Final = 5_000_000
#: longest interval between two CPMs with an object that is still seen [us]
LONGEST_CPM: Final = 1_000_000
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

    longest: int = LONGEST_CAM  #: interval after which a message is due in any case [us]
    _last: Motion | None = None
    _sent: int = 0  # time of the last message [us]
    _interval: int = field(init=False)  # the same, shortened for a while by messages that were due earlier [us]
    _by_interval: int = 0  # messages in a row that were due by it

    def __post_init__(self) -> None:
        self._interval = self.longest

    def due(self, now: int, motion: Motion) -> bool:
        """Say whether a CAM is to be sent at a time [us]; the first check sends one."""
        last, elapsed = self._last, now - self._sent
        if last is None:
            pass
        elif elapsed < CHECK_PERIOD:
            return False
        elif _turned(last, motion) or _moved_or_changed(last, motion):
            self._interval, self._by_interval = min(elapsed, self.longest), 0
        elif elapsed >= self._interval:
            self._by_interval += 1
            if self._by_interval >= SHORTENED:
                self._interval, self._by_interval = self.longest, 0
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


@dataclass(slots=True)
class PerceptionTrigger:
    """The rule for the objects of CPMs. Pass it every check in order."""

    _last: dict[int, Motion] = field(default_factory=dict)  # of each object, as its last message has it
    _sent: dict[int, int] = field(default_factory=dict)  # time of the last message with each object [us]

    def due(self, now: int, objects: Mapping[int, Motion], vulnerable: Set[int]) -> frozenset[int]:
        """Return the numbers of the objects that a message at a time [us] has to include.

        `vulnerable` are those that are people or animals: all are included when one is new, or was not included for
        half of the longest interval.
        """
        included = {
            number for number, motion in objects.items() if self._is_due(now, number, motion, number in vulnerable)
        }
        if included & vulnerable:
            included |= vulnerable & objects.keys()
        self._last = {number: objects[number] if number in included else self._last[number] for number in objects}
        self._sent = {number: now if number in included else self._sent[number] for number in objects}
        return frozenset(included)

    def _is_due(self, now: int, number: int, motion: Motion, vulnerable: bool) -> bool:
        last = self._last.get(number)
        if last is None:
            return True
        elapsed = now - self._sent[number]
        if vulnerable:
            return elapsed >= LONGEST_CPM // 2
        moves = min(last.speed, motion.speed) > DIRECTED
        return elapsed >= LONGEST_CPM or (moves and _turned(last, motion)) or _moved_or_changed(last, motion)


def _turned(last: Motion, motion: Motion) -> bool:
    return abs(math.remainder(motion.heading - last.heading, math.tau)) > TURNED


def _moved_or_changed(last: Motion, motion: Motion) -> bool:
    moved = math.hypot(motion.x - last.x, motion.y - last.y) > MOVED
    return moved or abs(motion.speed - last.speed) > CHANGED_SPEED
